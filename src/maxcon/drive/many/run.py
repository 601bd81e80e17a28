# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localizing many drives: an engine localizes the epochs that a dataset lacks, and rows are written as they come."""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maxcon._system.engine import Engine
from maxcon._system.progress import Progress
from maxcon._system.resumable import work_folder
from maxcon._system.version import __version__
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.many.job import DriveTask, ManyDrivesJob
from maxcon.drive.many.made_with import OPTIONS, check_options, check_sources
from maxcon.drive.many.poses_dataset import PosesDataset
from maxcon.drive.many.table import DriveEntry
from maxcon.errors import MaxconError
from maxcon.estimate import Status

__all__ = ["EPOCHS_PER_TASK", "Localized", "localize_drives", "tasks_of"]

# Neighbouring epochs need the same tiles; but all of a task are lost when its worker ends.
EPOCHS_PER_TASK = 32


@dataclass(frozen=True, slots=True)
class Localized:
    """Summary of a run over many drives.

    Parameters
    ----------
    n_drives, n_epochs, n_localized : int
        Drives in the dataset, their epochs, and those of them with the status "localized".
    n_new : int
        Epochs localized by this call.
    refused : dict of str to str
        Why a drive cannot be localized, by its name.
    """

    n_drives: int
    n_epochs: int
    n_localized: int
    n_new: int
    refused: dict[str, str]


def localize_drives(
    entries: Sequence[DriveEntry],
    job: ManyDrivesJob,
    out: str | os.PathLike[str],
    engine: Engine | None = None,
    progress: Progress | None = None,
) -> Localized:
    """Localize drives into a Parquet dataset; drives and epochs that it has already are not localized again.

    Parameters
    ----------
    entries : sequence of DriveEntry
        The drives.
    job : ManyDrivesJob
        How they are localized.
    out : path
        Folder of the dataset; made if it is not there.
    engine : Engine, optional
        Who does the work; all processors of this machine if None.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Localized
        A drive that cannot be localized is in `refused`; the others are localized all the same.

    Raises
    ------
    FileError, OptionError
        If the folder cannot be written, holds something else, or was made with other options.
    """
    from maxcon.drive.many.description import (
        describe,  # with all that a study needs, which one drive does not
    )

    dataset, engine = PosesDataset(Path(out)), engine or Engine()
    with work_folder(dataset.folder, "poses of drives", OPTIONS):
        check_options(dataset, {"maxcon": __version__, "options": describe(job.opener)})
        check_sources(dataset, entries)
        return _Run(entries, job, dataset, engine, progress).localized()


def tasks_of(entry: DriveEntry, epochs: Iterable[int], is_track: bool = False) -> Iterator[DriveTask]:
    """Yield tasks for some epochs of a drive: runs of consecutive ones; a tracked drive is a single task."""
    run: list[int] = []
    for epoch in epochs:
        is_end = run and (epoch != run[-1] + 1 or (epoch % EPOCHS_PER_TASK == 0 and not is_track))
        if is_end:
            yield DriveTask(entry, run[0], run[-1] + 1)
            run = []
        run.append(epoch)
    if run:
        yield DriveTask(entry, run[0], run[-1] + 1)


class _Run:
    """State of one call of `localize_drives`: the drives begun, and how many of their epochs are missing."""

    def __init__(
        self,
        entries: Sequence[DriveEntry],
        job: ManyDrivesJob,
        dataset: PosesDataset,
        engine: Engine,
        progress: Progress | None,
    ) -> None:
        self._entries = entries
        self._job = job
        self._dataset = dataset
        self._engine = engine
        self._report = progress or (lambda step, done, total: None)
        self._n_missing: dict[str, int] = {}
        self._refused: dict[str, str] = {}
        self._n_new = self._n_epochs = 0

    def localized(self) -> Localized:
        """Localize what is missing, and summarize the dataset."""
        todo = [entry for entry in self._entries if not self._dataset.is_done(entry.name)]
        for entry in self._entries:
            if self._dataset.is_done(entry.name):
                self._dataset.clear(entry.name)  # a call may have been killed after it had put it there
        if todo:
            for task, found in self._engine.run(self._job, self._tasks(todo), sys.maxsize):
                self._keep(task.entry.name, found)
        statuses = {
            entry.name: self._dataset.statuses(entry.name)
            for entry in self._entries
            if self._dataset.is_done(entry.name)
        }
        n_localized = sum(found.count(Status.LOCALIZED.value) for found in statuses.values())
        n_epochs = sum(map(len, statuses.values()))
        return Localized(len(statuses), n_epochs, n_localized, self._n_new, self._refused)

    def _tasks(self, entries: Iterable[DriveEntry]) -> Iterator[DriveTask]:
        """Yield tasks for the missing epochs of drives, opening one drive after the other."""
        for entry in entries:
            try:
                n_epochs = self._job.opened(entry).n_epochs
            except MaxconError as error:
                self._refused[entry.name] = str(error)
                continue
            is_track = self._job.opener.is_track
            rows = self._dataset.rows(entry.name)
            missing = np.setdiff1d(np.arange(n_epochs), rows.column("epoch").to_numpy()).tolist()
            if missing and is_track:
                missing = list(range(n_epochs))
            self._n_missing[entry.name] = len(missing)
            self._n_epochs += len(missing)
            if not missing:
                self._dataset.publish(entry.name, rows)
            yield from tasks_of(entry, missing, is_track)

    def _keep(self, name: str, found: list[EpochEstimate] | str) -> None:
        """Write the answers of a task; publish the drive with the last of them."""
        if isinstance(found, str):
            self._refused.setdefault(name, found)
            return
        self._dataset.add(name, found)
        self._n_new += len(found)
        self._n_missing[name] -= len(found)
        self._report("localizing", self._n_new, self._n_epochs)
        if self._n_missing[name] == 0 and name not in self._refused:
            self._dataset.publish(name, self._dataset.rows(name))
