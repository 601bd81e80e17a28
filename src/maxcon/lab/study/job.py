# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A study as a job: each worker opens the dataset once, and answers for a few epochs at a time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from maxcon.lab.study.bench import BenchPlan
from maxcon.lab.study.methods import StudyMethod
from maxcon.lab.study.table import Row

__all__ = ["StudyJob", "StudyTask"]


@dataclass(frozen=True, slots=True)
class StudyTask:
    """Some epochs of one prior, and the names of the methods that are to answer them."""

    prior: str
    epochs: tuple[int, ...]
    methods: tuple[str, ...]

    @property
    def n_rows(self) -> int:
        """How many rows it makes."""
        return len(self.epochs) * len(self.methods)


@dataclass(frozen=True)
class StudyJob:
    """What the workers of a study do: rows of its table.

    plan: the dataset and maps that each worker opens.
    methods: they stay in each process, and with them what they keep of the map for later epochs.
    """

    plan: BenchPlan
    methods: tuple[StudyMethod, ...]
    name: str = "epochs"

    def open(self) -> Callable[[StudyTask], list[Row]]:
        """Open dataset and maps, and load what is compiled."""
        bench, known = self.plan.open(), {method.name: method for method in self.methods}
        _warm_up()

        def answer(task: StudyTask) -> list[Row]:
            methods = [known[name] for name in task.methods]
            return [row for epoch in task.epochs for row in bench.evaluate(task.prior, epoch, methods)]

        return answer

    def split(self, task: StudyTask) -> Sequence[StudyTask]:
        """Return a task for each row."""
        return [StudyTask(task.prior, (epoch,), (method,)) for epoch in task.epochs for method in task.methods]

    def lost(self, task: StudyTask, reason: str) -> list[Row]:
        """Return the row of an epoch whose worker ended before it was done, with the reason."""
        bench = self.plan.open()
        methods = [method for method in self.methods if method.name in task.methods]
        return [row for epoch in task.epochs for row in bench.failed(task.prior, epoch, methods, reason)]


def _warm_up() -> None:
    """Load what is compiled at first use, so that it is not charged to the first epoch."""
    from maxcon.localizer import MaximumConsensus
    from maxcon.warmup import SPACE, search_room

    search_room(
        MaximumConsensus(SPACE, multiplicity=multiplicity, search="exhaustive")  # what a study looks at: all cells
        for multiplicity in ("points", "occupied")
    )
