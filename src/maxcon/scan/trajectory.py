"""Trajectory: poses with their times, and the pose at any time between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError, TrajectoryError
from maxcon.geometry import Pose, interpolate_poses
from maxcon.geometry.arrays import first_covariance_fault
from maxcon.geometry.pose import angles_from_quaternions, quaternions_from_angles

SAME_TIME = 1e-3  # A time this near to a pose's is that pose's: loggers round to the millisecond
# Files with two decimals are off by 0.01; anything farther is another order of columns, not rounding.
QUATERNION_TOLERANCE = 1e-2


class TrajectoryFault(NamedTuple):
    """The first row of a trajectory that cannot be used, and why."""

    row: int
    words: str


def first_fault(
    times: NDArray[np.float64], positions: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64],
    covariances: NDArray[np.float64] | None = None,
) -> TrajectoryFault | None:  # fmt: skip
    """Return the first row that cannot be used, with why, or None; covariances (n, 3, 3) are NaN where not known."""
    lengths = np.hypot.reduce(quaternions_xyzw, axis=1)
    is_finite = np.isfinite(times) & np.isfinite(positions).all(axis=1) & np.isfinite(lengths)
    is_later = np.ones(len(times), dtype=bool)
    is_later[1:] = ~(times[1:] <= times[:-1])
    is_unit = ~(np.abs(lengths - 1.0) > QUATERNION_TOLERANCE)
    is_good = is_finite & is_later & is_unit
    if is_good.all():
        if covariances is None:
            return None
        rows = np.flatnonzero(~np.isnan(covariances).all(axis=(1, 2)))
        fault = first_covariance_fault(covariances[rows])
        return None if fault is None else TrajectoryFault(int(rows[fault[0]]), fault[1])
    row = int(np.argmin(is_good))
    words = (
        f"Expected a unit quaternion (qx, qy, qz, qw), got length {lengths[row]:.3g}."
        " Check the order of the columns, or leave this pose out."
    )
    if not is_finite[row]:
        words = "Expected finite numbers, got NaN or infinity. Leave this pose out."
    elif not is_later[row]:
        words = (
            f"Expected times that increase, got {times[row]:.9f} s after {times[row - 1]:.9f} s."
            " Sort the poses by time and keep one of each time."
        )
    return TrajectoryFault(row, words)


def _as_array(values: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    """Return a copy of `values` as float64; -1 in `shape` stands for any length of one or more."""
    wanted = "(" + ", ".join("n" if size < 0 else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArrayError(
            f"Expected `{name}` to be numbers of shape {wanted}, got {type(values).__name__}. Give an array of numbers."
        ) from error
    fits = array.ndim == len(shape) and all(size in (-1, got) for size, got in zip(shape, array.shape, strict=True))
    if not fits:
        raise ArrayError(f"Expected `{name}` to have shape {wanted}, got {array.shape}. Give one row per pose.")
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses T_map_sensor over time, in global coordinates; the arrays are read-only copies.

    - times: shape (n,), s, strictly increasing; at least one.
    - positions: shape (n, 3), global coordinates, m.
    - quaternions_xyzw: shape (n, 4), orientation of the sensor; unit length within 1 %, normalized here.
    - covariances: shape (n, 3, 3), of x, y and heading of each pose, axes of the CRS: m^2, m rad and rad^2; NaN of a
      pose of which it is not known how well it is known. None if none's is.

    An ArrayError if a shape is wrong or something is not a number; a TrajectoryError if a row cannot be used.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    quaternions_xyzw: NDArray[np.float64]
    covariances: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        return f"Trajectory({len(self.times)} poses, {self.times[0]:.3f} to {self.times[-1]:.3f} s)"

    def __post_init__(self) -> None:
        times = _as_array(self.times, (-1,), "times")
        positions = _as_array(self.positions, (len(times), 3), "positions")
        quaternions = _as_array(self.quaternions_xyzw, (len(times), 4), "quaternions_xyzw")
        if len(times) == 0:
            raise TrajectoryError("Expected a trajectory of at least one pose, got none. Check where it comes from.")
        covariances = self.covariances
        if covariances is not None:
            covariances = _as_array(covariances, (len(times), 3, 3), "covariances")
        fault = first_fault(times, positions, quaternions, covariances)
        if fault is not None:
            raise TrajectoryError(f"Row {fault.row} of the trajectory (counted from 0): {fault.words}")
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        arrays = {"times": times, "positions": positions, "quaternions_xyzw": quaternions}
        for name, array in (arrays if covariances is None else {**arrays, "covariances": covariances}).items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def from_poses(
        cls, times: ArrayLike, poses: Sequence[Pose], covariances: NDArray[np.float64] | None = None
    ) -> Self:
        """Return the trajectory of `poses` at `times` (s), one pose (and covariance) per time."""
        values = np.array([pose.values for pose in poses]).reshape(-1, 6)
        return cls(np.asarray(times), values[:, :3], quaternions_from_angles(*values[:, 3:].T), covariances)

    def __len__(self) -> int:
        """How many poses there are."""
        return len(self.times)

    @property
    def angles(self) -> NDArray[np.float64]:
        """Roll, pitch and heading of each pose, shape (n, 3), rad."""
        return angles_from_quaternions(self.quaternions_xyzw)

    def pose(self, i: int) -> Pose:
        """Return pose number `i`."""
        return _poses(self.positions[i][None], self.quaternions_xyzw[i][None])[0]

    def poses(self) -> list[Pose]:
        """Return all poses, in order of time."""
        return _poses(self.positions, self.quaternions_xyzw)

    def later(self, seconds: float) -> Trajectory:
        """Return the same poses at times later by so many seconds."""
        return replace(self, times=self.times + seconds)

    def at(self, time: float, max_gap: float = 0.5) -> Pose:
        """Return the pose at `time` (s): positions are linear between poses, turns take the shortest arc.

        Within 1 ms of a pose at an end or beside a gap it is that pose. A TrajectoryError if `time` lies outside the
        trajectory, or between two poses farther apart than `max_gap` (s).
        """
        earlier, later, _ = self._between(time, max_gap)
        if earlier == later:
            return self.pose(earlier)
        two = slice(earlier, later + 1)
        positions, turns = interpolate_poses(self.times[two], self.positions[two], self.quaternions_xyzw[two], [time])
        return _poses(positions, turns.as_quat())[0]

    def covariance_at(self, time: float, max_gap: float = 0.5) -> NDArray[np.float64] | None:
        """Return the covariance of x, y and heading of the pose `at` a time, shape (3, 3); None where it is not known.

        Between two poses it is linear: never too small for a pose that is linear between them, however their errors a
        and b are correlated: (1 - s) A + s B is that of (1 - s) a + s b and s (1 - s) times that of a - b.
        """
        earlier, later, part = self._between(time, max_gap)
        if self.covariances is None:
            return None
        covariance = np.zeros((3, 3))
        for row, weight in ((earlier, 1.0 - part), (later, part)):
            if weight > 0.0:
                covariance += weight * self.covariances[row]
        return None if np.isnan(covariance).any() else covariance

    def _between(self, time: float, max_gap: float) -> tuple[int, int, float]:
        """Return the poses before and after a time, and where between them it lies, 0 to 1; or one pose twice."""
        _check_gap(max_gap)
        if not math.isfinite(time):
            raise TrajectoryError(f"Expected a finite time, got {time}. Leave this epoch out.")
        later = int(np.searchsorted(self.times, time))
        near = [i for i in (later - 1, later) if 0 <= i < len(self)]
        nearest = min(near, key=lambda i: abs(self.times[i] - time))
        distance = abs(float(self.times[nearest]) - time)
        is_inside = len(near) == 2 and self.times[later] - self.times[later - 1] <= max_gap
        if distance <= SAME_TIME and not is_inside:
            return nearest, nearest, 0.0
        if len(near) == 1:
            raise TrajectoryError(
                f"Expected a time within the trajectory, {self.times[0]:.6f} to {self.times[-1]:.6f} s, got"
                f" {time:.6f} s, {distance:.6f} s from the nearest pose. Check that both use the same clock,"
                " or leave this epoch out."
            )
        before, after = (float(self.times[i]) for i in near)
        if after - before > max_gap:
            raise TrajectoryError(
                f"Expected poses at most {max_gap:g} s apart around {time:.6f} s, got a gap of"
                f" {after - before:.6f} s from {before:.6f} to {after:.6f} s, {distance:.6f} s from the nearest"
                " pose. Raise max_gap to interpolate across it, or leave this epoch out."
            )
        return later - 1, later, (time - before) / (after - before)

    def positions_at(self, times: ArrayLike, max_gap: float = 0.5) -> NDArray[np.float64]:
        """Where the sensor was, shape (n, 3), global coordinates, m, at many times, shape (n,), s, in any order.

        Elsewhere than between two poses at most `max_gap` (s) apart, the nearest pose's position stands in, if it is
        within half of `max_gap`; NaN where none is.
        """
        _check_gap(max_gap)
        wanted = np.asarray(times, dtype=np.float64)
        if wanted.ndim != 1:
            raise ArrayError(f"Expected `times` to have shape (n,), got {wanted.shape}. Flatten it.")
        found = np.stack([np.interp(wanted, self.times, axis) for axis in self.positions.T], axis=1)
        later = np.minimum(np.searchsorted(self.times, wanted), len(self) - 1)
        earlier = np.maximum(later - 1, 0)
        to_earlier, to_later = wanted - self.times[earlier], self.times[later] - wanted
        gap = self.times[later] - self.times[earlier]
        is_between = (wanted >= self.times[0]) & (wanted <= self.times[-1]) & (gap <= max_gap)
        rows = np.flatnonzero(~is_between)
        nearest = np.where(np.abs(to_earlier[rows]) < np.abs(to_later[rows]), earlier[rows], later[rows])
        is_near = np.abs(wanted[rows] - self.times[nearest]) <= max_gap / 2.0
        found[rows] = np.where(is_near[:, None], self.positions[nearest], np.nan)
        return found


def _check_gap(max_gap: float) -> None:
    if not max_gap >= 0.0:
        raise OptionError(f"Expected max_gap >= 0 s, got {max_gap}. The default is 0.5 s.")


def _poses(positions: NDArray[np.float64], quaternions_xyzw: NDArray[np.float64]) -> list[Pose]:
    values = np.hstack([positions, angles_from_quaternions(quaternions_xyzw)])
    return [Pose(*row) for row in values.tolist()]
