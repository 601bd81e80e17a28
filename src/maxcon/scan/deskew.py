"""Deskewing: the points of a moving scanner as they would have been measured at one time."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, TrajectoryError
from maxcon.geometry import interpolate_poses
from maxcon.geometry.arrays import as_points
from maxcon.scan.trajectory import Trajectory

MAX_GAP = 0.5  # between two poses of the motion to interpolate across, s
MAX_BEYOND = 0.15
"""A scan may begin before the first pose of the motion, or end after the last, by this much, s: the motion goes on as
between the two poses there."""


def deskew(
    points_sensor: ArrayLike, times: ArrayLike, motion: Trajectory, time: float, max_gap: float = MAX_GAP
) -> NDArray[np.float64]:
    """Return points (n, 3), m, each in the sensor frame at its own time (n,), s, as if all were measured at one time.

    `motion` is T_any_sensor in any frame that stands: positions are linear in it, turns take the shortest arc.
    """
    points = as_points(points_sensor, "points_sensor")
    at = np.asarray(times, dtype=np.float64)
    if at.shape != (len(points),) or not np.isfinite(at).all():
        raise ArrayError(f"Expected `times` to be {len(points)} finite numbers, one per point, got shape {at.shape}.")
    # A turn has some thousand different times, of all layers at once.
    moments, which = np.unique(np.append(at, time), return_inverse=True)
    _check_covered(motion.times, moments, max_gap)
    positions, turned = interpolate_poses(motion.times, motion.positions, motion.quaternions_xyzw, moments)
    rotations = turned.as_matrix()
    R_here = rotations[which[-1]]
    turns = R_here.T @ rotations
    shifts = (positions - positions[which[-1]]) @ R_here
    rows = which[:-1]
    return np.asarray(np.einsum("nij,nj->ni", turns[rows], points) + shifts[rows], dtype=np.float64)


def times_of_turn(points_sensor: ArrayLike, turn_time: float) -> NDArray[np.float64]:
    """When each point, (n, 3), of a spinning scanner's turn was measured, (n,), s from its middle, which looks forward.

    x is forward; a turn takes `turn_time` (s), clockwise seen from above, negative for counter-clockwise.
    """
    points = as_points(points_sensor, "points_sensor")
    return np.asarray(np.arctan2(points[:, 1], points[:, 0]) * (-turn_time / (2.0 * np.pi)), dtype=np.float64)


def _check_covered(known: NDArray[np.float64], times: NDArray[np.float64], max_gap: float) -> None:
    """Raise a TrajectoryError unless poses at times `known` are around increasing `times`, without large gaps, s."""
    if len(known) < 2 or times[0] < known[0] - MAX_BEYOND or times[-1] > known[-1] + MAX_BEYOND:
        raise TrajectoryError(
            f"Expected a motion over the scan, {times[0]:.6f} to {times[-1]:.6f} s, got poses from {known[0]:.6f} to"
            f" {known[-1]:.6f} s. Leave this scan out, or do not deskew it."
        )
    earlier = (np.searchsorted(known, times, side="right") - 1).clip(0, len(known) - 2)
    gap = (known[earlier + 1] - known[earlier]).max()
    if gap > max_gap:
        raise TrajectoryError(
            f"Expected poses at most {max_gap:g} s apart over the scan at {times[0]:.6f} s, got a gap of"
            f" {gap:.6f} s. Leave this scan out, or do not deskew it."
        )
