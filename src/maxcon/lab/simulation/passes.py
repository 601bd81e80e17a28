# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Passes of the mapping vehicle along a circuit, and how each is georeferenced."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.lab.simulation.drive import Drive, Seed, sway
from maxcon.lab.simulation.streets import Circuit

DEVIATION = 0.02
"""Standard deviation per axis, m."""
CORRELATION_TIME = 30.0
"""s; two errors this far apart in time correlate by exp(-1/4), and a round apart not at all."""


@dataclass(frozen=True, slots=True, eq=False)
class GeoreferencingErrors:
    """Errors of a trajectory, and so of the points that were placed by it, over time.

    times: shape (k,); s, rising.
    offsets: shape (k, 3); what is added to true positions, m.
    """

    times: NDArray[np.float64]
    offsets: NDArray[np.float64]

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Errors at `times` (s), shape (n, 3), m."""
        wanted = np.asarray(times, dtype=np.float64)
        return np.stack([np.interp(wanted, self.times, column) for column in self.offsets.T], axis=1)


def draw_georeferencing_errors(
    seed: Seed, start: float, end: float, deviation: float = DEVIATION
) -> GeoreferencingErrors:
    """Return errors from `start` to `end` (s): a smooth stationary process per axis.

    seed: the same seed gives the same errors.
    start, end: first and last time, s.
    deviation: standard deviation per axis, m.

    White noise, one value per second, smoothed by a Gaussian. Errors dt apart correlate by
    exp(-dt^2 / (4 CORRELATION_TIME^2)): by less than 0.001 after 160 s, and a round takes longer.
    """
    rng = np.random.default_rng(seed)
    reach = round(4.0 * CORRELATION_TIME)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / CORRELATION_TIME) ** 2)
    weights *= deviation / np.linalg.norm(weights)
    times = np.arange(np.floor(start), np.ceil(end) + 1.0)
    noise = rng.standard_normal((3, len(times) + 2 * reach))
    offsets = np.stack([np.convolve(row, weights, mode="valid") for row in noise], axis=1)
    return GeoreferencingErrors(times, offsets)


STOP_LINE = 9.0
"""Distance from a stop line to the middle of its crossing, m."""
SLOWEST = 0.4
"""Speed just before and after a halt, m/s."""


@dataclass(frozen=True, slots=True)
class RoundDriver:
    """How a round is driven.

    speed: on free stretches, m/s; it varies by up to a fifth.
    turn_speed: in turns, m/s.
    crossing_speed: speed straight over crossings, as a part of `speed`, 0 to 1.
    acceleration: of starting and braking, m/s^2.
    n_stops: number of turns and crossings before which the vehicle waits.
    waits: shortest and longest wait, s.
    wander: largest distance to the left or right of the circuit, m.
    """

    speed: float
    turn_speed: float = 3.5
    crossing_speed: float = 0.7
    acceleration: float = 1.5
    n_stops: int = 0
    waits: tuple[float, float] = (4.0, 15.0)
    wander: float = 0.3

    def __post_init__(self) -> None:
        if not min(self.speed, self.turn_speed, self.crossing_speed, self.acceleration) > 0.0:
            raise OptionError(
                "Expected speeds, the part of it at crossings and an acceleration above 0, got"
                f" {self.speed} m/s, {self.turn_speed} m/s, {self.crossing_speed} and {self.acceleration} m/s^2."
                " Leave them out for the defaults."
            )


def drive_round(
    circuit: Circuit,
    driver: RoundDriver,
    seed: int | Sequence[int],
    *,
    height: float,
    start_time: float,
    duration: float | None = None,
) -> Drive:
    """Return the drive of `driver` once round `circuit`.

    circuit: the line to follow.
    driver: speeds and stops.
    seed: of speed, stops and sway: the same seed gives the same drive.
    height: of the sensor above the carriageway, m.
    start_time: of the first pose, s.
    duration: how long the round takes, s: speeds are scaled to fit, waits are not. If None, speeds are not scaled.
    """
    rng = np.random.default_rng(seed)
    distances = circuit.distances
    stops, waits = _draw_stops(circuit, driver, rng)
    speeds = _speeds(circuit, driver, stops, rng)
    times = np.concatenate([[0.0], np.cumsum(np.diff(distances) * 2.0 / (speeds[1:] + speeds[:-1]))])
    if duration is not None:
        if not duration > waits.sum():
            raise OptionError(
                f"Expected a round longer than its waits of {waits.sum():.1f} s, got {duration} s. Make it longer."
            )
        times *= (duration - waits.sum()) / times[-1]
    left = np.column_stack([-circuit.directions[:, 1], circuit.directions[:, 0]])
    places = circuit.points + left * sway(distances, driver.wander, (40.0, 200.0), rng)[:, None]
    steps = np.gradient(places, axis=0)
    angles = [sway(distances, math.radians(0.8), (6.0, 40.0), rng) for _ in ("roll", "pitch")]
    angles.append(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    heights = height + sway(distances, 0.02, (5.0, 30.0), rng)
    halts = np.searchsorted(distances, stops)
    times += np.bincount(halts + 1, weights=waits, minlength=len(times)).cumsum()[: len(times)]
    arrivals = times[halts]
    positions = np.column_stack([places, heights])
    return _with_halts(
        Drive(start_time + times, positions, np.column_stack(angles)), start_time + arrivals + waits, halts
    )


def _with_halts(drive: Drive, departures: NDArray[np.float64], halts: NDArray[np.int64]) -> Drive:
    """Return the drive with a second pose for each of its rows `halts`: the same one, at `departures` (s)."""
    return Drive(
        np.insert(drive.times, halts + 1, departures),
        np.insert(drive.positions, halts + 1, drive.positions[halts], axis=0),
        np.insert(drive.angles, halts + 1, drive.angles[halts], axis=0),
    )


def _draw_stops(
    circuit: Circuit, driver: RoundDriver, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw where (m along the circuit, rising) and how long (s) the vehicle waits, before turns and crossings."""
    places = np.sort(np.concatenate([circuit.turns[:, 0], circuit.crossings - STOP_LINE]))
    n_stops = min(driver.n_stops, len(places))
    stops = np.sort(rng.choice(places, n_stops, replace=False))
    return stops, rng.uniform(*driver.waits, n_stops)


def _speeds(
    circuit: Circuit, driver: RoundDriver, stops: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Speed at each point, m/s: as fast as limits allow, braking in time for turns, crossings and stops."""
    distances = circuit.distances
    speeds = driver.speed * (1.0 + sway(distances, 0.2, (25.0, 150.0), rng))
    slow_parts = [(begin, end, driver.turn_speed * rng.uniform(0.85, 1.15)) for begin, end in circuit.turns]
    slow_parts += [
        (place, place, driver.speed * driver.crossing_speed * rng.uniform(0.7, 1.3)) for place in circuit.crossings
    ]
    slow_parts += [(place, place, SLOWEST) for place in stops]
    for begin, end, slow in slow_parts:
        away = np.maximum(np.maximum(begin - distances, distances - end), 0.0)
        speeds = np.minimum(speeds, np.sqrt(slow**2 + 2.0 * driver.acceleration * away))
    return speeds
