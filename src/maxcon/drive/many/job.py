# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Many drives as a job of the engine: a worker keeps maps and drives open, and localizes some epochs at a time."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Protocol

from maxcon.drive.localize import EpochEstimate
from maxcon.drive.many.table import DriveEntry
from maxcon.errors import MaxconError
from maxcon.map import PointMap

__all__ = ["DriveTask", "ManyDrivesJob", "OpenedDrive", "OpensDrives"]

MOST_MAPS, MOST_DRIVES = 4, 2
"""Most maps, and most drives, that a worker keeps open."""


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


@dataclass(frozen=True)
class ManyDrivesJob:
    """The work on a `DriveTask`: estimates of its epochs, without points, or why its drive cannot be localized.

    Parameters
    ----------
    opener : OpensDrives
        Opens maps and drives.
    """

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
