# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A study: methods x epochs of a dataset, on all processors, into one table; a stopped study can be continued."""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maxcon._system.engine import Engine
from maxcon._system.progress import Progress
from maxcon._system.resumable import work_folder
from maxcon.drive.localize import DriveOptions
from maxcon.errors import OptionError
from maxcon.io.scans import open_scans
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.dataset import Dataset
from maxcon.lab.study.bench import REFERENCE, BenchPlan, StudyJob, StudyTask
from maxcon.lab.study.configuration import CONFIGURATION, Configuration
from maxcon.lab.study.methods import StudyMethod, make_maps
from maxcon.lab.study.table import Key, TableParts, keys_of

if TYPE_CHECKING:
    import pyarrow

__all__ = ["Study", "run_study", "spread_epochs"]

# Consecutive epochs need the same tiles; but all rows of a task are lost when a study is stopped.
ROWS_PER_TASK = 3


@dataclass(frozen=True)
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
        """Open a study, done or not."""
        root = Path(folder)
        return cls(root, Configuration.read(root), TableParts(root).read())


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

    Parameters
    ----------
    dataset : Dataset
        Map, scans, reference and priors.
    folder : path
        Of the study; made if it is not there. More methods, priors or epochs can be added to a study later.
    methods : sequence of StudyMethod
        Each by a name of its own.
    priors : sequence of str, optional
        Names of the dataset's priors, or "reference" for the reference itself; all of the dataset's if None.
    n_epochs : int, optional
        So many of the dataset's scans, evenly spread; all if None.
    n_workers : int, optional
        Processes; as many as there are processors if None. With one, all is done in this process.
    options : DriveOptions, optional
        Range limits, and gaps of the trajectories to interpolate across.
    progress : callable, optional
        Called with (step, done, of how many).
    scheduler : str, optional
        Address of a dask scheduler, whose workers do it instead.
    warn : callable, optional
        Called with a line for the user: that the scheduler is waited for.

    Returns
    -------
    Study

    Raises
    ------
    OptionError
        If a prior or a number does not exist, or the folder holds a study made otherwise.
    FileError, MapError, TrajectoryError, CrsError, MissingExtraError
        If the dataset cannot be used, or the folder cannot be written.
    """
    root, options = Path(folder), options or DriveOptions()
    engine = Engine(n_workers, scheduler) if warn is None else Engine(n_workers, scheduler, warn)
    names = _checked(dataset, methods, priors)
    scans = open_scans(dataset.scans, dataset.times)
    numbers = spread_epochs(len(scans), n_epochs)
    wanted = Configuration.of(dataset, len(scans), options, methods)
    with work_folder(root, "a study", CONFIGURATION):
        parts = TableParts(root)
        done = set(keys_of(parts.read()))
        if (root / CONFIGURATION).exists():
            wanted = Configuration.read(root).joined(wanted, {method for _, method, _ in done})
        else:
            wanted.write(root)
        map_names = [method.map_name for method in methods]
        plan = BenchPlan(dataset, make_maps(dataset, root / "maps", map_names, progress), options)
        # Errors that concern all epochs are raised here, not in a worker.
        plan.open().check_times(names, numbers)
        tasks = _missing(methods, names, numbers, done)
        run = {"methods": [method.name for method in methods], "priors": names, "n_epochs": len(numbers)}
        run["n_workers"] = engine.n_local(len(tasks))
        wanted = wanted.with_run(run) if tasks else wanted
        wanted.write(root)
        _work_off(tasks, StudyJob(plan, tuple(methods)), engine, parts, wanted, progress)
        return Study(root, Configuration.read(root), parts.merge())


def _work_off(
    tasks: Sequence[StudyTask],
    job: StudyJob,
    engine: Engine,
    parts: TableParts,
    configuration: Configuration,
    progress: Progress | None,
) -> None:
    """Let the engine do the tasks; write their rows as they come, and the time that all took."""
    started, n_done, n_total = time.perf_counter(), 0, sum(task.n_rows for task in tasks)
    report = progress or (lambda step, done, total: None)
    if not tasks:
        return
    report("localizing", 0, n_total)
    for _, rows in engine.run(job, tasks, len(tasks)):
        parts.add(rows)
        n_done += len(rows)
        report("localizing", n_done, n_total)
        if n_done == n_total:
            seconds = round(time.perf_counter() - started, 1)
            configuration.runs[-1].update(n_rows=n_done, seconds=seconds)
            configuration.write(parts.folder)


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
