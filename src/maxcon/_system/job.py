# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A job and its tasks, as workers are given them: opened when the first task comes, and kept for those that follow."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from maxcon._system.version import __version__
from maxcon.errors import MaxconError, OptionError

TaskT = TypeVar("TaskT")
ResultT_co = TypeVar("ResultT_co", covariant=True)

MOST_JOBS = 2
"""Kept open by a worker, with the tiles of their maps; two, for two who use the same cluster."""


class Job(Protocol[TaskT, ResultT_co]):
    """A kind of work: opened once by each process that takes part, and then asked for one task after the other.

    It travels to each process: paths, names and options, but no maps and no scans. A task that is done twice gives the
    same result twice.
    """

    @property
    def name(self) -> str:
        """What its tasks are called on dask's dashboard, in one word."""
        ...

    def open(self) -> Callable[[TaskT], ResultT_co]:
        """Open what the tasks need; return what does one of them."""
        ...

    def split(self, task: TaskT) -> Sequence[TaskT]:
        """Return the smallest tasks that do the same; the task itself where it cannot be split."""
        ...

    def lost(self, task: TaskT, reason: str) -> ResultT_co:
        """Return what stands for the result of a task, one of `split`, that ends every process it is given to."""
        ...


# What is opened is used by one thread at a time, however many threads a worker was started with.
_one_at_a_time = threading.Lock()


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


def workers_gone(what: str) -> MaxconError:
    """Return the error of workers that do not come back."""
    return MaxconError(f"Expected the workers to live on, but {what}. What is done is kept: the same command goes on.")
