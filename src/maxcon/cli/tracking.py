# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of `maxcon localize` that make its epochs a track."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.drive.localize import DriveOptions, EpochEstimate
    from maxcon.io.scans import Scans
    from maxcon.maximum_consensus import MaximumConsensus
    from maxcon.point_map import PointMap
    from maxcon.trajectory import Trajectory
    from maxcon.within_sigmas import WithinSigmas

__all__ = ["check_tracking", "started_drive"]


def check_tracking(
    track: bool, odometry: Path | None, drift: float | None, *, deskew: bool = False, is_shared: bool = False
) -> None:
    """Refuse options without effect.

    Raises
    ------
    OptionError
        If odometry is given without tracking or deskewing, or its drift without odometry; or a track is to be shared
        among workers.
    """
    if track and is_shared:
        raise OptionError(
            "Expected one process for --track, as each epoch needs the one before, got --workers or --scheduler. Leave"
            " it out, or take --threads."
        )
    if odometry is not None and not (track or deskew):
        raise OptionError(
            "Expected --odometry together with --track or --deskew, got it alone. Add one, or leave it out."
        )
    if drift is not None and odometry is None:
        raise OptionError("Expected --drift together with --odometry, got it alone. Leave it out.")


def started_drive(
    point_map: "PointMap",
    scans: "Scans",
    prior: "Trajectory",
    method: "MaximumConsensus",
    options: "DriveOptions",
    *,
    windows: "WithinSigmas | None",
    track: bool,
    odometry: "Trajectory | None",
    drift: float | None,
    threads: int,
    first: int = 0,
) -> "Iterator[EpochEstimate]":
    """Return an iterator over the estimates of a drive, each epoch by itself, within its window, or as a track.

    An epoch by itself may be the `first`; a track begins with epoch 0.
    """
    if not track:
        from maxcon.drive.localize import localize_drive

        return localize_drive(
            point_map, scans, prior, windows or method, options, first=first, n_threads=threads
        )
    from maxcon.drive.track import track_drive
    from maxcon.tracking import MotionNoise, Tracker

    if odometry is None:
        tracker = Tracker(method, MotionNoise.of_prior(prior))
        return track_drive(point_map, scans, prior, tracker, None, options)
    noise = MotionNoise() if drift is None else MotionNoise(share=drift)
    return track_drive(point_map, scans, prior, Tracker(method, noise), odometry, options)
