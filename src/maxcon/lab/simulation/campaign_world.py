# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The world of the campaign: a circuit mapped in five passes, driven on another day."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.lab.simulation.city import City, build_city, build_periodic_city
from maxcon.lab.simulation.drive import Drive, check_seed
from maxcon.lab.simulation.measured_poses import GnssErrors, OdometryErrors, PriorErrors
from maxcon.lab.simulation.passes import RoundDriver, draw_georeferencing_errors, drive_round
from maxcon.lab.simulation.ray_caster import Caster, RayCaster, check_embreex
from maxcon.lab.simulation.scanners import Echoes, RotatingScanner
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, Circuit, circuit_through
from maxcon.lab.simulation.traffic import CrowdedCaster, Traffic
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
    successive_epochs,
    uniform_priors,
)

MOST_EPOCHS = 3001
ROUND_TIME = (MOST_EPOCHS - 1) * EPOCH_STEP
"""How long the round of the car takes, s."""
SCAN_HEIGHT = 2.0
"""Of the scanner above the carriageway, m."""
OCCUPANCY, HARD_OCCUPANCY = 0.85, 0.95
"""Which part of the kerbs is taken by parked cars, 0 to 1."""
SCAN_DRIVER = RoundDriver(speed=5.5, turn_speed=2.8, n_stops=1)


class _Stream(IntEnum):
    """Random streams of a seed, one per thing that is drawn, so that one can change without the others."""

    CITY = 0
    CARS_OF_MAP = 1
    CARS_OF_SCANS = 2
    MAP_DRIVE = 3
    SCAN_DRIVE = 4
    MAP_NOISE = 5
    SCAN_NOISE = 6
    UNIFORM_PRIORS = 7
    GNSS_PRIORS = 8
    GEOREFERENCING = 9
    GONE = 10
    ROAD_USERS = 11
    TRAFFIC = 12
    ODOMETRY = 13


