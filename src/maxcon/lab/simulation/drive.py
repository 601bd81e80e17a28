# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Drives: poses and times of a vehicle along a route once, or round a circuit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose

Seed = int | Sequence[int]
"""A seed as numpy.random.default_rng takes it; the same seed draws the same."""
SPEED = 8.0
"""Of a drive along a route on its straight parts, m/s; it varies by about a fifth."""
CROSSING_SPEED = 0.7
"""Speed of a round straight over crossings, as a part of its speed on free stretches."""
WAITS = (4.0, 15.0)
"""Shortest and longest wait of a round, s."""
WANDER = 0.3
"""Largest distance of a round to the left or right of its circuit, m."""
STOP_LINE = 9.0
"""Distance from a stop line to the middle of its crossing, m."""
SLOWEST = 0.4
"""Speed just before and after a halt in a round, m/s."""


class Route(NamedTuple):
    """The line a vehicle follows.

    points: shape (k, 2); (x, y) every few centimetres, city metres.
    stop_at: distance along the route at which a vehicle slows down for the crossing, m.
    """

    points: NDArray[np.float64]
    stop_at: float

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each point along the route, shape (k,), m."""
        return distances_along(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class Circuit:
    """A closed line along streets; its last point equals the first.

    points: shape (k, 2); (x, y) evenly spaced, about 5 cm apart, city metres.
    turns: shape (n, 2); distance along the line at which each turn begins and ends, m, rising.
    crossings: shape (m,); distance along the line of each crossing that it passes straight over, m, rising.
    """

    points: NDArray[np.float64]
    turns: NDArray[np.float64]
    crossings: NDArray[np.float64]

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each point along the line, shape (k,), m."""
        return np.linspace(0.0, self.length, len(self.points))

    @property
    def length(self) -> float:
        """Length of one round, m."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vector of travel at each point, shape (k, 2); the last equals the first."""
        around = np.concatenate([self.points[-2:-1], self.points, self.points[1:2]])
        ways = around[2:] - around[:-2]
        return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


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
        found = interpolated(times, self.times, np.concatenate([self.positions, self.angles], axis=1))
        return found[:, :3], found[:, 3:]

    def poses(self, times: ArrayLike) -> list[Pose]:
        """Return the poses at `times` (s)."""
        return [Pose(*row) for row in np.concatenate(self.at(times), axis=1).tolist()]


def drive_along(
    route: Route, seed: Seed, *, slowest: float = 0.12, wait: float = 0.0, height: float = 2.0, start_time: float = 0.0
) -> Drive:
    """Return a drive along `route` that changes speed, slows down for the crossing and sways a little.

    slowest: lowest speed, at the crossing, as a part of `SPEED`, above 0 and up to 1.
    wait: how long it stands at the crossing, as at a red light, s; `OptionError` if below 0.
    height: of the sensor above the carriageway, m.
    start_time: of the first pose, s.
    """
    if not 0.0 <= wait < math.inf:
        raise OptionError(f"Expected a wait of 0 s or more, got {wait}. With 0 the vehicle does not stop.")
    rng = np.random.default_rng(seed)
    distances = route.distances
    dip = 1.0 - (1.0 - slowest) * np.exp(-(((distances - route.stop_at) / 6.0) ** 2))
    speeds = SPEED * dip * (1.0 + sway(distances, 0.2, (25.0, 80.0), rng))
    drive = _swaying(route.points, start_time + _times(distances, speeds), distances, height, rng)
    if wait == 0.0:
        return drive
    return _with_halts(drive, np.searchsorted(distances, [route.stop_at]), np.array([wait]))


class RoundDriver(NamedTuple):
    """How a round is driven.

    speed: on free stretches, m/s; it varies by up to a fifth.
    turn_speed: in turns, m/s.
    acceleration: of starting and braking, m/s^2.
    n_stops: number of turns and crossings before which the vehicle waits.
    """

    speed: float
    turn_speed: float = 3.5
    acceleration: float = 1.5
    n_stops: int = 0


