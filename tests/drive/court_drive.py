"""Walls around a court, a drive within them, and epochs as a drive yields them."""

import numpy as np

from maxcon import Estimate, LocalFrame, Pose, Scan, Status, Trajectory
from maxcon.drive.localize import EpochEstimate
from maxcon.io.scans import RawScan
from upright_walls import joined, on_grid

FRAME = LocalFrame((458_800.0, 5_429_000.0, 100.0))
CELL = 0.06
COURT = ((5.03, 5.03), (25.03, 5.03), (25.03, 25.03), (5.03, 25.03))
N_SCANS = 10
# ETRS89 / UTM 32N, where a float32 has steps of half a metre.
POSE = Pose(549936.51934567, 5801960.09212654, 62.00561111, 0.0012345678, -0.004494209, 3.0430433691)
START = 386_400.123456789


def walls(corners, step=0.05, height=4.0):
    """Points and normals (inwards) of upright walls along a polygon, counter-clockwise, local frame."""
    ways = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    return joined(*(on_grid(*way, (0.0, height), step) for way in ways))


def seen(points, normals, pose, n=4000, seed=0):
    """Some points of walls and their normals, sensor frame."""
    rows = np.random.default_rng(seed).choice(len(points), n, replace=False)
    return (points[rows] - pose.position) @ pose.rotation, normals[rows] @ pose.rotation


def truth(epoch):
    return Pose(11.0 + 0.8 * epoch, 15.0 + 0.1 * epoch, 1.5, 0.01, -0.01, 0.05 * epoch)


def prior_of(times, epochs=None, off=(0.6, -0.42, 0.0)):
    """True poses at times, of the first epochs if no others are named, all off by so many metres; global."""
    poses = [FRAME.pose_to_global(truth(epoch)).translated(off) for epoch in epochs or range(len(times))]
    return Trajectory.from_poses(times, poses)


def made_epoch(number, status=Status.LOCALIZED, pose=POSE, **known):
    """An epoch as `localize_drive` yields it, with what is known of its estimate; a pose only where it is localized."""
    raw = RawScan(np.empty((0, 3)), START + number, f"{number:06d}.bin", 10, 1, 2)
    estimate = Estimate(Pose(1.0, 2.0, 3.0, 0.0, 0.0, 0.0), 256.0771, (4, 50, 50), status, np.eye(2), **known)
    is_searched = status not in (Status.NO_PRIOR, Status.NO_POINTS, Status.OUTSIDE_MAP)
    return EpochEstimate(
        number, raw, status, 12.345, Scan(raw.points, time=raw.time), None, estimate if is_searched else None,
        pose if status is Status.LOCALIZED else None,
    )  # fmt: skip
