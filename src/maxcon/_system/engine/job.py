# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is to be done, as workers are given it."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

__all__ = ["Job"]

TaskT = TypeVar("TaskT")
ResultT_co = TypeVar("ResultT_co", covariant=True)


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
