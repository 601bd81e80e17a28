# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Drives: poses and times of a vehicle along a route."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose

Seed = int | Sequence[int]
"""A seed as numpy.random.default_rng takes it; the same seed draws the same."""


def check_seed(seed: int) -> None:
    """Check the seed of a world, from which all its streams begin."""
    if seed < 0:
        raise OptionError(f"Expected a seed of 0 or more, got {seed}. Take another whole number.")


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The line a vehicle follows.

    points: shape (k, 2); (x, y) every few centimetres, city metres.
    stop_at: distance along the route at which a vehicle slows down for the crossing, m.
    """

    points: NDArray[np.float64]
    stop_at: float

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each point along the route, shape (k,), m."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Poses of a vehicle over time, T_city_vehicle, close enough together to interpolate linearly.

    times: shape (k,); s, rising.
    positions: shape (k, 3); city metres.
    angles: shape (k, 3); roll, pitch and heading, rad; the heading does not jump at pi.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    angles: NDArray[np.float64]

    def at(self, times: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions and angles at `times` (s), shape (n, 3) each, m and rad."""
        wanted = np.asarray(times, dtype=np.float64)
        both = np.concatenate([self.positions, self.angles], axis=1)
        found = np.stack([np.interp(wanted, self.times, column) for column in both.T], axis=1)
        return found[:, :3], found[:, 3:]

    def poses(self, times: ArrayLike) -> list[Pose]:
        """Return the poses at `times` (s)."""
        positions, angles = self.at(times)
        return [Pose(*position, *angle) for position, angle in zip(positions.tolist(), angles.tolist(), strict=True)]


def drive_along(
    route: Route,
    seed: int | Sequence[int],
    *,
    speed: float = 8.0,
    slowest: float = 0.12,
    wait: float = 0.0,
    height: float = 2.0,
    start_time: float = 0.0,
) -> Drive:
    """Return a drive along `route` that changes speed, slows down for the crossing and sways a little.

    route: the line to follow.
    seed: of speed and sway: the same seed gives the same drive.
    speed: on the straight parts, m/s; it varies by about a fifth.
    slowest: lowest speed, at the crossing, as a part of `speed`, above 0 and up to 1.
    wait: how long it stands at the crossing, as at a red light, s.
    height: of the sensor above the carriageway, m.
    start_time: of the first pose, s.
    """
    if not 0.0 <= wait < math.inf:
        raise OptionError(f"Expected a wait of 0 s or more, got {wait}. With 0 the vehicle does not stop.")
    if not (speed > 0.0 and 0.0 < slowest <= 1.0):
        raise OptionError(
            f"Expected a speed above 0 m/s and a slowest part of it above 0 and up to 1, got {speed}"
            f" and {slowest}. Leave them out for the defaults."
        )
    rng = np.random.default_rng(seed)
    distances = route.distances
    dip = 1.0 - (1.0 - slowest) * np.exp(-(((distances - route.stop_at) / 6.0) ** 2))
    speeds = speed * dip * (1.0 + sway(distances, 0.2, (25.0, 80.0), rng))
    times = start_time + np.concatenate([[0.0], np.cumsum(np.diff(distances) * 2.0 / (speeds[1:] + speeds[:-1]))])
    steps = np.gradient(route.points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    roll = sway(distances, math.radians(0.8), (6.0, 40.0), rng)
    pitch = sway(distances, math.radians(0.8), (6.0, 40.0), rng)
    z = height + sway(distances, 0.02, (5.0, 30.0), rng)
    positions, angles = np.column_stack([route.points, z]), np.column_stack([roll, pitch, heading])
    if wait == 0.0:
        return Drive(times, positions, angles)
    # The pose of the stop stands twice in a row: at the arrival and at the departure.
    stop = int(np.searchsorted(distances, route.stop_at))
    order = np.insert(np.arange(len(times)), stop, stop)
    times = times[order] + np.where(np.arange(len(order)) > stop, wait, 0.0)
    return Drive(times, positions[order], angles[order])


def sway(
    distances: NDArray[np.float64], amplitude: float, wavelengths: tuple[float, float], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a smooth random function of the distance (m), shape (k,): a mean of four sines, within +-`amplitude`.

    wavelengths : least and largest, m.
    """
    waves = rng.uniform(*wavelengths, 4)
    phases = rng.uniform(0.0, 2.0 * math.pi, 4)
    sines = np.sin(2.0 * math.pi * distances[:, None] / waves + phases)
    return np.asarray(amplitude * sines.mean(axis=1), dtype=np.float64)
