"""Engine: where tasks are done (this process, several of this machine, a dask cluster), and in which order."""

import multiprocessing
import os
import signal
import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from itertools import chain, islice
from typing import Any, Protocol, Self, TypeVar

from maxcon._system.version import __version__
from maxcon.errors import MaxconError, MissingExtraError, OptionError

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")
ResultT_co = TypeVar("ResultT_co", covariant=True)

MOST_JOBS = 2  # kept open by a worker, with the tiles of their maps; two, for two who use the same cluster
ALLOWED_DEATHS = 3  # times that a task may end its worker and is tried again; four in turn are no accident
LOST = "each worker that was given it ended: it crashes, or memory is short"
LOOK_EVERY = 1.0  # s between looks at whether the workers live, while no result comes


def n_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Job(Protocol[TaskT, ResultT_co]):
    """A kind of work, opened once by each process that it travels to; a task done twice has one result."""

    def open(self) -> Callable[[TaskT], ResultT_co]:
        """Open what the tasks need; return what does one of them."""

    def split(self, task: TaskT) -> Sequence[TaskT]:
        """Return the smallest tasks that do the same; the task itself where it cannot be split."""

    def lost(self, task: TaskT, reason: str) -> ResultT_co:
        """Return what stands for the result of a task, one of `split`, that ends every process it is given to."""


Run = Callable[[Job[Any, Any], Iterable[Any]], Iterator[tuple[Any, Any]]]


@dataclass(frozen=True)
class Engine:
    """Where tasks are done. The results are the same wherever, but for the order they come in."""

    n_workers: int | None = None  # processes on this machine, as many as processors if None; 1: this process
    scheduler: str | None = None  # address of a dask scheduler instead; for its workers all paths must be the same
    warn: Callable[[str], None] | None = field(default=None, compare=False)  # of what is waited for

    def __post_init__(self) -> None:
        if self.n_workers is not None and (self.scheduler is not None or self.n_workers < 1):
            raise OptionError(
                "Expected either at least one worker on this machine or the address of a scheduler, got"
                f" {self.n_workers} and {self.scheduler}. Leave out --workers or --scheduler."
            )
        if self.scheduler is not None and find_spec("distributed") is None:
            raise MissingExtraError(
                "Expected dask.distributed for workers of a cluster, but it is not installed:"
                " pip install 'maxcon[engine]'"
            )

    @property
    def is_in_process(self) -> bool:
        """Whether all is done in this process."""
        return self.scheduler is None and self.n_local(n_processors() + 1) == 1

    def n_local(self, n_tasks: int) -> int:
        """Return how many processes of this machine do so many tasks; 0 where others do them."""
        return 0 if self.scheduler is not None else min(self.n_workers or n_processors(), max(1, n_tasks))

    def run(self, job: Job[TaskT, ResultT], tasks: Iterable[TaskT], n_tasks: int) -> Iterator[tuple[TaskT, ResultT]]:
        """Yield each task with its result as it is done, in any order; a task may come back as the parts it splits to.

        A worker that ends is replaced, and its tasks are done anew. A task that ends four in turn is split once all
        else is done, and each part tried alone; one that again ends four has the result of the job for lost ones.
        """
        with self.started(n_tasks) as run:
            yield from run(job, tasks)

    @contextmanager
    def started(self, n_tasks: int) -> Iterator[Run]:
        """Yield what runs one job after another as `run` does, with the same workers."""
        n_local = self.n_local(n_tasks)
        if n_local == 1:
            yield _here
            return
        if n_local:
            started: AbstractContextManager[Any] = Processes(n_local)
        else:
            from maxcon._system.cluster import joined_cluster

            started = joined_cluster(str(self.scheduler), close_jobs, self.warn)
        with started as workers:
            yield lambda job, tasks: _results(workers, job, tasks)


def _here(job: Job[TaskT, ResultT], tasks: Iterable[TaskT]) -> Iterator[tuple[TaskT, ResultT]]:
    """Do the tasks in this process, one after the other."""
    from threadpoolctl import threadpool_limits

    work = None
    for task in tasks:
        with threadpool_limits(1):  # as in a worker: sums of other threads may differ in their last bit
            work = work or job.open()
            result = work(task)
        yield task, result


