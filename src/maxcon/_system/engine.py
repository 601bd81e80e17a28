# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Engine: where tasks are done, in this process, in several of this machine, or on a dask cluster."""

import multiprocessing
import os
import signal
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any, Protocol, Self, TypeVar

from maxcon._system.job import Job, Opening, do_task, workers_gone
from maxcon.errors import MaxconError, OptionError

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")

Run = Callable[[Job[Any, Any], Iterable[Any]], Iterator[tuple[Any, Any]]]
"""Runs a job."""

ALLOWED_DEATHS = 3
"""Times that a task may end its worker and is tried again; four in turn are no accident."""
LOST = "each worker that was given it ended: it crashes, or memory is short"
LOOK_EVERY = 1.0
"""s between looks at whether the workers live, while no result comes."""


def n_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _nobody(line: str) -> None:
    pass


@dataclass(frozen=True)
class Engine:
    """Where tasks are done. The results are the same wherever, but for the order they come in.

    n_workers: processes on this machine; with one, all is done in this process. As many as there are processors if
        None.
    scheduler: address of a dask scheduler, as tcp://HOST:8786, instead: its workers do the tasks. All that they need
        must have the same paths for them.
    warn: called with a line for the user: what is waited for.
    """

    n_workers: int | None = None
    scheduler: str | None = None
    warn: Callable[[str], None] = field(default=_nobody, compare=False)

    def __post_init__(self) -> None:
        if self.n_workers is not None and self.scheduler is not None:
            raise OptionError(
                "Expected either a number of workers on this machine or the address of a scheduler, got both. Leave out"
                " --workers or --scheduler."
            )
        if self.n_workers is not None and self.n_workers < 1:
            raise OptionError(
                f"Expected at least one process, got {self.n_workers}. Leave it out for one per processor."
            )
        if self.scheduler is not None:
            from maxcon._system.cluster import check_dask

            check_dask()

    @property
    def is_in_process(self) -> bool:
        """Whether all is done in this process."""
        return self.scheduler is None and self.n_local(n_processors() + 1) == 1

    def n_local(self, n_tasks: int) -> int:
        """Return how many processes of this machine do so many tasks; 0 where others do them."""
        return 0 if self.scheduler is not None else min(self.n_workers or n_processors(), max(1, n_tasks))

    def run(self, job: Job[TaskT, ResultT], tasks: Iterable[TaskT], n_tasks: int) -> Iterator[tuple[TaskT, ResultT]]:
        """Yield each task with its result as it is done, in any order; a task may come back as the parts it splits to.

        A worker that ends is replaced, and its tasks are done anew. A task that ends four in turn is split once
        everything else is done, and each part is tried alone; a part that again ends four has the result that the
        job gives for lost ones.

        job: what is to be done.
        tasks: taken as workers become free.
        n_tasks: how many there are, or may be: no more processes are started.
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
            started: AbstractContextManager[Workers] = Processes(n_local)
        else:
            from maxcon._system.cluster import joined_cluster

            started = joined_cluster(str(self.scheduler), self.warn)
        with started as workers:
            yield lambda job, tasks: _results(workers, job, tasks)


# --- one job --------------------------------------------------------------------------------------------------


def _here(job: Job[TaskT, ResultT], tasks: Iterable[TaskT]) -> Iterator[tuple[TaskT, ResultT]]:
    """Do the tasks in this process, one after the other."""
    from threadpoolctl import threadpool_limits

    work = None
    for task in tasks:
        with threadpool_limits(1):  # as in a worker: sums of other threads may differ in their last bit
            work = work or job.open()
            result = work(task)
        yield task, result


class Workers(Protocol):
    """Processes that do tasks, here or elsewhere."""

    lost: type[Exception]
    """Raised by the future of a task whose worker ended."""
    allowed_deaths: int
    """Times that such a task is submitted again."""

    @property
    def n_ahead(self) -> int:
        """Tasks to submit before the first is done: enough to keep all busy, few enough to stop at once."""
        ...

    def submit(self, opening: Opening, task: Any) -> Future[Any]:
        """Let one of them do a task."""
        ...

    def check(self) -> None:
        """Refuse to wait any longer where none is left; MaxconError if so."""
        ...


def _results(workers: Workers, job: Job[Any, Any], tasks: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield each task, or the parts of one that was split, with its result."""
    opening = Opening(uuid.uuid4().hex, job)
    suspects: list[Any] = []
    lost: list[Any] = []
    yield from _done(workers, opening, tasks, suspects)
    parts = chain.from_iterable(map(job.split, suspects))  # ended by one of them, or by what was at work beside it
    yield from _done(workers, opening, parts, lost, n_ahead=1)
    for task in lost:
        yield task, job.lost(task, LOST)


def _done(
    workers: Workers, opening: Opening, tasks: Iterable[Any], suspects: list[Any], n_ahead: int | None = None
) -> Iterator[tuple[Any, Any]]:
    """Yield tasks with their results as they are done; append those to `suspects` that end their workers."""
    waiting = iter(tasks)
    begun: dict[Future[Any], tuple[Any, int]] = {}
    while True:
        for task in islice(waiting, max(0, (n_ahead or workers.n_ahead) - len(begun))):
            begun[workers.submit(opening, task)] = task, 0
        if not begun:
            return
        ended, _ = wait(begun, LOOK_EVERY, FIRST_COMPLETED)
        if not ended:
            workers.check()
        for future in ended:
            task, n_deaths = begun.pop(future)
            try:
                result = future.result()
            except workers.lost:
                if n_deaths < workers.allowed_deaths:
                    begun[workers.submit(opening, task)] = task, n_deaths + 1
                else:
                    suspects.append(task)
                continue
            except CancelledError as error:
                raise workers_gone("the scheduler is gone") from error
            yield task, result


# --- processes of this machine --------------------------------------------------------------------------------


class Processes:
    """A pool of processes of this machine, begun anew when one of them ends."""

    lost: type[Exception] = BrokenProcessPool
    allowed_deaths: int = ALLOWED_DEATHS

    def __init__(self, n_workers: int) -> None:
        self.n_ahead = 2 * n_workers
        self._n_workers = n_workers
        self._pool = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._n_workers, multiprocessing.get_context("spawn"), _begin_worker)

    def submit(self, opening: Opening, task: Any) -> Future[Any]:
        """Let one of them do a task."""
        try:
            return self._pool.submit(do_task, opening, task)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = self._begun()
            return self._pool.submit(do_task, opening, task)

    def check(self) -> None:
        """A process that ends breaks the pool, and its futures say so."""

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
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
