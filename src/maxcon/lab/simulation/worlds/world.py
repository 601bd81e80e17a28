# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SimulatedWorld: a city on the day of its mapping and on a later one, and the drives through it."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive, drive_along
from maxcon.lab.simulation.driving.crossing_route import route_over_crossing
from maxcon.lab.simulation.driving.prior_errors import PriorErrors
from maxcon.lab.simulation.scenes.city import build_city
from maxcon.lab.simulation.seed import check_seed
from maxcon.lab.simulation.sensing.ray_caster import RayCaster
from maxcon.lab.simulation.sensing.scanners import Echoes, RotatingScanner
from maxcon.lab.simulation.worlds.mapping_drives import MAP_HEIGHT, MAP_START, PAUSE, MappingDrives
from maxcon.lab.simulation.worlds.scan_epochs import SCAN_START

__all__ = ["Epoch", "SimulatedWorld"]

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
