# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Engine: where tasks are done, by how many workers, and what is told of it."""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from maxcon._system.engine.cluster import check_dask, has_dask, joined_cluster, local_cluster
from maxcon._system.engine.crew import Crew
from maxcon._system.engine.job import Job
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Engine", "n_processors"]

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")

Run = Callable[[Job[Any, Any], Iterable[Any]], Iterator[tuple[Any, Any]]]
"""Runs a job."""


def n_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _nobody(line: str) -> None:
    pass


@dataclass(frozen=True)
class Engine:
    """Where tasks are done. The results are the same wherever, but for the order they come in.

    Parameters
    ----------
    n_workers : int, optional
        Processes on this machine; with one, all is done in this process. As many as there are processors if None; but
        one where the extra `engine` is not installed.
    scheduler : str, optional
        Address of a dask scheduler, as tcp://HOST:8786, instead: its workers do the tasks. All that they need must have
        the same paths for them.
    tell : callable, optional
        Called with a line for the user: where a browser finds the dashboard.
    warn : callable, optional
        Called with a line for the user: what is waited for.

    Raises
    ------
    OptionError
        If both are given, or there is less than one worker.
    MissingExtraError
        If dask is needed and not installed.
    """

    n_workers: int | None = None
    scheduler: str | None = None
    tell: Callable[[str], None] = field(default=_nobody, compare=False)
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
        if self.scheduler is not None or (self.n_workers or 1) > 1:
            check_dask()

    @property
    def is_in_process(self) -> bool:
        """Whether all is done in this process."""
        return self.scheduler is None and self.n_local(n_processors() + 1) == 1

    def n_local(self, n_tasks: int) -> int:
        """Return how many processes of this machine do so many tasks; 0 where others do them."""
        if self.scheduler is not None:
            return 0
        n_workers = self.n_workers or (n_processors() if has_dask() else 1)
        return min(n_workers, max(1, n_tasks))

    def run(self, job: Job[TaskT, ResultT], tasks: Iterable[TaskT], n_tasks: int) -> Iterator[tuple[TaskT, ResultT]]:
        """Yield each task with its result as it is done, in any order; a task may come back as the parts it splits to.

        A worker that ends is replaced, and its tasks are given to another one. A task that ends four in turn is split
        once everything else is done, and each part is tried alone; a part that again ends four has the result that the
        job gives for lost ones.

        Parameters
        ----------
        job : Job
            What is to be done.
        tasks : iterable
            Taken as workers become free.
        n_tasks : int
            How many there are, or may be: no more processes are started.

        Raises
        ------
        MaxconError
            What the job raises; or if workers do not start, or are gone.
        """
        with self.started(n_tasks) as run:
            yield from run(job, tasks)

    @contextmanager
    def started(self, n_tasks: int) -> "Iterator[Run]":
        """Yield what runs one job after another as `run` does, with the same workers.

        Parameters
        ----------
        n_tasks : int
            How many tasks the largest job has, or may have: no more processes are started.

        Raises
        ------
        MaxconError
            If workers do not start.
        """
        n_local = self.n_local(n_tasks)
        if n_local == 1:
            yield _here
        elif n_local:
            with local_cluster(n_local) as (client, cluster, dashboard):
                if dashboard:
                    self.tell(f"dashboard    {dashboard}")
                yield lambda job, tasks: Crew(client, job, cluster).results(tasks)
        else:
            with joined_cluster(str(self.scheduler), self.warn) as client:
                yield lambda job, tasks: _elsewhere(client, job, tasks)


def _elsewhere(client: "Client", job: Job[Any, Any], tasks: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Let the workers of a cluster that lives on do the tasks."""
    crew = Crew(client, job)
    try:
        yield from crew.results(tasks)
    finally:
        crew.dismiss()


def _here(job: Job[TaskT, ResultT], tasks: Iterable[TaskT]) -> Iterator[tuple[TaskT, ResultT]]:
    """Do the tasks in this process, one after the other."""
    from threadpoolctl import threadpool_limits

    work = None
    for task in tasks:
        with threadpool_limits(1):  # as in a worker: sums of other threads may differ in their last bit
            work = work or job.open()
            result = work(task)
        yield task, result
