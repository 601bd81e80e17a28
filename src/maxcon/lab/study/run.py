# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A study: methods x epochs of a dataset, on all processors, into one table; a stopped study can be continued."""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maxcon._system import Progress
from maxcon._system.engine import Engine
from maxcon._system.resumable import work_folder
from maxcon.drive.localize import DriveOptions
from maxcon.errors import OptionError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.bench import REFERENCE, Bench
from maxcon.lab.study.configuration import CONFIGURATION, Configuration, Run
from maxcon.lab.study.methods import StudyMethod, make_maps
from maxcon.lab.study.table import Key, Row, keys_of, table_of

if TYPE_CHECKING:
    import pyarrow

# Consecutive epochs need the same tiles; but all rows of a task are lost when a study is stopped.
ROWS_PER_TASK = 3


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """A study on disk.

    folder: holds study.json, table.parquet and maps/.
    configuration: what it was run with.
    table: a row per epoch, method and prior (`COLUMNS`).
    """

    folder: Path
    configuration: Configuration
    table: "pyarrow.Table"

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> "Study":
        """Open a study, done or not; FileError if there is none."""
        root = Path(folder)
        return cls(root, Configuration.read(root), table_of(root).read())


class StudyTask(NamedTuple):
    """Some epochs of one prior, and the names of the methods that are to answer them."""

    prior: str
    epochs: tuple[int, ...]
    methods: tuple[str, ...]

    @property
    def n_rows(self) -> int:
        """How many rows it makes."""
        return len(self.epochs) * len(self.methods)


@dataclass(frozen=True, slots=True)
class StudyJob:
    """The work on a `StudyTask`: rows of the table.

    The methods stay in each process, and with them what they keep of the map for later epochs.
    """

    dataset: Dataset
    maps: dict[str, Path]
    options: DriveOptions
    methods: tuple[StudyMethod, ...]

    def bench(self) -> Bench:
        """Open dataset and maps."""
        return Bench.open(self.dataset, self.maps, self.options)

    def open(self) -> Callable[[StudyTask], list[Row]]:
        """Open dataset and maps, load what is compiled, and return the function that does a task."""
        from maxcon.localizer import MaximumConsensus
        from maxcon.warmup import SPACE, search_room

        bench, known = self.bench(), {method.name: method for method in self.methods}
        search_room(  # what is compiled is not charged to the first epoch
            MaximumConsensus(SPACE, multiplicity=multiplicity, search="exhaustive")
            for multiplicity in ("points", "occupied")
        )

        def answer(task: StudyTask) -> list[Row]:
            methods = [known[name] for name in task.methods]
            return [row for epoch in task.epochs for row in bench.evaluate(task.prior, epoch, methods)]

        return answer

    def split(self, task: StudyTask) -> Sequence[StudyTask]:
        """Return a task for each row."""
        return [StudyTask(task.prior, (epoch,), (method,)) for epoch in task.epochs for method in task.methods]

    def lost(self, task: StudyTask, reason: str) -> list[Row]:
        """Return the rows of a task whose worker ended before it was done, with the reason."""
        bench, methods = self.bench(), [method for method in self.methods if method.name in task.methods]
        return [row for epoch in task.epochs for row in bench.failed(task.prior, epoch, methods, reason)]


