# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Simulated worlds: a scene, the drives that map it, the pieces of its map, the epochs that are scanned."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.city import build_city
from maxcon.lab.simulation.drive import Drive, check_seed, drive_along
from maxcon.lab.simulation.measured_poses import GnssErrors, PriorErrors, off_by
from maxcon.lab.simulation.passes import GeoreferencingErrors
from maxcon.lab.simulation.ray_caster import Caster, RayCaster
from maxcon.lab.simulation.scanners import Echoes, ProfileScanner, RotatingScanner
from maxcon.lab.simulation.streets import route_over_crossing

MAP_START = 300_000.0
"""When the mapping vehicle sets out, seconds of the GPS week."""
PAUSE = 60.0
"""From the end of one of its drives to the start of the next, s."""
MAP_HEIGHT = 2.4
"""Of its profile scanners above the carriageway, m."""


@dataclass(frozen=True, slots=True, eq=False)
class MappingDrives:
    """The drives of the mapping vehicle, before anything is measured on them.

    caster: the scene on the day of the map.
    drives: true drives, one after the other.
    seed: of the scanners' noise.
    georeferencing: errors of the vehicle's post-processed trajectory, and so of the map; none if None.
    """

    caster: RayCaster
    drives: tuple[Drive, ...]
    seed: Sequence[int]
    georeferencing: GeoreferencingErrors | None = None

    def n_pieces(self, scanners: Sequence[ProfileScanner]) -> int:
        """How many pieces `echoes` yields."""
        return len(map_pieces(self.drives, scanners))

    def echoes(self, scanners: Sequence[ProfileScanner]) -> Iterator[Echoes]:
        """Measure the map piece by piece, in order of time, placed by the vehicle's trajectory with its errors."""
        for echoes in map_echoes(self.caster, map_pieces(self.drives, scanners), self.seed):
            if self.georeferencing is None:
                yield echoes
            else:
                offsets = self.georeferencing.at(echoes.times)
                yield echoes._replace(points=echoes.points + offsets, origins=echoes.origins + offsets)

    def poses(self) -> tuple[NDArray[np.float64], list[Pose]]:
        """Times (s) and poses (T_city_vehicle) of the mapping vehicle, with the errors of its trajectory."""
        times, poses = drive_poses(self.drives)
        if self.georeferencing is None:
            return times, poses
        offsets = self.georeferencing.at(times)
        return times, [pose.translated(offset) for pose, offset in zip(poses, offsets, strict=True)]


SCAN_START = 386_400.0
"""Seconds of the GPS week: the car comes a day after the mapping vehicle."""
EPOCH_STEP = 0.1
"""Between two epochs when all are taken, s: the scanner turns ten times a second."""


class ScanEpoch(NamedTuple):
    """A scan to take: its number, in steps of the scanner from 0 (tick), time (s), reference pose T_city_sensor."""

    tick: int
    time: float
    reference: Pose


def evenly_spread_epochs(drive: Drive, n_epochs: int, most_epochs: int, start: float) -> list[ScanEpoch]:
    """Return `n_epochs`, evenly spread, of `most_epochs` from `start` (s) on; with the first and the last."""
    return _at_ticks(drive, np.rint(np.linspace(0, most_epochs - 1, n_epochs)).astype(np.int64), start)


def successive_epochs(drive: Drive, n_epochs: int, ticks_apart: int, start: float) -> list[ScanEpoch]:
    """Return `n_epochs` from `start` (s) on, `ticks_apart` steps of the scanner apart."""
    return _at_ticks(drive, ticks_apart * np.arange(n_epochs, dtype=np.int64), start)


def _at_ticks(drive: Drive, ticks: NDArray[np.int64], start: float) -> list[ScanEpoch]:
    times = np.round(start + EPOCH_STEP * ticks, 6)
    return [
        ScanEpoch(tick, time, pose)
        for tick, time, pose in zip(ticks.tolist(), times.tolist(), drive.poses(times), strict=True)
    ]


def gnss_priors(epochs: Sequence[ScanEpoch], errors: GnssErrors, most_epochs: int, seed: Sequence[int]) -> list[Pose]:
    """Priors, T_city_sensor, whose errors change slowly over the drive of `most_epochs`."""
    rows = errors.draw(most_epochs, EPOCH_STEP, seed)
    return [off_by(epoch.reference, rows[epoch.tick].tolist()) for epoch in epochs]


def uniform_priors(epochs: Sequence[ScanEpoch], errors: PriorErrors, seed: Sequence[int]) -> list[Pose]:
    """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
    return [errors.prior(epoch.reference, np.random.default_rng([*seed, epoch.tick])) for epoch in epochs]


LINES_PER_PIECE = 250
TRAJECTORY_STEP = 0.02
"""Between two poses of the mapping vehicle's trajectory, s."""


class MapPiece(NamedTuple):
    """At most 250 successive profiles of one scanner on one drive, from number `first` on."""

    drive: Drive
    scanner: ProfileScanner
    first: int


def map_pieces(drives: Sequence[Drive], scanners: Sequence[ProfileScanner]) -> list[MapPiece]:
    """Return all pieces of `drives`, in order of time."""
    pieces = [
        MapPiece(drive, scanner, first)
        for drive in drives
        for scanner in scanners
        for first in range(0, scanner.n_lines(drive), LINES_PER_PIECE)
    ]
    return sorted(pieces, key=lambda piece: piece.drive.times[0] + piece.first / piece.scanner.line_rate)


