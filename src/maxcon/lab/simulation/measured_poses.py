# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses as vehicles measure them: priors, odometry, georeferenced trajectories."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive, Seed, interpolated

GNSS_DEVIATIONS = np.array([1.3, 1.3, 0.015, *np.radians([0.05, 0.05, 0.6])])
"""Standard deviations of x, y, z (m), roll, pitch and heading (rad), before they are reflected at their bounds.

1.17 m along x and y after the reflection; the height's is small: it is taken for known from the map's ground.
"""
GNSS_BOUNDS = np.array([2.7, 2.7, 0.04, *np.radians([0.15, 0.15, 1.8])])
"""Largest errors of the same: multipath between houses, within the paper's search range of 3 m."""
GNSS_CORRELATION_TIME = 20.0
"""Time after which two errors correlate by 1/e, s."""


def draw_gnss_errors(n_times: int, step: float, seed: Seed) -> NDArray[np.float64]:
    """Errors of x, y, z (m), roll, pitch and heading (rad) at `n_times` times, `step` (s) apart, shape (n_times, 6).

    First-order Gauss-Markov errors. The same seed and step give the same first errors, whatever `n_times` is.
    """
    rng = np.random.default_rng(seed)
    keeps = math.exp(-step / GNSS_CORRELATION_TIME)
    fresh = math.sqrt(1.0 - keeps**2)
    errors = np.empty((n_times, 6))
    last = _bounded(GNSS_DEVIATIONS * rng.standard_normal(6))
    for row in errors:
        row[:] = last
        last = _bounded(keeps * last + fresh * GNSS_DEVIATIONS * rng.standard_normal(6))
    return errors


def _bounded(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reflect errors, shape (6,), at their bounds, as often as it takes."""
    bounds = GNSS_BOUNDS
    return np.asarray(bounds - np.abs((errors + bounds) % (4.0 * bounds) - 2.0 * bounds))


class OdometryErrors(NamedTuple):
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

    def draw(self, drive: Drive, times: NDArray[np.float64], seed: Seed) -> list[Pose]:
        """Return the poses that odometry gives, T_odometry_sensor: the first is at the origin, heading along x.

        drive: the true poses.
        times: shape (n,); times of the poses, s, rising.
        seed: the same seed gives the same errors.
        """
        rng = np.random.default_rng(seed)
        positions, angles = drive.at(times)
        scale, drift = np.array([self.scale, math.radians(self.heading_drift_deg)]) * rng.choice([-1.0, 1.0], 2)
        steps = np.diff(positions, axis=0)
        ways = np.linalg.norm(steps, axis=1)
        turns = np.diff(angles[:, 2]) + np.where(ways > 0.0, drift, 0.0) * np.diff(times)
        turns += math.radians(self.heading_walk_deg) * np.sqrt(ways) * rng.standard_normal(len(ways))
        headings = np.concatenate([[0.0], np.cumsum(turns)])
        cosine, sine = np.cos(headings[:-1] - angles[:-1, 2]), np.sin(headings[:-1] - angles[:-1, 2])
        moved = (1.0 + scale) * steps
        moved += self.walk * np.sqrt(ways)[:, None] * rng.standard_normal(steps.shape)
        turned = np.column_stack(
            [cosine * moved[:, 0] - sine * moved[:, 1], sine * moved[:, 0] + cosine * moved[:, 1], moved[:, 2]]
        )
        places = np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)])
        tilts = angles[:, :2] + math.radians(self.tilt_deg) * rng.standard_normal((len(times), 2))
        return [Pose(*row) for row in np.column_stack([places, tilts, headings]).tolist()]


def off_by(reference: Pose, errors: NDArray[np.float64]) -> Pose:
    """Return `reference` with errors of x, y, z (m), roll, pitch and heading (rad) added."""
    return Pose(*(reference.values + errors).tolist())


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
        return off_by(reference, bounds * rng.uniform(-1.0, 1.0, 6))


GEOREFERENCING_DEVIATION = 0.02
"""Standard deviation per axis, m."""
GEOREFERENCING_TIME = 30.0
"""s; two errors this far apart in time correlate by exp(-1/4), and a round apart not at all."""


class GeoreferencingErrors(NamedTuple):
    """Errors of a trajectory, and of the points placed by it: `offsets`, (k, 3), m, are added at `times`, (k,), s."""

    times: NDArray[np.float64]
    offsets: NDArray[np.float64]

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Errors at `times` (s), shape (n, 3), m."""
        return interpolated(times, self.times, self.offsets)


def draw_georeferencing_errors(
    seed: Seed, start: float, end: float, deviation: float = GEOREFERENCING_DEVIATION
) -> GeoreferencingErrors:
    """Return errors from `start` to `end` (s): a smooth stationary process per axis, `deviation` (m) large.

    White noise, one value per second, smoothed by a Gaussian. Errors dt apart correlate by
    exp(-dt^2 / (4 GEOREFERENCING_TIME^2)): by less than 0.001 after 160 s, and a round takes longer.
    """
    rng = np.random.default_rng(seed)
    reach = round(4.0 * GEOREFERENCING_TIME)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / GEOREFERENCING_TIME) ** 2)
    weights *= deviation / np.linalg.norm(weights)
    times = np.arange(np.floor(start), np.ceil(end) + 1.0)
    noise = rng.standard_normal((3, len(times) + 2 * reach))
    offsets = np.stack([np.convolve(row, weights, mode="valid") for row in noise], axis=1)
    return GeoreferencingErrors(times, offsets)
