# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses as a vehicle measures them: GNSS priors, odometry, errors of priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive, Seed


@dataclass(frozen=True, slots=True)
class GnssErrors:
    """First-order Gauss-Markov errors of x, y, z, roll, pitch and heading, reflected at bounds.

    offset, offset_bound: standard deviation of x and y before the reflection (1.17 m after it), and their bound, m:
        multipath between houses, within the paper's search range of 3 m.
    heading_deg, heading_bound_deg: the same for the heading, degrees.
    z, z_bound: the same for the height, m; small, as it is taken for known from the map's ground.
    tilt_deg, tilt_bound_deg: the same for roll and pitch, degrees.
    correlation_time: time after which two errors correlate by 1/e, s.
    """

    offset: float = 1.3
    offset_bound: float = 2.7
    heading_deg: float = 0.6
    heading_bound_deg: float = 1.8
    z: float = 0.015
    z_bound: float = 0.04
    tilt_deg: float = 0.05
    tilt_bound_deg: float = 0.15
    correlation_time: float = 20.0

    def __post_init__(self) -> None:
        if not (min(*self.deviations, self.correlation_time) > 0.0 and (self.bounds >= self.deviations).all()):
            raise OptionError(
                f"Expected standard deviations and a correlation time above 0, and no bound below its deviation,"
                f" got {self}. Leave them out for the defaults."
            )

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviations of x, y, z (m), roll, pitch and heading (rad), shape (6,), before the reflection."""
        tilt, turn = math.radians(self.tilt_deg), math.radians(self.heading_deg)
        return np.array([self.offset, self.offset, self.z, tilt, tilt, turn])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Largest errors of x, y, z (m), roll, pitch and heading (rad), shape (6,)."""
        tilt, turn = math.radians(self.tilt_bound_deg), math.radians(self.heading_bound_deg)
        return np.array([self.offset_bound, self.offset_bound, self.z_bound, tilt, tilt, turn])

    def draw(self, n_times: int, step: float, seed: Seed) -> NDArray[np.float64]:
        """Errors at `n_times` times, `step` (s) apart, shape (n_times, 6), m and rad.

        The same seed and step give the same first errors, whatever `n_times` is.
        """
        rng = np.random.default_rng(seed)
        keeps = math.exp(-step / self.correlation_time)
        fresh = math.sqrt(1.0 - keeps**2)
        errors = np.empty((n_times, 6))
        last = self._bounded(self.deviations * rng.standard_normal(6))
        for row in errors:
            row[:] = last
            last = self._bounded(keeps * last + fresh * self.deviations * rng.standard_normal(6))
        return errors

    def _bounded(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reflect errors, shape (6,), at their bounds, as often as it takes."""
        bounds = self.bounds
        return np.asarray(bounds - np.abs((errors + bounds) % (4.0 * bounds) - 2.0 * bounds))


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Errors of the motions that odometry measures.

    scale: relative error of all distances, 0.01 for 1 %; its sign is drawn at random.
    heading_drift_deg: bias of the gyroscope while the vehicle moves, degrees per second; its sign is drawn at random.
    heading_walk_deg: random walk of the heading: standard deviation, degrees per square root of a metre.
    walk: random walk of the position along each axis: standard deviation, m per square root of a metre.
    tilt_deg: standard deviation of roll and pitch, degrees; gravity keeps them from drifting.
    """

    scale: float = 0.01
    heading_drift_deg: float = 0.05
    heading_walk_deg: float = 0.1
    walk: float = 0.005
    tilt_deg: float = 0.02

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 <= value < math.inf:
                raise OptionError(
                    f"Expected `{field.name}` of odometry errors to be a number >= 0, got {value}. Leave it out?"
                )

    def draw(self, drive: Drive, times: ArrayLike, seed: Seed) -> list[Pose]:
        """Return the poses that odometry gives: the first is at the origin, heading along x.

        drive: the true poses.
        times: shape (n,); times of the poses, s, rising.
        seed: the same seed gives the same errors.
        Returns T_odometry_sensor.
        """
        rng = np.random.default_rng(seed)
        wanted = np.asarray(times, dtype=np.float64)
        positions, angles = drive.at(wanted)
        scale, drift = np.array([self.scale, math.radians(self.heading_drift_deg)]) * rng.choice([-1.0, 1.0], 2)
        steps = np.diff(positions, axis=0)
        ways = np.linalg.norm(steps, axis=1)
        turns = np.diff(angles[:, 2]) + np.where(ways > 0.0, drift, 0.0) * np.diff(wanted)
        turns += math.radians(self.heading_walk_deg) * np.sqrt(ways) * rng.standard_normal(len(ways))
        headings = np.concatenate([[0.0], np.cumsum(turns)])
        cosine, sine = np.cos(headings[:-1] - angles[:-1, 2]), np.sin(headings[:-1] - angles[:-1, 2])
        moved = (1.0 + scale) * steps
        moved += self.walk * np.sqrt(ways)[:, None] * rng.standard_normal(steps.shape)
        turned = np.column_stack(
            [cosine * moved[:, 0] - sine * moved[:, 1], sine * moved[:, 0] + cosine * moved[:, 1], moved[:, 2]]
        )
        places = np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)])
        tilts = angles[:, :2] + math.radians(self.tilt_deg) * rng.standard_normal((len(wanted), 2))
        return [Pose(*row) for row in np.column_stack([places, tilts, headings]).tolist()]


def off_by(reference: Pose, errors: Sequence[float]) -> Pose:
    """Return `reference` with errors of x, y, z (m), roll, pitch and heading (rad) added."""
    x, y, z, roll, pitch, heading = errors
    return Pose(
        reference.x + x,
        reference.y + y,
        reference.z + z,
        reference.roll + roll,
        reference.pitch + pitch,
        reference.heading + heading,
    )


@dataclass(frozen=True, slots=True)
class PriorErrors:
    """Bounds of the errors of a prior: each error is uniform within plus and minus its bound.

    offset: of x and of y, m.
    heading_deg: of the heading, degrees.
    z: of the height, m.
    tilt_deg: of roll and of pitch, degrees.
    """

    offset: float = 2.5
    heading_deg: float = 1.8
    z: float = 0.01
    tilt_deg: float = 0.05

    def prior(self, reference: Pose, rng: np.random.Generator) -> Pose:
        """Return a prior: `reference` with errors drawn from `rng`."""
        tilt, turn = math.radians(self.tilt_deg), math.radians(self.heading_deg)
        bounds = np.array([self.offset, self.offset, self.z, tilt, tilt, turn])
        return off_by(reference, (bounds * rng.uniform(-1.0, 1.0, 6)).tolist())
