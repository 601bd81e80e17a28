# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How `maxcon localize` localizes: what its options say, and a drive opened with them, here or in a worker."""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from maxcon.cli.drive_inputs import DriveInputs, RecordingOptions, naming_files
from maxcon.cli.method_options import parse_objective
from maxcon.cli.search_space import SpaceOptions
from maxcon.search.options import Multiplicity, SearchMethod, Weighting

if TYPE_CHECKING:
    from maxcon.drive.localize import Drive, DriveOptions, EpochEstimate
    from maxcon.drive.many import DriveEntry
    from maxcon.drive.within_sigmas import WithinSigmas
    from maxcon.integrity import Trust
    from maxcon.localizer import MaximumConsensus
    from maxcon.map import PointMap

__all__ = ["DriveOpener", "OpenedDrive"]


@dataclass(frozen=True)
class DriveOpener:
    """The options of `maxcon localize` that are not of one drive."""

    recording: RecordingOptions
    spaces: SpaceOptions
    drive: "DriveOptions"
    trust: "Trust"
    objective: str
    multiplicity: Multiplicity
    weighting: Weighting
    thinning: float
    search: SearchMethod
    refinement: bool
    wider: float
    risk: float
    is_track: bool
    drift: float | None
    known_only: bool
    threads: int = field(repr=False)  # of no effect on the rows: not written down with them

    def open_map(self, path: Path | str) -> "PointMap":
        """Open a map."""
        from maxcon.map import PointMap
        from maxcon.map.surface_class import ALL_BUT_KNOWN, NOT_SEARCHED

        return PointMap.open(path, left_out=ALL_BUT_KNOWN if self.known_only else NOT_SEARCHED)

    def open(self, entry: "DriveEntry", point_map: "PointMap", *, quiet: bool = True) -> "OpenedDrive":
        """Return a drive with its inputs opened.

        Raises
        ------
        MaxconError
            If one of them cannot be read, or an option does not fit it.
        """
        from maxcon.localizer import MaximumConsensus

        inputs = DriveInputs.open(
            point_map, entry.scans, entry.times, entry.prior, entry.odometry, self.drive.max_gap, self.recording,
            quiet=quiet,
        )  # fmt: skip
        method = MaximumConsensus(
            self.spaces.fixed(), parse_objective(self.objective), self.multiplicity,
            self.threads if self.is_track else 1, self.trust, self.weighting, self.search, self.thinning,
            self.refinement, self.wider, self.risk,
        )  # fmt: skip
        windows = self.spaces.within_sigmas(method, inputs.prior, self.drive.max_gap, track=self.is_track)
        if self.is_track and windows is not None:
            method, windows = windows.at(float(inputs.prior.times[0])), None
        return OpenedDrive(self, entry, point_map, inputs, method, windows)


class OpenedDrive:
    """A drive with its inputs opened; its priors are looked at when the first epoch is asked for.

    Parameters
    ----------
    opener : DriveOpener
        How it is localized.
    entry : DriveEntry
        Where its parts are.
    point_map : PointMap
        Its map.
    inputs : DriveInputs
        Scans, prior and odometry.
    method : MaximumConsensus
        What searches.
    windows : WithinSigmas or None
        What searches within standard deviations instead.
    """

    def __init__(
        self,
        opener: DriveOpener,
        entry: "DriveEntry",
        point_map: "PointMap",
        inputs: DriveInputs,
        method: "MaximumConsensus",
        windows: "WithinSigmas | None",
    ) -> None:
        self.opener = opener
        self.entry = entry
        self.point_map = point_map
        self.inputs = inputs
        self.method = method
        self.windows = windows
        self._drive: Drive | None = None

    @property
    def n_epochs(self) -> int:
        """How many scans it has."""
        return len(self.inputs.scans)

    def started(self, first: int = 0) -> "Iterator[EpochEstimate]":
        """Return an iterator over the estimates from an epoch on; what cannot work is said at once, with the files."""
        from maxcon.drive.localize import localize_drive

        with self._naming_files():
            if self.opener.is_track:
                return self._tracked()
            return localize_drive(
                self.point_map, self.inputs.scans, self.inputs.prior, self.windows or self.method, self.opener.drive,
                first=first, n_threads=self.opener.threads,
            )  # fmt: skip

    def _tracked(self) -> "Iterator[EpochEstimate]":
        """Return an iterator over the estimates of a track, by odometry or by what the prior says of motions."""
        from maxcon.drive.track import track_drive
        from maxcon.drive.tracking import MotionNoise, Tracker

        prior, odometry, drift = self.inputs.prior, self.inputs.odometry, self.opener.drift
        if odometry is None:
            noise = MotionNoise.of_prior(prior)
        else:
            noise = MotionNoise() if drift is None else MotionNoise(share=drift)
        tracker = Tracker(self.method, noise)
        return track_drive(self.point_map, self.inputs.scans, prior, tracker, odometry, self.opener.drive)

    def estimates(self, first: int, last: int) -> "Iterator[EpochEstimate]":
        """Localize the epochs from `first` up to, not including, `last`; a track from its beginning to its end."""
        if self.opener.is_track:
            return self.started()
        return self.checked().estimates(first, last, self.opener.threads)

    def checked(self) -> "Drive":
        """Return the drive with its priors found; what cannot work is said, with the files."""
        from maxcon.drive.localize import Drive

        if self._drive is None:
            with self._naming_files():
                self._drive = Drive.of(
                    self.point_map, self.inputs.scans, self.inputs.prior, self.windows or self.method,
                    self.opener.drive,
                )  # fmt: skip
        return self._drive

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
