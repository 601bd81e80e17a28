# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The world of the suburb."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive, check_seed, drive_along
from maxcon.lab.simulation.measured_poses import GnssErrors, PriorErrors
from maxcon.lab.simulation.passes import draw_georeferencing_errors
from maxcon.lab.simulation.ray_caster import RayCaster, check_embreex
from maxcon.lab.simulation.scanners import Echoes, MovingScanner
from maxcon.lab.simulation.suburb_ground import ResidentialRoad, draw_road
from maxcon.lab.simulation.suburb_scene import suburb_on_day
from maxcon.lab.simulation.world import (
    EPOCH_STEP,
    MAP_HEIGHT,
    MAP_START,
    PAUSE,
    SCAN_START,
    MappingDrives,
    ScanEpoch,
    evenly_spread_epochs,
    gnss_priors,
    uniform_priors,
)

ROAD_LENGTH = 460.0
"""Default, m: a minute at 28 km/h."""
MEAN_SPEED = ROAD_LENGTH / 60.0
"""Mean speed of the car, m/s: a road of the default length has 601 epochs."""
MAP_BEYOND = 35.0
"""How far the mapping drives extend beyond both ends of the road, m."""
SCAN_HEIGHT = 1.8
"""Of the scanner above the carriageway, m."""
LANE_THERE, LANE_BACK = -1.2, 0.1
"""Lanes, m to the left of the centre line: on the way back, parked cars force the vehicle to the middle."""


class _Stream(IntEnum):
    """Random streams of a seed, one per thing that is drawn, so that one can change without the others."""

    ROAD = 0
    SCENE = 1
    DAY_OF_MAP = 2
    DAY_OF_SCANS = 3
    MAP_DRIVE = 4
    SCAN_DRIVE = 5
    MAP_NOISE = 6
    SCAN_NOISE = 7
    UNIFORM_PRIORS = 8
    GNSS_PRIORS = 9
    GEOREFERENCING = 10


@dataclass(frozen=True, slots=True, eq=False)
class SuburbWorld:
    """The suburb before anything is measured.

    seed: everything random is drawn from it.
    road: the road that all drives follow.
    mapping: the drives of the mapping vehicle, there and back, through the suburb on the day of the map.
    scan_caster: the suburb on the day of the scans: leaves, cars and bins differ.
    scan_drive: drive of the car; it begins about a second before the first epoch and ends as long after the last.
    """

    seed: int
    road: ResidentialRoad
    mapping: MappingDrives
    scan_caster: RayCaster
    scan_drive: Drive

    @classmethod
    def build(cls, seed: int, road_length: float = ROAD_LENGTH) -> Self:
        """Return the world of `seed` along a road of `road_length` (m)."""
        check_seed(seed)
        check_embreex()
        road = draw_road(road_length, [seed, _Stream.ROAD])
        days = (_Stream.DAY_OF_MAP, _Stream.DAY_OF_SCANS)
        map_caster, scan_caster = (RayCaster(suburb_on_day(road, seed, _Stream.SCENE, day)) for day in days)
        drives = _mapping_drives(road, seed)
        return cls(
            seed=seed,
            road=road,
            mapping=MappingDrives(
                map_caster,
                drives,
                [seed, _Stream.MAP_NOISE],
                draw_georeferencing_errors(
                    [seed, _Stream.GEOREFERENCING], float(drives[0].times[0]), float(drives[-1].times[-1])
                ),
            ),
            scan_caster=scan_caster,
            scan_drive=_scan_drive(road, seed),
        )

    @property
    def most_epochs(self) -> int:
        """Number of scans of the whole drive, 0.1 s apart."""
        return n_epochs_on(self.road.length)

    def epochs(self, n_epochs: int) -> list[ScanEpoch]:
        """Return `n_epochs` of the whole drive, spread evenly; the first and the last are among them."""
        return evenly_spread_epochs(self.scan_drive, n_epochs, self.most_epochs, SCAN_START)

    def gnss_priors(self, epochs: Sequence[ScanEpoch], errors: GnssErrors) -> list[Pose]:
        """Priors, T_city_sensor, whose errors change slowly over the drive."""
        return gnss_priors(epochs, errors, self.most_epochs, [self.seed, _Stream.GNSS_PRIORS])

    def uniform_priors(self, epochs: Sequence[ScanEpoch], errors: PriorErrors) -> list[Pose]:
        """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
        return uniform_priors(epochs, errors, [self.seed, _Stream.UNIFORM_PRIORS])

    def scan(self, epoch: ScanEpoch, scanner: MovingScanner) -> Echoes:
        """Measure the scan of one epoch while the car moves; it does not depend on which other epochs are taken."""
        rng = np.random.default_rng([self.seed, _Stream.SCAN_NOISE, epoch.tick])
        return scanner.scan(self.scan_caster, self.scan_drive, epoch.time, rng)


def n_epochs_on(road_length: float) -> int:
    """Number of scans, 0.1 s apart, of the drive along a road of `road_length` (m)."""
    return 1 + round(road_length / MEAN_SPEED / EPOCH_STEP)


def _mapping_drives(road: ResidentialRoad, seed: int) -> tuple[Drive, ...]:
    """Return a drive there and one back, each of which slows down at some place."""
    drives: list[Drive] = []
    start = MAP_START
    for i, lane in enumerate((LANE_THERE, LANE_BACK)):
        stream = [seed, _Stream.MAP_DRIVE, i]
        route = road.route(lane, [*stream, 0], start=MAP_BEYOND, is_back=i % 2 == 1)
        level = drive_along(route, [*stream, 1], slowest=0.3, height=MAP_HEIGHT, start_time=start)
        drives.append(road.on_ground(level))
        start = float(level.times[-1]) + PAUSE
    return tuple(drives)


def _scan_drive(road: ResidentialRoad, seed: int) -> Drive:
    """Return the drive of the car: it begins 8 m before the road and ends 8 m after it, where there is no epoch."""
    stream = [seed, _Stream.SCAN_DRIVE]
    route = road.route(LANE_THERE, [*stream, 0], start=8.0)
    level = road.on_ground(drive_along(route, [*stream, 1], slowest=0.4, height=SCAN_HEIGHT))
    duration = EPOCH_STEP * (n_epochs_on(road.length) - 1)
    first, last = np.interp([8.0, 8.0 + road.length], route.distances, level.times)
    return replace(level, times=SCAN_START + (level.times - first) * duration / (last - first))
