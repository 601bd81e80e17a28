# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Many drives: their table, their epochs as tasks of an engine, and the run that writes what a dataset lacks."""

import csv
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Protocol

import msgspec
import numpy as np

from maxcon._system.checked import checked, read_toml
from maxcon._system.engine import Engine
from maxcon._system.progress import Progress
from maxcon._system.regular_file import read_regular
from maxcon._system.resumable import work_folder
from maxcon._system.version import __version__
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.poses_dataset import OPTIONS, PosesDataset, describe
from maxcon.errors import FileError, MaxconError
from maxcon.estimate import Status
from maxcon.map import PointMap

WHAT = "a table of drives"
ADVICE = (
    "Give each a name (letters, digits, . _ + -: a folder is named by it), scans and, where needed, prior, map, times,"
    " odometry"
)
LARGEST_TABLE = 2**28
"""Bytes: a million drives."""
EPOCHS_PER_TASK = 32
"""Neighbouring epochs need the same tiles; but all of a task are lost when its worker ends."""
MOST_MAPS, MOST_DRIVES = 4, 2
"""Most maps, and most drives, that a worker keeps open."""


# --- the table of drives --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class DriveEntry:
    """Where the parts of a drive are.

    name: different from that of all other drives.
    scans: a folder, or a recording.
    map: the map it is localized in: a folder, or a URL.
    prior, times, odometry: as `maxcon localize` takes them.
    """

    name: str
    scans: Path
    map: Path | str
    prior: Path | None = None
    times: Path | None = None
    odometry: Path | None = None


