# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The processes of a study: each opens the dataset once, and answers for a few epochs at a time."""

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING

from maxcon.errors import MaxconError
from maxcon.study.bench import Bench, BenchPlan
from maxcon.study.methods import StudyMethod
from maxcon.study.table import Row

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

__all__ = ["Task", "run_tasks"]

# Epochs waiting beyond those in work, per process: enough to keep it busy, few enough to stop at once.
TASKS_AHEAD = 2
# Libraries for linear algebra take all processors in every process if they are let.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

# The bench of a process and its methods; a pool has no other way to keep something between two tasks.
_bench: list[tuple[Bench, dict[str, StudyMethod]]] = []


@dataclass(frozen=True, slots=True)
class Task:
    """Some epochs of one prior, and the names of the methods that are to answer them."""

    prior: str
    epochs: tuple[int, ...]
    methods: tuple[str, ...]

    @property
    def n_rows(self) -> int:
        """How many rows it makes."""
        return len(self.epochs) * len(self.methods)


def run_tasks(
    tasks: Sequence[Task], plan: BenchPlan, methods: Sequence[StudyMethod], n_workers: int
) -> Iterator[list[Row]]:
    """Yield the rows of each task as it is done, in any order.

    The methods go to each process once and stay there: what they keep of the map serves the epochs that follow.

    Raises
    ------
    MaxconError
        If a process ended by itself: out of memory, most often. What was yielded is good.
    """
    waiting, context = iter(tasks), get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    with _one_thread_each(), held:
        executor = ProcessPoolExecutor(
            n_workers, context, initializer=_open_bench, initargs=(lifeline, plan, tuple(methods))
        )
        running: dict[Future[list[Row]], Task] = {}
        try:
            while True:
                with _interrupts_held_back():
                    for task in waiting:
                        running[executor.submit(_work, task)] = task
                        if len(running) >= TASKS_AHEAD * n_workers:
                            break
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    rows = future.result()
                    del running[future]
                    yield rows
        except BrokenProcessPool as error:
            epochs = sorted({epoch for task in running.values() for epoch in task.epochs})
            raise MaxconError(
                "Expected the processes of the study to live on, but one ended by itself, at work on epochs"
                f' {", ".join(map(str, epochs))}. A script needs its last lines behind if __name__ == "__main__", and a'
                " method a class in a module; else a method crashes there, or memory is short: take fewer --workers."
                " What is done is kept."
            ) from error
        finally:
            if running:  # an error or a signal: nobody waits for what is in work, its rows are made anew
                held.close()
            executor.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Let processes started here never hear what comes from the terminal: the parent answers it, a little later."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes started here use one thread each: they are as many as processors already."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _open_bench(lifeline: "Connection", plan: BenchPlan, methods: tuple[StudyMethod, ...]) -> None:
    """Make a new process ready."""
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    _bench.append((plan.open(), {method.name: method for method in methods}))
    _warm_up()


def _end_with(lifeline: "Connection") -> None:
    """End this process when the parent lets go of the other end, or is killed: it would wait for tasks forever."""
    try:
        lifeline.recv_bytes()
    except EOFError:
        os._exit(1)


def _warm_up() -> None:
    """Load what is compiled at first use, so that it is not charged to the first epoch."""
    from maxcon.maximum_consensus import MaximumConsensus
    from maxcon.warmup import SPACE, search_room

    search_room(
        MaximumConsensus(
            SPACE, multiplicity=multiplicity, search="exhaustive"
        )  # what a study looks at: all cells
        for multiplicity in ("points", "occupied")
    )


def _work(task: Task) -> list[Row]:
    """Rows of a task, in a process of the pool."""
    ((bench, known),) = _bench
    methods = [known[name] for name in task.methods]
    return [row for epoch in task.epochs for row in bench.evaluate(task.prior, epoch, methods)]
