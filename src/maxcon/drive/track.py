# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tracking over a drive: scan after scan, with the motion between them from odometry or from the prior itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from maxcon.drive.localize import (
    NOTHING_KNOWN,
    DriveOptions,
    EpochEstimate,
    answered,
    check_times,
    pose_or_none,
    priors_of_scans,
    read_epoch,
    scan_of,
    status_without_search,
)
from maxcon.drive.motion import Motion
from maxcon.drive.tracker import Tracker
from maxcon.estimate import Status
from maxcon.geometry import Pose
from maxcon.io.scans import Scans
from maxcon.map import PointMap
from maxcon.scan.trajectory import Trajectory


def track_drive(
    point_map: PointMap,
    scans: Scans,
    prior: Trajectory,
    tracker: Tracker,
    odometry: Trajectory | None = None,
    options: DriveOptions | None = None,
) -> Iterator[EpochEstimate]:
    """Return an iterator over the estimates of all scans, in order of time; what cannot work is said at once.

    point_map: the map.
    scans: the scans; one is in memory at a time.
    prior: T_map_sensor before localization, global coordinates in the CRS of the map. It may have gaps: it is needed
        where the track begins, and tells a wrong one.
    tracker: how each is localized; its noise is that of the motion's source.
    odometry: source of the motion between scans, T_odometry_sensor: in any frame, and drifting. Without it the prior
        is.
    options: range limits and the largest gap of the trajectories.

    TrajectoryError if the prior, or the odometry, has no pose for any scan; MapError if the prior lies outside the map
    at every scan, or a tile cannot be read.

    A scan that cannot be read or searched, or whose motion is not known, is an epoch with that status, and the drive
    goes on.
    """
    options = options or DriveOptions()
    poses = priors = priors_of_scans(point_map, scans, prior, options)
    if odometry is not None:
        poses = [pose_or_none(odometry, float(at), options.max_gap) for at in scans.times]
        check_times(scans, odometry, poses, "odometry")
    motions = _motions(scans.times.tolist(), poses)
    drive = _TrackedDrive(point_map, scans, tracker, options)
    return (
        drive.epoch(number, prior_pose, motion)
        for number, (prior_pose, motion) in enumerate(zip(priors, motions, strict=True))
    )


def _motions(times: Sequence[float], poses: Sequence[Pose | None]) -> list[Motion | None]:
    """Motion up to each time (s) since the last one with a pose; None where there is no pose."""
    motions: list[Motion | None] = []
    last: tuple[float, Pose] | None = None
    for at, pose in zip(times, poses, strict=True):
        if pose is None:
            motions.append(None)
            continue
        motions.append(Motion.none() if last is None else Motion.between(last[1], pose, at - last[0]))
        last = (at, pose)
    return motions


@dataclass(frozen=True, slots=True)
class _TrackedDrive:
    """A drive that is being tracked."""

    point_map: PointMap
    scans: Scans
    tracker: Tracker
    options: DriveOptions

    def epoch(self, number: int, prior: Pose | None, motion: Motion | None) -> EpochEstimate:
        """Read and localize the scan of one epoch, after a motion since the last one whose motion was known."""
        if motion is not None:
            self.tracker.move(motion)
        prediction = self.tracker.prediction
        expected = prior if prediction is None else prediction.pose
        raw, reason = read_epoch(self.scans, number, self.options)
        scan = scan_of(raw)
        status = Status.UNREADABLE if reason else status_without_search(self.point_map, scan, prior, expected)
        if status is Status.NO_PRIOR:
            reason = NOTHING_KNOWN
        elif status is None and motion is None:
            status, reason = Status.NO_PRIOR, "the motion up to this scan is not known"
        if status is not None:
            return EpochEstimate(number, raw, status, 0.0, scan, expected, reason=reason)
        return answered(
            number, raw, scan, prior or expected, self.point_map,
            lambda: self.tracker.localize(scan, self.point_map, prior),
        )  # fmt: skip