class _Row(msgspec.Struct, forbid_unknown_fields=True):
    """A row of a table of drives; a folder is named by its name."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._+-]{0,99}$")]
    scans: Annotated[str, msgspec.Meta(min_length=1)]
    prior: str = ""
    map: str = ""
    times: str = ""
    odometry: str = ""


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    drive: Annotated[list[_Row], msgspec.Meta(min_length=1)]


def read_drives(path: str | os.PathLike[str], map_folder: Path | str | None = None) -> list[DriveEntry]:
    """Return the drives of a table; paths in it are relative to its folder.

    path: CSV with a header, of `name`, `scans` and, as far as needed, `prior`, `map`, `times`, `odometry`; or TOML with
        a table `[[drive]]` of the same keys for each.
    map_folder: the map of drives that name none.
    """
    file = Path(path)
    values = read_toml(file, WHAT, ADVICE) if file.suffix.lower() == ".toml" else {"drive": _csv_rows(file)}
    rows = checked(values, _Table, file, WHAT, ADVICE).drive
    seen: set[str] = set()
    for row in rows:
        folded = row.name.casefold()  # some file systems do not tell case apart
        if folded in seen:
            raise FileError(f"Expected a name of its own for each drive in {file}, got {row.name!r} twice. Rename one.")
        seen.add(folded)
    return [_entry(file, row, map_folder) for row in rows]


def _csv_rows(file: Path) -> list[dict[str, str]]:
    try:
        content = read_regular(file, LARGEST_TABLE + 1)
        if len(content) > LARGEST_TABLE:
            raise ValueError(f"it has more than {LARGEST_TABLE:,} bytes")
        lines = content.decode("utf-8-sig").splitlines()
        lines = [line for line in lines if line.strip() and not line.startswith("#")]
        header, *rows = list(csv.reader(lines, strict=True)) or [[]]
        names = [name.strip() for name in header]
        if len(set(names)) < len(names):
            raise ValueError(f"a column twice: {', '.join(names)}")
        for number, row in enumerate(rows, 1):
            if len(row) != len(names):
                raise ValueError(
                    f"{len(row)} columns in row {number} below a header of {len(names)}; a comma in a path stands in"
                    " quotation marks"
                )
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileError(f"Expected {WHAT} in {file}, got: {reason}. Write a CSV or TOML file.") from error
    return [dict(zip(names, (cell.strip() for cell in row), strict=True)) for row in rows]


def _entry(file: Path, row: _Row, map_folder: Path | str | None) -> DriveEntry:
    def path(place: str) -> Path | None:
        return file.parent.absolute() / place if place else None

    own_map = row.map if "://" in row.map else path(row.map) or map_folder
    if own_map is None:
        raise FileError(f"Expected a map for drive {row.name} in {file}, got none. Name it there, or one MAP for all.")
    scans = file.parent.absolute() / row.scans
    return DriveEntry(row.name, scans, own_map, path(row.prior), path(row.times), path(row.odometry))


# --- epochs of drives as tasks --------------------------------------------------------------------------------


class OpenedDrive(Protocol):
    """A drive that is open, with its map, ready to be localized."""

    @property
    def n_epochs(self) -> int:
        """How many scans it has."""
        ...

    def estimates(self, first: int, last: int) -> Iterator[EpochEstimate]:
        """Localize the epochs from `first` up to, not including, `last`."""
        ...

    def failed(self, epoch: int, reason: str) -> EpochEstimate:
        """Return the answer for an epoch whose worker ended before it was done, with the reason."""
        ...


class OpensDrives(Protocol):
    """Opens maps and drives with the options of localization; it is sent to the workers."""

    @property
    def is_track(self) -> bool:
        """Whether an epoch needs those before it, so that a drive is one task."""
        ...

    def open_map(self, path: Path | str) -> PointMap:
        """Open a map."""
        ...

    def open(self, entry: DriveEntry, point_map: PointMap) -> OpenedDrive:
        """Open a drive in its map."""
        ...


@dataclass(frozen=True, slots=True)
class DriveTask:
    """The epochs of a drive from `first` up to, not including, `last`."""

    entry: DriveEntry
    first: int
    last: int


def tasks_of(entry: DriveEntry, epochs: Iterable[int], is_track: bool = False) -> Iterator[DriveTask]:
    """Yield tasks for some epochs of a drive: runs of consecutive ones; a tracked drive is a single task."""
    run: list[int] = []
    for epoch in epochs:
        if run and (epoch != run[-1] + 1 or (epoch % EPOCHS_PER_TASK == 0 and not is_track)):
            yield DriveTask(entry, run[0], run[-1] + 1)
            run = []
        run.append(epoch)
    if run:
        yield DriveTask(entry, run[0], run[-1] + 1)


@dataclass(frozen=True)
class ManyDrivesJob:
    """The work on a `DriveTask`: estimates of its epochs, without points, or why its drive cannot be localized."""

    opener: OpensDrives
    name: str = "epochs"

    def __reduce__(self) -> tuple[Any, ...]:
        return ManyDrivesJob, (self.opener, self.name)  # what is open stays in its process

    def open(self) -> Callable[[DriveTask], list[EpochEstimate] | str]:
        """Return the function that localizes a task; maps and drives are opened when first needed, and kept."""

        def localize(task: DriveTask) -> list[EpochEstimate] | str:
            try:
                estimates = self.opened(task.entry).estimates(task.first, task.last)
                return [epoch.without_points() for epoch in estimates]
            except MaxconError as error:  # the other drives go on
                return str(error)

        return localize

    @cached_property
    def opened(self) -> Callable[[DriveEntry], OpenedDrive]:
        """Return the drive of an entry, opened now or before."""
        map_of = lru_cache(MOST_MAPS)(self.opener.open_map)
        return lru_cache(MOST_DRIVES)(lambda entry: self.opener.open(entry, map_of(entry.map)))

    def split(self, task: DriveTask) -> Sequence[DriveTask]:
        """Return a task for each epoch; a track cannot be split."""
        if self.opener.is_track:
            return [task]
        return [DriveTask(task.entry, epoch, epoch + 1) for epoch in range(task.first, task.last)]

    def lost(self, task: DriveTask, reason: str) -> list[EpochEstimate]:
        """Return the answers for a task whose worker ended before it was done, with the reason."""
        drive = self.opened(task.entry)
        return [drive.failed(epoch, reason) for epoch in range(task.first, task.last)]


# --- a run ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Localized:
    """Summary of a run over many drives.

    n_drives, n_epochs, n_localized: drives in the dataset, their epochs, and those of them with the status "localized".
    n_new: epochs localized by this call.
    refused: why a drive cannot be localized, by its name.
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

    A drive that cannot be localized is in `refused`; the others are localized all the same. FileError or OptionError if
    the folder cannot be written, holds something else, or was made with other options.

    entries: the drives.
    job: how they are localized.
    out: folder of the dataset; made if it is not there.
    engine: who does the work; all processors of this machine if None.
    progress: called with (step, done, of how many).
    """
    dataset = PosesDataset(Path(out))
    with work_folder(dataset.folder, "poses of drives", OPTIONS):
        dataset.check_options({"maxcon": __version__, "options": describe(job.opener)})
        sources = {entry.name: asdict(entry) for entry in entries}
        for source in sources.values():
            del source["name"]
        dataset.check_sources(sources)
        return _Run(entries, job, dataset, progress or (lambda step, done, total: None)).localized(engine or Engine())


class _Run:
    """One call of `localize_drives`: the drives begun, and how many of their epochs are missing."""

    def __init__(
        self, entries: Sequence[DriveEntry], job: ManyDrivesJob, dataset: PosesDataset, report: Progress
    ) -> None:
        self._entries = entries
        self._job = job
        self._dataset = dataset
        self._report = report
        self._n_missing: dict[str, int] = {}
        self._refused: dict[str, str] = {}
        self._n_new = self._n_epochs = 0

    def localized(self, engine: Engine) -> Localized:
        """Localize what is missing, and summarize the dataset."""
        todo = []
        for entry in self._entries:
            if self._dataset.is_done(entry.name):
                self._dataset.clear(entry.name)  # a call may have been killed after it had put it there
            else:
                todo.append(entry)
        if todo:
            for task, found in engine.run(self._job, self._tasks(todo), sys.maxsize):
                self._keep(task.entry.name, found)
        done = [entry.name for entry in self._entries if self._dataset.is_done(entry.name)]
        statuses = [status for name in done for status in self._dataset.statuses(name)]
        n_localized = statuses.count(Status.LOCALIZED.value)
        return Localized(len(done), len(statuses), n_localized, self._n_new, self._refused)

    def _tasks(self, entries: Iterable[DriveEntry]) -> Iterator[DriveTask]:
        """Yield tasks for the missing epochs of drives, opening one drive after the other."""
        is_track = self._job.opener.is_track
        for entry in entries:
            try:
                n_epochs = self._job.opened(entry).n_epochs
            except MaxconError as error:
                self._refused[entry.name] = str(error)
                continue
            there = self._dataset.rows(entry.name).column("epoch").to_numpy()
            missing = np.setdiff1d(np.arange(n_epochs), there).tolist()
            if missing and is_track:
                missing = list(range(n_epochs))
            self._n_missing[entry.name] = len(missing)
            self._n_epochs += len(missing)
            if not missing:
                self._dataset.publish(entry.name)
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
            self._dataset.publish(name)
