"""Simulated worlds: a scene, the drives that map it, and another day's drive whose epochs are scanned."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.lab.simulation.city import City, build_city, build_periodic_city
from maxcon.lab.simulation.drive import (
    Carrier,
    Circuit,
    Drive,
    GeoreferencingErrors,
    OdometryErrors,
    PriorErrors,
    RoundDriver,
    Seed,
    draw_georeferencing_errors,
    draw_gnss_errors,
    drive_along,
    drive_round,
    off_by,
    walk_along,
)
from maxcon.lab.simulation.months import Change, Months
from maxcon.lab.simulation.scanners import (
    Caster,
    ProfileScanner,
    RayCaster,
    Returns,
    Scanner,
    check_embreex,
    scan_moving,
)
from maxcon.lab.simulation.streets import (
    CAMPAIGN_GRID,
    DEMO_GRID,
    STREET_ANGLE,
    StreetGrid,
    circuit_through,
    route_over_crossing,
)
from maxcon.lab.simulation.suburb_ground import ResidentialRoad, draw_road
from maxcon.lab.simulation.suburb_scene import suburb_on_day
from maxcon.lab.simulation.traffic import CrowdedCaster, Traffic

MAP_START, SCAN_START = 300_000.0, 386_400.0
"""When the mapping vehicle and the car set out, seconds of the GPS week: the car comes a day later."""
PAUSE = 60.0  # from the end of one drive of the mapping vehicle to the start of the next, s
MAP_HEIGHT = 2.4  # of its profile scanners above the carriageway, m
TRAJECTORY_STEP = 0.02  # between two poses of its trajectory, s
LINES_PER_PIECE = 250
CHANGED_BY = 0.03  # from where a ray ends to where it ended on the day of the map, m: there something changed
EPOCH_STEP = 0.1  # between two epochs when all are taken, s: the scanner turns ten times a second


class MapPiece(NamedTuple):
    """At most 250 successive profiles of one scanner on one drive, from number `first` on."""

    drive: Drive
    scanner: ProfileScanner
    first: int


@dataclass(frozen=True, slots=True, eq=False)
class MappingDrives:
    """The drives of the mapping vehicle, before anything is measured on them."""

    caster: RayCaster  # the scene on the day of the map
    drives: Sequence[Drive]  # true drives, one after the other
    seed: Sequence[int]  # of the scanners' noise
    # Errors of the vehicle's post-processed trajectory, and so of the map; none if None
    georeferencing: GeoreferencingErrors | None = None

    def pieces(self, scanners: Sequence[ProfileScanner]) -> list[MapPiece]:
        """Return what is measured, piece by piece, in order of time."""
        pieces = [
            MapPiece(drive, scanner, first)
            for drive in self.drives
            for scanner in scanners
            for first in range(0, scanner.n_lines(drive), LINES_PER_PIECE)
        ]
        return sorted(pieces, key=lambda piece: piece.drive.times[0] + piece.first / piece.scanner.line_rate)

    def returns(self, pieces: Iterable[MapPiece]) -> Iterator[Returns]:
        """Measure `pieces` one by one, placed by the vehicle's trajectory with its errors."""
        for i, (drive, scanner, first) in enumerate(pieces):
            n_lines = min(LINES_PER_PIECE, scanner.n_lines(drive) - first)
            found = scanner.scan(self.caster, drive, first, n_lines, np.random.default_rng([*self.seed, i]))
            if self.georeferencing is not None:
                offsets = self.georeferencing.at(found.times)
                found = found._replace(points=found.points + offsets, origins=found.origins + offsets)
            yield found

    def poses(self) -> tuple[NDArray[np.float64], list[Pose]]:
        """Times (s) and poses (T_city_vehicle) of the vehicle, 0.02 s apart, with the errors of its trajectory."""
        of_drives = [np.arange(drive.times[0], drive.times[-1], TRAJECTORY_STEP) for drive in self.drives]
        poses = [pose for drive, times in zip(self.drives, of_drives, strict=True) for pose in drive.poses(times)]
        times = np.concatenate(of_drives)
        if self.georeferencing is not None:
            offsets = self.georeferencing.at(times)
            poses = [pose.translated(offset) for pose, offset in zip(poses, offsets, strict=True)]
        return times, poses