def drive_round(
    circuit: Circuit,
    driver: RoundDriver,
    seed: Seed,
    *,
    height: float,
    start_time: float,
    duration: float | None = None,
) -> Drive:
    """Return the drive of `driver` once round `circuit`: see `drive_along`.

    duration: how long the round takes, s: speeds are scaled to fit, waits are not. If None, speeds are not scaled.
    """
    rng = np.random.default_rng(seed)
    distances = circuit.distances
    # Vehicles wait before turns and crossings.
    places = np.sort(np.concatenate([circuit.turns[:, 0], circuit.crossings - STOP_LINE]))
    stops = np.sort(rng.choice(places, min(driver.n_stops, len(places)), replace=False))
    waits = rng.uniform(*WAITS, len(stops))
    times = _times(distances, _speeds_round(circuit, driver, stops, rng))
    if duration is not None:
        times *= (duration - waits.sum()) / times[-1]
    left = np.column_stack([-circuit.directions[:, 1], circuit.directions[:, 0]])
    points = circuit.points + left * sway(distances, WANDER, (40.0, 200.0), rng)[:, None]
    drive = _swaying(points, times, distances, height, rng)
    return _with_halts(drive, np.searchsorted(distances, stops), waits, start_time)


def _speeds_round(
    circuit: Circuit, driver: RoundDriver, stops: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Speed at each point, m/s: as fast as limits allow, braking in time for turns, crossings and stops."""
    distances = circuit.distances
    speeds = driver.speed * (1.0 + sway(distances, 0.2, (25.0, 150.0), rng))
    slow_parts = [(begin, end, driver.turn_speed * rng.uniform(0.85, 1.15)) for begin, end in circuit.turns]
    slow_parts += [(place, place, driver.speed * CROSSING_SPEED * rng.uniform(0.7, 1.3)) for place in circuit.crossings]
    slow_parts += [(place, place, SLOWEST) for place in stops]
    for begin, end, slow in slow_parts:
        away = np.maximum(np.maximum(begin - distances, distances - end), 0.0)
        speeds = np.minimum(speeds, np.sqrt(slow**2 + 2.0 * driver.acceleration * away))
    return speeds


def _times(distances: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Times from 0 on, s, at which a vehicle with `speeds` (m/s) is at `distances` (m)."""
    return np.concatenate([[0.0], np.cumsum(np.diff(distances) * 2.0 / (speeds[1:] + speeds[:-1]))])


def _swaying(
    points: NDArray[np.float64],
    times: NDArray[np.float64],
    distances: NDArray[np.float64],
    height: float,
    rng: np.random.Generator,
) -> Drive:
    """Drive that is at `points`, shape (k, 2), at `times`: it rolls and pitches, and its height sways, a little."""
    steps = np.gradient(points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    roll, pitch = (sway(distances, math.radians(0.8), (6.0, 40.0), rng) for _ in range(2))
    z = height + sway(distances, 0.02, (5.0, 30.0), rng)
    return Drive(times, np.column_stack([points, z]), np.column_stack([roll, pitch, heading]))


def _with_halts(drive: Drive, halts: NDArray[np.int64], waits: NDArray[np.float64], start_time: float = 0.0) -> Drive:
    """Drive that begins later by `start_time` (s) and waits (s) at its rows `halts`: there a pose stands twice."""
    times = drive.times + np.bincount(halts + 1, weights=waits, minlength=len(drive.times)).cumsum()[: len(drive.times)]
    return Drive(
        np.insert(start_time + times, halts + 1, start_time + times[halts] + waits),
        np.insert(drive.positions, halts + 1, drive.positions[halts], axis=0),
        np.insert(drive.angles, halts + 1, drive.angles[halts], axis=0),
    )


def sway(
    distances: NDArray[np.float64], amplitude: float, wavelengths: tuple[float, float], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a smooth random function of the distance (m), shape (k,): a mean of four sines, within +-`amplitude`."""
    waves = rng.uniform(*wavelengths, 4)
    phases = rng.uniform(0.0, 2.0 * math.pi, 4)
    sines = np.sin(2.0 * math.pi * distances[:, None] / waves + phases)
    return np.asarray(amplitude * sines.mean(axis=1), dtype=np.float64)


def distances_along(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each of `points`, shape (k, d), along the line through them, shape (k,), m."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def interpolated(wanted: ArrayLike, known: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Columns of `values`, shape (k, d), known at `known`, shape (k,), at `wanted`, shape (n,): shape (n, d)."""
    return np.stack([np.interp(np.asarray(wanted, np.float64), known, column) for column in values.T], axis=1)
