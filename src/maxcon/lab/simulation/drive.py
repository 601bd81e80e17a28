"""Drives along a route or round a circuit, and their poses as vehicles measure them: priors, odometry, trajectories."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.search.accumulator import NamedOption

Seed = int | Sequence[int]  # a seed as numpy.random.default_rng takes it; the same seed draws the same
SPEED = 8.0  # of a drive along a route on its straight parts, m/s; it varies by about a fifth
CROSSING_SPEED = 0.7  # speed of a round straight over crossings, as a part of its speed on free stretches
WAITS = (4.0, 15.0)  # shortest and longest wait of a round, s
WANDER = 0.3  # largest distance of a round to the left or right of its circuit, m
STOP_LINE = 9.0  # distance from a stop line to the middle of its crossing, m
SLOWEST = 0.4  # speed just before and after a halt in a round, m/s
WALKING_SPEED = 1.4  # m/s; it varies by about a fifth
HAND_TILT = math.radians(20.0)  # largest roll and pitch of a scanner in the hand, rad


class Carrier(NamedOption, option="carrier"):
    """Who carries the scanner."""

    CAR = "car"
    """On the road, 2 m high, all but level."""
    HAND = "hand"
    """On the sidewalk, 1 to 2 m high, rolling and pitching by up to 20 degrees."""


class Route(NamedTuple):
    """The line a vehicle follows."""

    points: NDArray[np.float64]  # (k, 2): (x, y) every few centimetres, city metres
    stop_at: float  # distance along the route at which a vehicle slows down for the crossing, m

    @property
    def distances(self) -> NDArray[np.float64]:
        """Distance of each point along the route, shape (k,), m."""
        return distances_along(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class Circuit:
    """A closed line along streets; its last point equals the first."""

    points: NDArray[np.float64]  # (k, 2): (x, y) evenly spaced, about 5 cm apart, city metres
    turns: NDArray[np.float64]  # (n, 2): distance along the line at which each turn begins and ends, m, rising
    # (m,): distance along the line of each crossing that it passes straight over, m, rising
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
    """Poses of a vehicle over time, T_city_vehicle, close enough together to interpolate linearly."""

    times: NDArray[np.float64]  # (k,): s, rising
    positions: NDArray[np.float64]  # (k, 3): city metres
    angles: NDArray[np.float64]  # (k, 3): roll, pitch and heading, rad; the heading does not jump at pi

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
    """Return a drive along `route` that slows down to `slowest` times `SPEED` at the crossing, and waits there, s."""
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


def walk_along(route: Route, seed: Seed, *, start_time: float = 0.0) -> Drive:
    """Return a walk along `route` with a scanner in the hand (`Carrier.HAND`), from `start_time` (s) on."""
    rng = np.random.default_rng(seed)
    distances = route.distances
    speeds = WALKING_SPEED * (1.0 + sway(distances, 0.2, (5.0, 20.0), rng))
    heights = 1.5 + 0.5 * np.sin(sway(distances, math.pi, (10.0, 40.0), rng))
    roll, pitch = (HAND_TILT * np.sin(sway(distances, math.pi, (2.0, 12.0), rng)) for _ in range(2))
    angles = np.column_stack([roll, pitch, _headings(route.points)])
    return Drive(start_time + _times(distances, speeds), np.column_stack([route.points, heights]), angles)


class RoundDriver(NamedTuple):
    """How a round is driven."""

    speed: float  # on free stretches, m/s; it varies by up to a fifth
    turn_speed: float = 3.5  # in turns, m/s
    acceleration: float = 1.5  # of starting and braking, m/s^2
    n_stops: int = 0  # number of turns and crossings before which the vehicle waits


def drive_round(
    circuit: Circuit, driver: RoundDriver, seed: Seed, *, height: float, start_time: float,
    duration: float | None = None,
) -> Drive:  # fmt: skip
    """Return the drive of `driver` once round `circuit`; speeds, not waits, are scaled to a `duration`, s."""
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
    points: NDArray[np.float64], times: NDArray[np.float64], distances: NDArray[np.float64], height: float,
    rng: np.random.Generator,
) -> Drive:  # fmt: skip
    """Drive that is at `points`, shape (k, 2), at `times`: it rolls and pitches, and its height sways, a little."""
    roll, pitch = (sway(distances, math.radians(0.8), (6.0, 40.0), rng) for _ in range(2))
    z = height + sway(distances, 0.02, (5.0, 30.0), rng)
    return Drive(times, np.column_stack([points, z]), np.column_stack([roll, pitch, _headings(points)]))


def _headings(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Direction of travel at each of `points`, shape (k, 2), rad, without jumps."""
    steps = np.gradient(points, axis=0)
    return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))


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


GNSS_DEVIATIONS = np.array([1.3, 1.3, 0.015, *np.radians([0.05, 0.05, 0.6])])
"""Standard deviations of x, y, z (m), roll, pitch and heading (rad), before they are reflected at their bounds.

1.17 m along x and y after the reflection; the height's is small: it is taken for known from the map's ground.
"""
GNSS_BOUNDS = np.array([2.7, 2.7, 0.04, *np.radians([0.15, 0.15, 1.8])])
"""Largest errors of the same: multipath between houses, within the paper's search range of 3 m."""
GNSS_CORRELATION_TIME = 20.0  # time after which two errors correlate by 1/e, s


def draw_gnss_errors(n_times: int, step: float, seed: Seed) -> NDArray[np.float64]:
    """First-order Gauss-Markov errors of x, y, z, roll, pitch, heading (m, rad) each `step` (s), shape (n_times, 6)."""
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
    """Errors of the motions that odometry measures."""

    scale: float = 0.01  # relative error of all distances, 0.01 for 1 %; its sign is drawn at random
    # Bias of the gyroscope while the vehicle moves, degrees per second; its sign is drawn at random
    heading_drift_deg: float = 0.05
    heading_walk_deg: float = 0.1  # random walk of the heading: standard deviation, degrees per square root of a metre
    walk: float = 0.005  # random walk of the position along each axis: standard deviation, m per square root of a metre
    tilt_deg: float = 0.02  # standard deviation of roll and pitch, degrees; gravity keeps them from drifting

    def draw(self, drive: Drive, times: NDArray[np.float64], seed: Seed) -> list[Pose]:
        """Return poses as odometry gives them at rising times (s): the first is at the origin, heading along x."""
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
    """Bounds of the errors of a prior: each error is uniform within plus and minus its bound."""

    offset: float = 2.5  # of x and of y, m
    heading_deg: float = 1.8  # of the heading, degrees
    z: float = 0.01  # of the height, m
    tilt_deg: float = 0.05  # of roll and of pitch, degrees

    def prior(self, reference: Pose, rng: np.random.Generator) -> Pose:
        """Return a prior: `reference` with errors drawn from `rng`."""
        tilt, turn = math.radians(self.tilt_deg), math.radians(self.heading_deg)
        bounds = np.array([self.offset, self.offset, self.z, tilt, tilt, turn])
        return off_by(reference, bounds * rng.uniform(-1.0, 1.0, 6))


GEOREFERENCING_DEVIATION = 0.02  # standard deviation per axis, m
GEOREFERENCING_TIME = 30.0  # s; two errors this far apart in time correlate by exp(-1/4), and a round apart not at all


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
