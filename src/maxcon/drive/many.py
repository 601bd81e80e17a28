"""Many drives: their table, their epochs as tasks of an engine, and the run that writes what a dataset lacks."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Protocol

import msgspec
import numpy as np

from maxcon._system import Progress
from maxcon._system.checked import checked, read_toml
from maxcon._system.engine import Engine
from maxcon._system.resumable import describe, work_folder
from maxcon._system.version import __version__
from maxcon.drive.localize import EpochEstimate, failed_epoch
from maxcon.drive.poses_table import OPTIONS, PosesDataset
from maxcon.errors import FileError, MaxconError
from maxcon.estimate import Status
from maxcon.io.scans import Scans
from maxcon.io.text import read_pose_table
from maxcon.map import PointMap

WHAT = "a table of drives"
ADVICE = (
    "Give each a name (letters, digits, . _ + -: a folder is named by it), scans and, where needed, prior, map, times,"
    " odometry"
)
EPOCHS_PER_TASK = 32  # neighbouring epochs need the same tiles; but all of a task are lost when its worker ends
MOST_MAPS, MOST_DRIVES = 4, 2  # most maps, and most drives, that a worker keeps open


@dataclass(frozen=True, slots=True)
class DriveEntry:
    """Where the parts of a drive are; prior, times and odometry as `maxcon localize` takes them."""

    name: str  # different from that of all other drives
    scans: Path  # a folder, or a recording
    map: Path | str  # that it is localized in: a folder, or a URL
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
    """Return the drives of a table, CSV or TOML with [[drive]], paths relative to it; FileError if it is none."""
    file = Path(path)
    folder = file.parent.absolute()
    values = read_toml(file, WHAT, ADVICE) if file.suffix.lower() == ".toml" else {"drive": _csv_rows(file)}
    entries = dict[str, DriveEntry]()
    for row in checked(values, _Table, file, WHAT, ADVICE).drive:
        name = row.name.casefold()  # some file systems do not tell case apart
        if name in entries:
            raise FileError(f"Expected a name of its own for each drive in {file}, got {row.name!r} twice. Rename one.")
        prior, own_map, times, odometry = (
            folder / place if place else None for place in (row.prior, row.map, row.times, row.odometry)
        )
        map_ = row.map if "://" in row.map else own_map or map_folder
        if map_ is None:
            raise FileError(
                f"Expected a map for drive {row.name} in {file}, got none. Name it there, or one MAP for all."
            )
        entries[name] = DriveEntry(row.name, folder / row.scans, map_, prior, times, odometry)
    return list(entries.values())


def _csv_rows(file: Path) -> list[dict[str, str]]:
    table = read_pose_table(file, WHAT)
    if table.faults:
        raise FileError(table.told_faults()[0])
    return [dict(zip(table.names, row, strict=True)) for row in table.rows]


class OpenedDrive(Protocol):
    """A drive that is open, with its map, ready to be localized."""

    @property
    def scans(self) -> Scans:
        """Its scans."""

    def estimates(self, first: int, last: int) -> Iterator[EpochEstimate]:
        """Localize the epochs from `first` up to, not including, `last`."""


class OpensDrives(Protocol):
    """Opens maps and drives with the options of localization; it is sent to the workers."""

    @property
    def is_track(self) -> bool:
        """Whether an epoch needs those before it, so that a drive is one task."""

    def open_map(self, path: Path | str) -> PointMap:
        """Open a map."""

    def open(self, entry: DriveEntry, point_map: PointMap) -> OpenedDrive:
        """Open a drive in its map."""


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

    def __reduce__(self) -> tuple[Any, ...]:
        return ManyDrivesJob, (self.opener,)  # what is open stays in its process

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
        scans = self.opened(task.entry).scans
        return [failed_epoch(epoch, scans, reason) for epoch in range(task.first, task.last)]


@dataclass(slots=True)
class Localized:
    """Summary of a run over many drives; `n_new` epochs were localized by it, `refused` says why a drive was not."""

    n_drives: int = 0  # in the dataset
    n_epochs: int = 0
    n_localized: int = 0  # epochs with the status "localized"
    n_new: int = 0
    refused: dict[str, str] = field(default_factory=dict)


def localize_drives(
    entries: Sequence[DriveEntry], job: ManyDrivesJob, out: str | os.PathLike[str], engine: Engine | None = None,
    progress: Progress | None = None,
) -> Localized:  # fmt: skip
    """Localize drives into a Parquet dataset; drives and epochs that it has already are not localized again.

    A drive that cannot be localized is in `refused`. FileError or OptionError if the folder cannot be written, holds
    something else, or was made with other options.
    """
    dataset = PosesDataset(Path(out))
    with work_folder(dataset.folder, "poses of drives", OPTIONS):
        dataset.check_options({"maxcon": __version__, "options": describe(job.opener)})
        sources = {entry.name: asdict(entry) for entry in entries}
        for source in sources.values():
            del source["name"]
        dataset.check_sources(sources)
        done = Localized()
        todo = [entry for entry in entries if not dataset.clear_if_done(entry.name)]
        if todo:
            report = progress or (lambda step, done, total: None)
            _localize_missing(todo, job, dataset, engine or Engine(), done, report)
        for entry in entries:
            if dataset.is_done(entry.name):
                statuses = dataset.statuses(entry.name)
                done.n_drives += 1
                done.n_epochs += len(statuses)
                done.n_localized += statuses.count(Status.LOCALIZED.value)
    return done


def _localize_missing(
    todo: Sequence[DriveEntry], job: ManyDrivesJob, dataset: PosesDataset, engine: Engine, done: Localized,
    progress: Progress,
) -> None:  # fmt: skip
    """Localize the epochs of drives that the dataset lacks; each is published with the last of them."""
    n_missing: dict[str, int] = {}

    def tasks(entry: DriveEntry) -> Iterator[DriveTask]:
        """Tasks for the missing epochs of a drive, which is opened."""
        try:
            n_epochs = len(job.opened(entry).scans)
        except MaxconError as error:
            done.refused[entry.name] = str(error)
            return
        there = dataset.table(entry.name).read().column("epoch").to_numpy()
        missing = np.setdiff1d(np.arange(n_epochs), there).tolist()
        if job.opener.is_track:
            missing = list(range(n_epochs)) if missing else []
        n_missing[entry.name] = len(missing)
        if not missing:
            dataset.publish(entry.name)
        yield from tasks_of(entry, missing, job.opener.is_track)

    all_tasks = (task for entry in todo for task in tasks(entry))
    for task, found in engine.run(job, all_tasks, sys.maxsize) if todo else ():
        name = task.entry.name
        if isinstance(found, str):
            done.refused.setdefault(name, found)
            continue
        dataset.add(name, found)
        done.n_new += len(found)
        n_missing[name] -= len(found)
        progress("localizing", done.n_new, done.n_new + sum(n_missing.values()))
        if n_missing[name] == 0 and name not in done.refused:
            dataset.publish(name)
