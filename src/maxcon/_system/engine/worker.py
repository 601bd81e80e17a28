# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What runs in a worker: a job is opened when its first task comes, and kept for those that follow."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from maxcon._system.engine.job import Job
from maxcon._system.version import __version__
from maxcon.errors import OptionError

__all__ = ["Errand", "Opening", "close_jobs"]

MOST_JOBS = 2
"""Kept open by a process, with the tiles of their maps; two, for two who use the same cluster."""

# What is opened is used by one thread at a time, however many threads a worker was started with.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class Opening:
    """A job, known by the word that was made for it when it began.

    Parameters
    ----------
    token : str
        The word.
    job : Job
        What is to be done.
    version : str
        Of the maxcon that asks for it.
    """

    token: str
    job: Job[Any, Any] = field(compare=False)
    version: str = field(default=__version__, compare=False)

    def open(self) -> Callable[[Any], Any]:
        """Open the job in this process.

        Raises
        ------
        OptionError
            If this process has another version of maxcon: its rows would not be the same.
        """
        if self.version != __version__:
            raise OptionError(
                f"Expected workers with maxcon {self.version}, as here, got one with {__version__}. Install the same"
                " everywhere."
            )
        return self.job.open()


@dataclass(frozen=True, slots=True)
class Errand:
    """One task of a job, on its way to a worker.

    Parameters
    ----------
    opening : Opening
        The job.
    task : object
        The task.
    """

    opening: Opening
    task: Any

    def __call__(self) -> Any:
        """Do it."""
        from threadpoolctl import threadpool_limits

        with _one_at_a_time, threadpool_limits(1):
            return _opened(self.opening)(self.task)


def close_jobs() -> None:
    """Let go of what is open in this process: a worker may outlive the job by weeks."""
    with _one_at_a_time:
        _opened.cache_clear()


@lru_cache(maxsize=MOST_JOBS)
def _opened(opening: Opening) -> Callable[[Any], Any]:
    return opening.open()