def run_study(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    methods: Sequence[StudyMethod],
    *,
    priors: Sequence[str] | None = None,
    n_epochs: int | None = None,
    n_workers: int | None = None,
    options: DriveOptions | None = None,
    progress: Progress | None = None,
    scheduler: str | None = None,
    warn: Callable[[str], None] | None = None,
) -> Study:
    """Let methods localize epochs of a dataset; rows that are in the folder already are not made again.

    - dataset: map, scans, reference and priors.
    - folder: of the study; made if it is not there. More methods, priors or epochs can be added to a study later.
    - methods: each by a name of its own.
    - priors: names of the dataset's priors, or "reference" for the reference itself; all of the dataset's if None.
    - n_epochs: so many of the dataset's scans, evenly spread; all if None.
    - n_workers: processes; as many as there are processors if None. With one, all is done in this process.
    - options: range limits, and gaps of the trajectories to interpolate across.
    - progress: called with (step, done, of how many).
    - scheduler: address of a dask scheduler, whose workers do it instead.
    - warn: called with a line for the user: that the scheduler is waited for.

    OptionError if a prior or a number does not exist, or the folder holds a study made otherwise; FileError, MapError,
    TrajectoryError, CrsError or MissingExtraError if the dataset cannot be used, or the folder cannot be written.
    """
    root, options, report = Path(folder), options or DriveOptions(), progress or (lambda step, done, total: None)
    engine = Engine(n_workers, scheduler, warn)
    names = _checked(dataset, methods, priors)
    n_scans = len(dataset.open_scans())
    numbers = spread_epochs(n_scans, n_epochs)
    with work_folder(root, "a study", CONFIGURATION):
        table = table_of(root)
        done = set(keys_of(table.read()))
        configuration = Configuration.of(dataset, n_scans, options, methods)
        if (root / CONFIGURATION).exists():
            configuration = Configuration.read(root).joined(configuration, {method for _, method, _ in done})
        else:
            configuration.write(root)
        maps = make_maps(dataset, root / "maps", [method.map_name for method in methods], progress)
        job = StudyJob(dataset, maps, options, tuple(methods))
        job.bench().check_times(names, numbers)  # what concerns all epochs is raised here, not in a worker
        tasks = _missing(methods, names, numbers, done)
        run = Run(methods=[method.name for method in methods], priors=names, n_epochs=len(numbers))
        run["n_workers"] = engine.n_local(len(tasks))
        if tasks:
            configuration = replace(configuration, runs=[*configuration.runs, run])
        configuration.write(root)
        if tasks:
            started, n_done, n_total = time.perf_counter(), 0, sum(task.n_rows for task in tasks)
            report("localizing", 0, n_total)
            for _, rows in engine.run(job, tasks, len(tasks)):
                table.add(rows)
                n_done += len(rows)
                report("localizing", n_done, n_total)
            run["n_rows"], run["seconds"] = n_done, round(time.perf_counter() - started, 1)
            configuration.write(root)
        return Study(root, configuration, table.merge())


def spread_epochs(n_scans: int, n_epochs: int | None) -> list[int]:
    """Return `n_epochs` of the numbers of `n_scans` scans, evenly spread; all if None."""
    if n_epochs is None:
        return list(range(n_scans))
    if not 1 <= n_epochs <= n_scans:
        raise OptionError(f"Expected 1 to {n_scans} epochs, as the dataset has, got {n_epochs}. Take fewer.")
    return [int(number) for number in np.linspace(0, n_scans - 1, n_epochs).round()]


def _checked(dataset: Dataset, methods: Sequence[StudyMethod], priors: Sequence[str] | None) -> list[str]:
    """Return the names of the priors; refuse what is not there, before anything is made."""
    names = list(dict.fromkeys(dataset.priors if priors is None else priors))
    for name in names:
        if name not in (*dataset.priors, REFERENCE):
            raise OptionError(
                f"Expected a prior of {', '.join(dataset.priors)}, as {dataset.path} names them, or {REFERENCE}, got"
                f" {name!r}."
            )
    if not methods or len({method.name for method in methods}) < len(methods):
        raise OptionError("Expected at least one method, each with a name of its own. Rename one.")
    for method in methods:
        if method.needs_small_gicp:
            check_small_gicp()
    return names


def _missing(
    methods: Sequence[StudyMethod], priors: Iterable[str], numbers: Sequence[int], done: set[Key]
) -> list[StudyTask]:
    """Return what is still to do, a few epochs at a time that lack the same methods."""
    tasks: list[StudyTask] = []
    for prior in priors:
        for number in numbers:
            lacking = tuple(method.name for method in methods if (prior, method.name, number) not in done)
            if not lacking:
                continue
            last = tasks[-1] if tasks else None
            is_alike = last is not None and (last.prior, last.methods) == (prior, lacking)
            if last and is_alike and last.n_rows + len(lacking) <= ROWS_PER_TASK:
                tasks[-1] = StudyTask(prior, (*last.epochs, number), lacking)
            else:
                tasks.append(StudyTask(prior, (number,), lacking))
    return tasks