def map_echoes(caster: Caster, pieces: Sequence[MapPiece], seed: Sequence[int]) -> Iterator[Echoes]:
    """Measure `pieces` one by one.

    caster: the world on the day of the map.
    pieces: those of `map_pieces`.
    seed: of the noise; each piece has a stream of its own.
    """
    for i, (drive, scanner, first) in enumerate(pieces):
        n_lines = min(LINES_PER_PIECE, scanner.n_lines(drive) - first)
        yield scanner.scan(caster, drive, first, n_lines, np.random.default_rng([*seed, i]))


def drive_poses(drives: Sequence[Drive]) -> tuple[NDArray[np.float64], list[Pose]]:
    """Times (s) and poses (T_city_vehicle) of `drives`, 0.02 s apart, one drive after the other."""
    times = [np.arange(drive.times[0], drive.times[-1], TRAJECTORY_STEP) for drive in drives]
    poses = [pose for drive, t in zip(drives, times, strict=True) for pose in drive.poses(t)]
    return np.concatenate(times), poses


MAP_BEYOND = 35.0
"""How far the first mapping drive extends beyond the drive of the scans at either end, m."""
MAP_BRANCHES = (50.0, 40.0)
"""Distance from the crossing at which the second mapping drive, over the other two branches, begins and ends, m."""
MAP_SPEED = 8.0
"""m/s: 100 profiles per second lie 8 cm apart."""


class _Stream(IntEnum):
    """Random streams of a seed, one per thing that is drawn, so that one can change without the others."""

    CITY = 0
    CARS_OF_MAP = 1
    CARS_OF_SCANS = 2
    MAP_DRIVE = 3
    SCAN_DRIVE = 4
    MAP_NOISE = 5
    SCAN_NOISE = 6
    PRIORS = 7


class Epoch(NamedTuple):
    """One scan to take: its number from 0, time (s), reference pose and prior, T_city_sensor."""

    number: int
    time: float
    reference: Pose
    prior: Pose


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedWorld:
    """A city with its drives, before anything is measured.

    seed: everything random is drawn from it.
    mapping: drives of the mapping vehicle through the city on the day of the map: two, so that each branch of the
        crossing is mapped.
    scan_caster: the city on the day of the scans: other cars are parked.
    scan_drive: drive of the car with the rotating scanner.
    """

    seed: int
    mapping: MappingDrives
    scan_caster: RayCaster
    scan_drive: Drive

    @classmethod
    def build(cls, seed: int, before: float = 75.0, after: float = 50.0, mapping_wait: float = 0.0) -> Self:
        """Return the world of `seed`.

        The scans begin `before` and end `after` (m) from the middle of the crossing; the mapping vehicle stops in front
        of it for `mapping_wait` (s).
        """
        check_seed(seed)
        city = build_city([seed, _Stream.CITY])
        route = route_over_crossing(city.street_angle, before, after)
        return cls(
            seed=seed,
            mapping=MappingDrives(
                RayCaster(city.with_parked_cars([seed, _Stream.CARS_OF_MAP])),
                _mapping_drives(seed, city.street_angle, before, after, mapping_wait),
                [seed, _Stream.MAP_NOISE],
            ),
            scan_caster=RayCaster(city.with_parked_cars([seed, _Stream.CARS_OF_SCANS])),
            scan_drive=drive_along(route, [seed, _Stream.SCAN_DRIVE], slowest=0.25, start_time=SCAN_START),
        )

    def epochs(self, n_epochs: int, errors: PriorErrors) -> list[Epoch]:
        """Return `n_epochs` epochs evenly spaced in time, with priors drawn from `errors`."""
        times = np.round(np.linspace(self.scan_drive.times[0], self.scan_drive.times[-1], n_epochs), 6)
        rng = np.random.default_rng([self.seed, _Stream.PRIORS])
        return [
            Epoch(number, time, reference, errors.prior(reference, rng))
            for number, (time, reference) in enumerate(zip(times.tolist(), self.scan_drive.poses(times), strict=True))
        ]

    def scan(self, epoch: Epoch, scanner: RotatingScanner) -> Echoes:
        """Measure the scan of one epoch from its reference pose."""
        rng = np.random.default_rng([self.seed, _Stream.SCAN_NOISE, epoch.number])
        return scanner.scan(self.scan_caster, epoch.reference, epoch.time, rng)


def _mapping_drives(seed: int, street_angle: float, before: float, after: float, wait: float) -> tuple[Drive, ...]:
    """Return a drive along the route of the scans and beyond it, and one over the other two branches."""
    routes = [
        route_over_crossing(street_angle, before + MAP_BEYOND, after + MAP_BEYOND, lane=1.7),
        route_over_crossing(street_angle + math.pi, *MAP_BRANCHES, lane=1.6),
    ]
    drives: list[Drive] = []
    start = MAP_START
    for i, route in enumerate(routes):
        stream = [seed, _Stream.MAP_DRIVE, i]
        drives.append(
            drive_along(
                route,
                stream,
                speed=MAP_SPEED,
                slowest=0.2,
                wait=wait if i == 0 else 0.0,
                height=MAP_HEIGHT,
                start_time=start,
            )
        )
        start = float(drives[-1].times[-1]) + PAUSE
    return tuple(drives)