def _results(workers: Any, job: Job[Any, Any], tasks: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield each task, or the parts of one that was split, with its result from `Processes` or a `Cluster`."""
    opening = Opening(uuid.uuid4().hex, job)
    suspects: list[Any] = []
    lost: list[Any] = []
    yield from _done(workers, opening, tasks, suspects, None)
    parts = chain.from_iterable(map(job.split, suspects))  # ended by one of them, or by what was at work beside it
    yield from _done(workers, opening, parts, lost, 1)
    for task in lost:
        yield task, job.lost(task, LOST)


def _done(
    workers: Any, opening: "Opening", tasks: Iterable[Any], suspects: list[Any], n_ahead: int | None
) -> Iterator[tuple[Any, Any]]:
    """Yield tasks with their results as they are done; append those to `suspects` that end their workers."""
    waiting = iter(tasks)
    begun: dict[Future[Any], tuple[Any, int]] = {}
    while True:
        for task in islice(waiting, max(0, (n_ahead or workers.n_ahead) - len(begun))):
            begun[workers.submit(do_task, opening, task)] = task, 0
        if not begun:
            return
        ended, _ = wait(begun, LOOK_EVERY, FIRST_COMPLETED)
        if not ended and (what := workers.gone()):
            raise _gone(what)
        for future in ended:
            task, n_deaths = begun.pop(future)
            try:
                result = future.result()
            except workers.lost:
                if n_deaths < workers.allowed_deaths:
                    begun[workers.submit(do_task, opening, task)] = task, n_deaths + 1
                else:
                    suspects.append(task)
                continue
            except CancelledError as error:
                raise _gone("the scheduler is gone") from error
            yield task, result


def _gone(what: str) -> MaxconError:
    return MaxconError(f"Expected the workers to live on, but {what}. What is done is kept: the same command goes on.")


_one_at_a_time = threading.Lock()  # opened jobs are used by one thread, however many a worker was started with


@dataclass(frozen=True, slots=True)
class Opening:
    """A job, known by the word that was made for it when it began, and the version of the maxcon that asks for it."""

    token: str
    job: Job[Any, Any] = field(compare=False)
    version: str = field(default=__version__, compare=False)


def do_task(opening: Opening, task: Any) -> Any:
    """Do a task; its job is opened when the first one comes, and kept for those that follow."""
    from threadpoolctl import threadpool_limits

    with _one_at_a_time, threadpool_limits(1):
        return _opened(opening)(task)


def close_jobs() -> None:
    """Let go of what is open in this process: a worker may outlive the job by weeks."""
    with _one_at_a_time:
        _opened.cache_clear()


@lru_cache(maxsize=MOST_JOBS)
def _opened(opening: Opening) -> Callable[[Any], Any]:
    if opening.version != __version__:  # its rows would not be the same
        raise OptionError(
            f"Expected workers with maxcon {opening.version}, as here, got one with {__version__}. Install the same"
            " everywhere."
        )
    return opening.job.open()


class Processes:
    """A pool of processes of this machine, begun anew when one of them ends."""

    lost = BrokenProcessPool
    allowed_deaths = ALLOWED_DEATHS

    def __init__(self, n_workers: int) -> None:
        self.n_ahead = 2 * n_workers
        self._n_workers = n_workers
        self._pool = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._n_workers, multiprocessing.get_context("spawn"), _begin_worker)

    def submit(self, *call: Any) -> Future[Any]:
        """Let one of them do a task."""
        try:
            return self._pool.submit(*call)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = self._begun()
            return self._pool.submit(*call)

    def gone(self) -> str:
        """Say nothing: a process that ends breaks the pool, and its futures say so."""
        return ""

    def __enter__(self) -> Self:
        try:
            self._pool.submit(n_processors).result()
        except BrokenProcessPool as error:
            raise MaxconError(
                f"Expected {self._n_workers} worker processes to start, got: {error} A script needs its last lines"
                ' behind if __name__ == "__main__"; or memory is short: take fewer --workers.'
            ) from error
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:  # nobody waits for what is in work
            for process in list((self._pool._processes or {}).values()):
                process.terminate()
        self._pool.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    """Leave interrupts of the terminal to the caller, and end with it, however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end_with_parent() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def in_threads(work: Callable[[TaskT], ResultT], items: Iterable[TaskT], n_threads: int) -> Iterator[ResultT]:
    """Yield what threads of this process make of each item, in their order; with one thread, this one makes it."""
    if n_threads == 1:
        yield from map(work, items)
        return
    pool = ThreadPoolExecutor(n_threads)
    try:
        yield from ordered_map(pool, work, items, 2 * n_threads)
    finally:
        pool.shutdown(cancel_futures=True)


def ordered_map(
    pool: ThreadPoolExecutor, work: Callable[[TaskT], ResultT], items: Iterable[TaskT], n_ahead: int
) -> Iterator[ResultT]:
    """Yield what is made of each item, in their order; at most `n_ahead` are begun before the first is asked for."""
    begun: deque[Future[ResultT]] = deque()
    for item in items:
        begun.append(pool.submit(work, item))
        if len(begun) >= n_ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


def in_order_of(items: Iterable[TaskT], results: Iterable[tuple[TaskT, ResultT]]) -> Iterator[ResultT]:
    """Yield the results of items, which come with them in any order, in the order of the items; early ones wait."""
    early: dict[TaskT, ResultT] = {}
    coming = iter(results)
    for item in items:
        while item not in early:
            done, result = next(coming)
            early[done] = result
        yield early.pop(item)
    deque(coming, maxlen=0)  # let it end