@dataclass(frozen=True, slots=True, eq=False)
class CampaignWorld:
    """The campaign before anything is measured.

    seed: everything random is drawn from it.
    circuit: the line that all rounds follow.
    mapping: the rounds of the mapping vehicle through the city on the day of the map.
    scan_caster: the city on the day of the scans: other cars are parked.
    scan_drive: the round of the car, 300 s long.
    traffic: vehicles and pedestrians around the car; none if None.
    drive_number: number of the car's drive, from 0, see `again`.
    """

    seed: int
    circuit: Circuit
    mapping: MappingDrives
    scan_caster: RayCaster
    scan_drive: Drive
    traffic: Traffic | None = None
    drive_number: int = 0

    @classmethod
    def build(cls, seed: int, n_rounds: int = 5, *, is_hard: bool = False) -> Self:
        """Return the world of `seed`, mapped in `n_rounds`.

        seed: the same seed gives the same world.
        n_rounds: how often the circuit is mapped.
        is_hard: whether the facades are periodic, a quarter of the items before them is gone on the day of the scans,
            cars are parked more densely, and 30 % of the returns of each scan are on vehicles and pedestrians.
        """
        check_seed(seed)
        if n_rounds < 1:
            raise OptionError(f"Expected at least one round of mapping, got {n_rounds}. The default is 5.")
        check_embreex()
        map_city, scan_city = _hard_cities(seed) if is_hard else _cities(seed)
        circuit = circuit_through(street_angle=map_city.street_angle)
        drives = _mapping_rounds(circuit, seed, n_rounds)
        return cls(
            seed=seed,
            circuit=circuit,
            mapping=MappingDrives(
                RayCaster(map_city),
                drives,
                [seed, _Stream.MAP_NOISE],
                draw_georeferencing_errors(
                    [seed, _Stream.GEOREFERENCING], float(drives[0].times[0]), float(drives[-1].times[-1])
                ),
            ),
            scan_caster=RayCaster(scan_city),
            scan_drive=_scan_drive(circuit, [seed, _Stream.SCAN_DRIVE], SCAN_START),
            traffic=(Traffic(CAMPAIGN_GRID, map_city.street_angle, [seed, _Stream.ROAD_USERS]) if is_hard else None),
        )

    def again(self, drive_number: int, day: int = 1) -> Self:
        """Return the same world on another drive of the car, with another speed profile, other noise and other priors.

        drive_number: from 0, the first drive.
        day: 1 for the day of the first drive; on each other day, other cars are parked.
        """
        if drive_number < 0 or day < 1:
            raise OptionError(
                f"Expected the number of a drive >= 0 and a day >= 1, got {drive_number} and {day}."
                " Drive 0 of day 1 is the first."
            )
        start = SCAN_START + 86_400.0 * (day - 1)
        caster, city = self.scan_caster, self.scan_caster.city
        if day > 1 and isinstance(city, City):
            occupancy = OCCUPANCY if self.traffic is None else HARD_OCCUPANCY
            caster = RayCaster(city.with_parked_cars([self.seed, _Stream.CARS_OF_SCANS, day], occupancy))
        return replace(
            self,
            scan_caster=caster,
            scan_drive=_scan_drive(self.circuit, self._stream(_Stream.SCAN_DRIVE, number=drive_number), start),
            drive_number=drive_number,
        )

    def _stream(self, stream: "_Stream", *more: int, number: int | None = None) -> list[int]:
        """Seed of what is drawn anew for every drive; that of drive 0 goes without the number of the drive."""
        number = self.drive_number if number is None else number
        return [self.seed, stream, *more, *([number] if number else [])]

    @property
    def _start(self) -> float:
        return float(self.scan_drive.times[0])

    def epochs(self, n_epochs: int = MOST_EPOCHS, ticks_apart: int | None = None) -> list[ScanEpoch]:
        """Return `n_epochs` of the 3001, spread evenly; or from the beginning on, `ticks_apart` of them apart."""
        if ticks_apart is not None:
            return successive_epochs(self.scan_drive, n_epochs, ticks_apart, self._start)
        return evenly_spread_epochs(self.scan_drive, n_epochs, MOST_EPOCHS, self._start)

    def odometry(self, errors: OdometryErrors) -> tuple[NDArray[np.float64], list[Pose]]:
        """Times (s) and poses (T_odometry_sensor) over the whole round, ten a second, whichever epochs are taken."""
        times = np.round(self._start + EPOCH_STEP * np.arange(MOST_EPOCHS), 6)
        return times, errors.draw(self.scan_drive, times, self._stream(_Stream.ODOMETRY))

    def gnss_priors(self, epochs: Sequence[ScanEpoch], errors: GnssErrors) -> list[Pose]:
        """Priors, T_city_sensor, whose errors change slowly over the round."""
        return gnss_priors(epochs, errors, MOST_EPOCHS, self._stream(_Stream.GNSS_PRIORS))

    def uniform_priors(self, epochs: Sequence[ScanEpoch], errors: PriorErrors) -> list[Pose]:
        """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
        return uniform_priors(epochs, errors, self._stream(_Stream.UNIFORM_PRIORS))

    def scan(self, epoch: ScanEpoch, scanner: RotatingScanner) -> Echoes:
        """Measure the scan of one epoch from its reference pose; it does not depend on which other epochs are taken."""
        rng = np.random.default_rng(self._stream(_Stream.SCAN_NOISE, epoch.tick))
        return scanner.scan(self._caster_at(epoch, scanner), epoch.reference, epoch.time, rng)

    def _caster_at(self, epoch: ScanEpoch, scanner: RotatingScanner) -> Caster:
        """Return the city on the day of the scans with the traffic of this epoch."""
        if self.traffic is None:
            return self.scan_caster
        rng = np.random.default_rng(self._stream(_Stream.TRAFFIC, epoch.tick))
        return CrowdedCaster(self.scan_caster, self.traffic.draw(self.scan_caster, scanner, epoch.reference, rng))


def _cities(seed: int) -> tuple[City, City]:
    """Return the city on the day of the map and on the day of the scans: other cars are parked."""
    city = build_city([seed, _Stream.CITY], grid=CAMPAIGN_GRID)
    return (
        city.with_parked_cars([seed, _Stream.CARS_OF_MAP], OCCUPANCY),
        city.with_parked_cars([seed, _Stream.CARS_OF_SCANS], OCCUPANCY),
    )


def _hard_cities(seed: int) -> tuple[City, City]:
    """Return the periodic city on both days: on the second other and more cars are parked, and items are gone."""
    city = build_periodic_city([seed, _Stream.CITY])
    gone = city.draw_gone([seed, _Stream.GONE])
    return (
        city.city().with_parked_cars([seed, _Stream.CARS_OF_MAP], OCCUPANCY),
        city.city(gone).with_parked_cars([seed, _Stream.CARS_OF_SCANS], HARD_OCCUPANCY),
    )


def _scan_drive(circuit: Circuit, seed: Sequence[int], start: float) -> Drive:
    """Return one round of the car, from `start` (s) on."""
    return drive_round(circuit, SCAN_DRIVER, seed, height=SCAN_HEIGHT, start_time=start, duration=ROUND_TIME)


def _mapping_rounds(circuit: Circuit, seed: int, n_rounds: int) -> tuple[Drive, ...]:
    """Return rounds of differing speed, each with stops of its own."""
    drives: list[Drive] = []
    start = MAP_START
    for i in range(n_rounds):
        rng = np.random.default_rng([seed, _Stream.MAP_DRIVE, i, 0])
        driver = RoundDriver(
            speed=rng.uniform(9.0, 14.0),
            turn_speed=rng.uniform(3.5, 4.5),
            acceleration=2.0,
            n_stops=int(rng.integers(0, 4)),
        )
        stream = [seed, _Stream.MAP_DRIVE, i, 1]
        drives.append(drive_round(circuit, driver, stream, height=MAP_HEIGHT, start_time=start))
        start = float(drives[-1].times[-1]) + PAUSE
    return tuple(drives)