class Epoch(NamedTuple):
    """A scan to take: its number, in steps of the scanner from 0 (tick), time (s), reference pose T_city_sensor."""

    tick: int
    time: float
    reference: Pose


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class World:
    """A scene with its drives, before anything is measured.

    seed: everything random is drawn from it.
    mapping: drives of the mapping vehicle through the scene on the day of the map.
    scan_caster, scan_drive: the scene on the day of the scans, and the drive of the car, or the walk, with the scanner.
    n_epochs_of_drive, start: number of scans of the whole drive, 0.1 s apart, and time of the first of them, s.
    drive_number: number of the car's drive, from 0.
    is_moving: whether scans are simulated with the motion within them (`scan_moving`) by any scanner.
    changes: how much of each kind changed in the months between map and scans, if there were any.
    """

    STREAMS: ClassVar[tuple[str, ...]]
    """Random streams of a seed, one per thing that is drawn, so that one can change without the others."""

    seed: int
    mapping: MappingDrives
    scan_caster: RayCaster
    scan_drive: Drive
    n_epochs_of_drive: int = 0
    start: float = SCAN_START
    drive_number: int = 0
    is_moving: bool = False
    changes: Counter[Change] = field(default_factory=Counter)

    @classmethod
    def _stream(cls, seed: int, name: str, *more: int) -> list[int]:
        """Seed of the stream of that name."""
        return [seed, cls.STREAMS.index(name), *more]

    def _of_drive(self, name: str, *more: int) -> list[int]:
        """Seed of what is drawn anew for every drive; that of drive 0 goes without the number of the drive."""
        return self._stream(self.seed, name, *more, *([self.drive_number] if self.drive_number else []))

    @classmethod
    def _cities(cls, seed: int, grid: StreetGrid, changed: float) -> tuple[City, City, Counter[Change]]:
        """The city of the map and that of the scans, both without cars, and what months changed between them."""
        city, months = build_city(cls._stream(seed, "city"), grid), Months(changed, cls._stream(seed, "months"))
        later = build_city(cls._stream(seed, "city"), grid, months) if changed else city
        return city, later, months.changes

    def epochs(self, n_epochs: int, ticks_apart: int | None = None) -> list[Epoch]:
        """Return `n_epochs`, spread evenly over the drive; or from the beginning on, `ticks_apart` of them apart."""
        if ticks_apart is None:
            ticks = np.rint(np.linspace(0, self.n_epochs_of_drive - 1, n_epochs)).astype(np.int64)
        else:
            ticks = ticks_apart * np.arange(n_epochs, dtype=np.int64)
        return self._epochs_at(ticks, np.asarray(self.start + EPOCH_STEP * ticks))

    def _epochs_at(self, ticks: NDArray[np.int64], times: NDArray[np.float64]) -> list[Epoch]:
        rounded = np.round(times, 6)
        return list(map(Epoch, ticks.tolist(), rounded.tolist(), self.scan_drive.poses(rounded)))

    def gnss_priors(self, epochs: Sequence[Epoch]) -> list[Pose]:
        """Priors, T_city_sensor, whose errors change slowly over the drive."""
        rows = draw_gnss_errors(self.n_epochs_of_drive, EPOCH_STEP, self._of_drive("gnss priors"))
        return [off_by(epoch.reference, rows[epoch.tick]) for epoch in epochs]

    def uniform_priors(self, epochs: Sequence[Epoch], errors: PriorErrors | None = None) -> list[Pose]:
        """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
        drawn, seed = errors or PriorErrors(), self._of_drive("uniform priors")
        return [drawn.prior(epoch.reference, np.random.default_rng([*seed, epoch.tick])) for epoch in epochs]

    def scan(self, epoch: Epoch, scanner: Scanner) -> Returns:
        """Measure the scan of one epoch; it does not depend on which other epochs are taken."""
        caster, rng = self._scene(epoch, scanner), np.random.default_rng(self._of_drive("scan noise", epoch.tick))
        if self.is_moving or scanner.accumulates:
            return scan_moving(scanner, caster, self.scan_drive, epoch.time, rng)
        return scanner.scan(caster, epoch.reference, epoch.time, rng)

    def _scene(self, epoch: Epoch, scanner: Scanner) -> Caster:
        """What the scanner sees at one epoch."""
        return self.scan_caster

    def changed_ratio(self, epochs: Iterable[Epoch], scanner: Scanner) -> float:
        """Ratio of the returns whose rays would have ended elsewhere, by 3 cm or more, on the day of the map."""
        n_changed = n_returns = 0
        for epoch in epochs:
            rays = scanner.rays(epoch.time)
            directions = (rays.directions @ epoch.reference.rotation.T).astype(np.float32)
            origins = epoch.reference.apply(rays.origins).astype(np.float32)
            now, then = (each.cast(origins, directions) for each in (self.scan_caster, self.mapping.caster))
            are_returns = scanner.are_returns(now)
            n_returns += int(are_returns.sum())
            n_changed += int((are_returns & (np.abs(now.ranges - then.ranges) >= CHANGED_BY)).sum())
        return n_changed / max(n_returns, 1)


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise OptionError(f"Expected a seed of 0 or more, got {seed}. Take another whole number.")
    check_embreex()


def _georeferencing(drives: Sequence[Drive], seed: Seed) -> GeoreferencingErrors:
    return draw_georeferencing_errors(seed, float(drives[0].times[0]), float(drives[-1].times[-1]))


MAP_BEYOND = 35.0  # how far the first mapping drive extends beyond the drive of the scans at either end, m
SIDEWALK = 6.4  # distance of who walks from the centre line, m
MAP_BRANCHES = (50.0, 40.0)
"""Distance from the crossing at which the second mapping drive, over the other two branches, begins and ends, m."""


class SimulatedWorld(World):
    """The small city of the demo: a street and a crossing, each branch of which is mapped."""

    STREAMS = (
        "city", "cars of map", "cars of scans", "map drive", "scan drive", "map noise", "scan noise", "uniform priors",
        "months",
    )  # fmt: skip

    @classmethod
    def build(
        cls, seed: int, before: float = 75.0, after: float = 50.0, mapping_wait: float = 0.0,
        carrier: Carrier = Carrier.CAR, changed: float = 0.0,
    ) -> Self:  # fmt: skip
        """Return the world of `seed`; distances are from the middle of the crossing: see `simulate`."""
        _check_seed(seed)
        map_routes = (
            route_over_crossing(STREET_ANGLE, before + MAP_BEYOND, after + MAP_BEYOND, lane=1.7),
            route_over_crossing(STREET_ANGLE + math.pi, *MAP_BRANCHES, lane=1.6),
        )
        drives: list[Drive] = []
        for i, (map_route, wait) in enumerate(zip(map_routes, (mapping_wait, 0.0), strict=True)):
            start, stream = _next_start(drives), cls._stream(seed, "map drive", i)
            drives.append(drive_along(map_route, stream, slowest=0.2, wait=wait, height=MAP_HEIGHT, start_time=start))
        *cities, changes = cls._cities(seed, DEMO_GRID, changed)
        map_caster, scan_caster = (
            RayCaster(city.with_parked_cars(cls._stream(seed, name)))
            for city, name in zip(cities, ("cars of map", "cars of scans"), strict=True)
        )
        stream = cls._stream(seed, "scan drive")
        if carrier is Carrier.HAND:
            route = route_over_crossing(STREET_ANGLE, before, after, lane=SIDEWALK)
            scan_drive = walk_along(route, stream, start_time=SCAN_START)
        else:
            level = drive_along(
                route_over_crossing(STREET_ANGLE, before, after), stream, slowest=0.25, start_time=SCAN_START
            )
            scan_drive = _on_asphalt(level, scan_caster)
        return cls(
            seed=seed, mapping=MappingDrives(map_caster, drives, cls._stream(seed, "map noise")),
            scan_caster=scan_caster, scan_drive=scan_drive, is_moving=carrier is Carrier.HAND, changes=changes,
        )  # fmt: skip

    def epochs(self, n_epochs: int, ticks_apart: int | None = None) -> list[Epoch]:
        """Return `n_epochs` epochs evenly spaced in time, numbered one by one."""
        first, last = self.scan_drive.times[[0, -1]]
        return self._epochs_at(np.arange(n_epochs), np.linspace(first, last, n_epochs))

    def uniform_priors(self, epochs: Sequence[Epoch], errors: PriorErrors | None = None) -> list[Pose]:
        """Priors, T_city_sensor, drawn one after the other."""
        rng = np.random.default_rng(self._of_drive("uniform priors"))
        return [(errors or PriorErrors()).prior(epoch.reference, rng) for epoch in epochs]


def _next_start(drives: Sequence[Drive]) -> float:
    """When the next drive of the mapping vehicle begins, s."""
    return float(drives[-1].times[-1]) + PAUSE if drives else MAP_START


MOST_EPOCHS = 3001  # of the campaign: the round of the car takes 300 s
OCCUPANCY, HARD_OCCUPANCY = 0.85, 0.95  # which part of the kerbs is taken by parked cars, 0 to 1
SCAN_DRIVER = RoundDriver(speed=5.5, turn_speed=2.8, n_stops=1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CampaignWorld(World):
    """The campaign: a circuit mapped in rounds, driven on another day, when other cars are parked."""

    STREAMS = (
        "city", "cars of map", "cars of scans", "map drive", "scan drive", "map noise", "scan noise", "uniform priors",
        "gnss priors", "georeferencing", "gone", "road users", "traffic", "odometry", "months",
    )  # fmt: skip

    scan_city: City  # the city on the day of the scans
    circuit: Circuit  # the line that all rounds follow
    traffic: Traffic | None = None  # vehicles and pedestrians around the car; none if None

    @classmethod
    def build(cls, seed: int, n_rounds: int = 5, *, is_hard: bool = False, changed: float = 0.0) -> Self:
        """Return the world of `seed`, mapped in `n_rounds`; what `is_hard` means stands at `simulate_campaign`."""
        _check_seed(seed)
        if n_rounds < 1:
            raise OptionError(f"Expected at least one round of mapping, got {n_rounds}. The default is 5.")
        if is_hard and changed:
            raise OptionError("Expected either a hard campaign or months between map and scans, got both. Leave one.")
        changes = Counter[Change]()
        if is_hard:
            periodic = build_periodic_city(cls._stream(seed, "city"))
            map_city, scan_city = periodic.city(), periodic.city(periodic.draw_gone(cls._stream(seed, "gone")))
        else:
            map_city, scan_city, changes = cls._cities(seed, CAMPAIGN_GRID, changed)
        map_city = map_city.with_parked_cars(cls._stream(seed, "cars of map"), OCCUPANCY)
        scan_city = scan_city.with_parked_cars(
            cls._stream(seed, "cars of scans"), HARD_OCCUPANCY if is_hard else OCCUPANCY
        )
        circuit = circuit_through()
        drives: list[Drive] = []
        for i in range(n_rounds):
            rng = np.random.default_rng(cls._stream(seed, "map drive", i, 0))
            speed, turn_speed, n_stops = rng.uniform(9.0, 14.0), rng.uniform(3.5, 4.5), int(rng.integers(0, 4))
            driver = RoundDriver(speed, turn_speed, acceleration=2.0, n_stops=n_stops)
            start, stream = _next_start(drives), cls._stream(seed, "map drive", i, 1)
            drives.append(drive_round(circuit, driver, stream, height=MAP_HEIGHT, start_time=start))
        errors, scan_caster = _georeferencing(drives, cls._stream(seed, "georeferencing")), RayCaster(scan_city)
        return cls(
            seed=seed,
            mapping=MappingDrives(RayCaster(map_city), drives, cls._stream(seed, "map noise"), errors),
            scan_caster=scan_caster,
            scan_drive=_round_of_car(circuit, cls._stream(seed, "scan drive"), SCAN_START, scan_caster),
            n_epochs_of_drive=MOST_EPOCHS,
            changes=changes,
            scan_city=scan_city,
            circuit=circuit,
            traffic=Traffic(CAMPAIGN_GRID, cls._stream(seed, "road users")) if is_hard else None,
        )

    def again(self, drive_number: int, day: int = 1) -> Self:
        """Return the same world on another drive of the car, with other speeds, noise and priors."""
        # `drive_number` counts from 0; `day` is 1 for the first drive, on each other day other cars are parked.
        start = SCAN_START + 86_400.0 * (day - 1)
        world = replace(self, start=start, drive_number=drive_number)
        if day > 1:
            occupancy = OCCUPANCY if self.traffic is None else HARD_OCCUPANCY
            city = self.scan_city.with_parked_cars(self._stream(self.seed, "cars of scans", day), occupancy)
            world = replace(world, scan_city=city, scan_caster=RayCaster(city))
        drive = _round_of_car(self.circuit, world._of_drive("scan drive"), start, world.scan_caster)
        return replace(world, scan_drive=drive)

    def odometry(self, errors: OdometryErrors) -> tuple[NDArray[np.float64], list[Pose]]:
        """Times (s) and poses (T_odometry_sensor) over the whole round, ten a second, whichever epochs are taken."""
        times = np.round(self.start + EPOCH_STEP * np.arange(MOST_EPOCHS), 6)
        return times, errors.draw(self.scan_drive, times, self._of_drive("odometry"))

    def _scene(self, epoch: Epoch, scanner: Scanner) -> Caster:
        if self.traffic is None:
            return self.scan_caster
        rng = np.random.default_rng(self._of_drive("traffic", epoch.tick))
        road_users = self.traffic.draw(self.scan_caster, scanner, epoch.reference, rng)
        return CrowdedCaster(self.scan_caster, road_users)


def _round_of_car(circuit: Circuit, seed: Seed, start: float, caster: RayCaster) -> Drive:
    duration = (MOST_EPOCHS - 1) * EPOCH_STEP
    level = drive_round(circuit, SCAN_DRIVER, seed, height=2.0, start_time=start, duration=duration)
    return _on_asphalt(level, caster)


def _on_asphalt(drive: Drive, caster: RayCaster) -> Drive:
    """The drive raised to the surface of the road, in centimetres, whose steps it takes within a metre."""
    above = np.concatenate([drive.positions[:, :2], np.ones((len(drive.times), 1))], axis=1).astype(np.float32)
    hits = caster.cast(above, np.broadcast_to(np.array([0.0, 0.0, -1.0], np.float32), above.shape))
    heights = np.pad(np.round(1.0 - hits.ranges.astype(np.float64), 2), 10, mode="edge")
    rises = np.convolve(heights, np.full(21, 1.0 / 21.0), mode="valid")
    return replace(drive, positions=drive.positions + rises[:, None] * np.array([0.0, 0.0, 1.0]))


ROAD_LENGTH = 460.0  # default, m: a minute at 28 km/h
MEAN_SPEED = ROAD_LENGTH / 60.0  # mean speed of the car, m/s: a road of the default length has 601 epochs
LANE_THERE, LANE_BACK = -1.2, 0.1
"""Lanes, m to the left of the centre line: on the way back, parked cars force the vehicle to the middle."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SuburbWorld(World):
    """The suburb: a road mapped there and back, driven on another day, when leaves, cars and bins differ.

    road: the road that all drives follow. That of the car begins about a second before the first epoch and ends as
        long after the last.
    """

    STREAMS = (
        "road", "scene", "day of map", "day of scans", "map drive", "scan drive", "map noise", "scan noise",
        "uniform priors", "gnss priors", "georeferencing",
    )  # fmt: skip

    road: ResidentialRoad

    @classmethod
    def build(cls, seed: int, road_length: float = ROAD_LENGTH) -> Self:
        """Return the world of `seed` along a road of `road_length` (m)."""
        _check_seed(seed)
        road = draw_road(road_length, cls._stream(seed, "road"))
        map_caster, scan_caster = (
            RayCaster(suburb_on_day(road, cls._stream(seed, "scene"), cls._stream(seed, day)))
            for day in ("day of map", "day of scans")
        )
        drives: list[Drive] = []
        for i, lane in enumerate((LANE_THERE, LANE_BACK)):
            stream, start = cls._stream(seed, "map drive", i), _next_start(drives)
            route = road.route(lane, [*stream, 0], start=MAP_BEYOND, is_back=i == 1)
            level = drive_along(route, [*stream, 1], slowest=0.3, height=MAP_HEIGHT, start_time=start)
            drives.append(road.on_ground(level))
        # The car begins 8 m before the road and ends 8 m after it, where there is no epoch.
        stream, n_epochs = cls._stream(seed, "scan drive"), n_epochs_on(road_length)
        route = road.route(LANE_THERE, [*stream, 0], start=8.0)
        level = road.on_ground(drive_along(route, [*stream, 1], slowest=0.4, height=1.8))
        first, last = np.interp([8.0, 8.0 + road_length], route.distances, level.times)
        times = SCAN_START + (level.times - first) * (EPOCH_STEP * (n_epochs - 1)) / (last - first)
        errors = _georeferencing(drives, cls._stream(seed, "georeferencing"))
        return cls(
            seed=seed, mapping=MappingDrives(map_caster, drives, cls._stream(seed, "map noise"), errors),
            scan_caster=scan_caster, scan_drive=replace(level, times=times), n_epochs_of_drive=n_epochs, road=road,
            is_moving=True,
        )  # fmt: skip


def n_epochs_on(road_length: float) -> int:
    """Number of scans, 0.1 s apart, of the drive along a road of `road_length` (m)."""
    return 1 + round(road_length / MEAN_SPEED / EPOCH_STEP)
