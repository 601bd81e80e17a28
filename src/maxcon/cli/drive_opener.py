# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive opened as the options of `maxcon localize` say, in this process or in a worker."""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from maxcon.cli.drive_inputs import DriveInputs, naming_files
from maxcon.cli.options import Certainty, MethodOptions, MotionOptions, RecordingOptions, parse_objective
from maxcon.cli.space_options import SpaceOptions
from maxcon.errors import MaxconError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine
    from maxcon.drive.localize import Drive, DriveOptions, EpochEstimate
    from maxcon.drive.many import DriveEntry, DriveTask
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap


@dataclass(frozen=True)
class DriveOpener:
    """The options of `maxcon localize` that are not of one drive; it is sent to the workers."""

    method: MethodOptions
    space: SpaceOptions
    recording: RecordingOptions
    motion: MotionOptions
    drive: "DriveOptions"
    certainty: Certainty
    threads: int = field(repr=False)  # of no effect on the rows: not written down with them

    @property
    def is_track(self) -> bool:
        """Whether an epoch needs those before it."""
        return self.motion.track

    def open_map(self, path: Path | str) -> "PointMap":
        """Open a map."""
        from maxcon.map import PointMap
        from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED

        return PointMap.open(path, left_out=ALL_BUT_KNOWN if self.method.known_only else NOT_SEARCHED)

    def open(self, entry: "DriveEntry", point_map: "PointMap", *, quiet: bool = True) -> "OpenedDrive":
        """Return a drive with its inputs opened; MaxconError if one cannot be read, or an option does not fit it."""
        from maxcon.integrity import Trust
        from maxcon.localizer import MaximumConsensus

        inputs = DriveInputs.open(point_map, entry, self.drive.max_gap, self.recording, self.motion, quiet=quiet)
        how, certainty = self.method, self.certainty
        method = MaximumConsensus(
            self.space.fixed(),
            objective=parse_objective(how.objective),
            multiplicity=how.multiplicity,
            n_threads=self.threads if self.is_track else 1,
            trust=Trust(certainty.least_share, certainty.largest_runner_up),
            weighting=how.weighting,
            search=how.search,
            thinning=how.thinning,
            refinement=how.refinement,
            wider=self.space.wider,
            risk=certainty.risk,
        )
        windows = self.space.within_sigmas(method, inputs.prior, self.drive.max_gap, track=self.is_track)
        if self.is_track and windows is not None:
            method, windows = windows.at(float(inputs.prior.times[0])), None
        return OpenedDrive(self, entry, point_map, inputs, method, windows)


@dataclass
class OpenedDrive:
    """A drive with its inputs opened; its priors are looked at when the first epoch is asked for.

    `method` searches, or `windows`, within standard deviations of each prior.
    """

    opener: DriveOpener
    entry: "DriveEntry"
    point_map: "PointMap"
    inputs: DriveInputs
    method: "MaximumConsensus"
    windows: "WithinSigmas | None"

    @property
    def n_epochs(self) -> int:
        """How many scans it has."""
        return len(self.inputs.scans)

    def estimates(self, first: int = 0, last: int | None = None) -> "Iterator[EpochEstimate]":
        """Localize the epochs `first` to `last` - 1; a track from its beginning to its end.

        What cannot work is said at once, with the files.
        """
        if self.opener.is_track:
            with self._naming_files():
                return self._tracked()
        return self.drive.estimates(first, self.n_epochs if last is None else last, self.opener.threads)

    @cached_property
    def drive(self) -> "Drive":
        """The drive with its priors found; what cannot work is said, with the files."""
        from maxcon.drive.localize import Drive

        searching = self.windows or self.method
        with self._naming_files():
            return Drive.of(self.point_map, self.inputs.scans, self.inputs.prior, searching, self.opener.drive)

    def _tracked(self) -> "Iterator[EpochEstimate]":
        """Return an iterator over the estimates of a track, by odometry or by what the prior says of motions."""
        from maxcon.drive.motion import MotionNoise
        from maxcon.drive.track import track_drive
        from maxcon.drive.tracker import Tracker

        prior, odometry, drift = self.inputs.prior, self.inputs.odometry, self.opener.motion.drift
        if odometry is None:
            noise = MotionNoise.of_prior(prior)
        else:
            noise = MotionNoise() if drift is None else MotionNoise(share=drift)
        tracker = Tracker(self.method, noise)
        return track_drive(self.point_map, self.inputs.scans, prior, tracker, odometry, self.opener.drive)

    def failed(self, epoch: int, reason: str) -> "EpochEstimate":
        """Return what stands for an epoch that no process came back from."""
        from maxcon.drive.localize import failed_epoch

        return failed_epoch(epoch, self.inputs.scans, reason)

    def with_points(self, epoch: "EpochEstimate") -> "EpochEstimate":
        """Return an answer that came back without its points with them."""
        from maxcon.drive.localize import read_epoch, scan_of

        raw, _ = read_epoch(self.inputs.scans, epoch.epoch, self.opener.drive)
        return replace(epoch, raw=raw, scan=scan_of(raw))

    def _naming_files(self) -> AbstractContextManager[None]:
        entry = self.entry
        return naming_files(entry.odometry or entry.prior or entry.scans, entry.scans, entry.map)


def by_workers(
    opened: OpenedDrive, engine: "Engine", first: int, with_points: frozenset[int]
) -> "Iterator[EpochEstimate]":
    """Yield the epochs of a drive from one on, in order, localized by the workers of an engine.

    Points stay with the workers; those of the epochs `with_points` are read once more.
    """
    from maxcon._system.ordered_map import in_order_of
    from maxcon.drive.many import tasks_of

    epochs = range(first, len(opened.drive.scans))  # what cannot work is said before anything is started
    found = in_order_of(epochs, _done(opened, engine, list(tasks_of(opened.entry, epochs))))
    return (opened.with_points(epoch) if epoch.epoch in with_points else epoch for epoch in found)


def _done(opened: OpenedDrive, engine: "Engine", tasks: "list[DriveTask]") -> "Iterator[tuple[int, EpochEstimate]]":
    """Yield epochs with their numbers as they are done; MaxconError where a task cannot be."""
    from maxcon.drive.many import ManyDrivesJob

    for _, found in engine.run(ManyDrivesJob(opened.opener), tasks, len(tasks)):
        if isinstance(found, str):
            raise MaxconError(found)
        yield from ((epoch.epoch, epoch) for epoch in found)
