"""Scanners: rays cast into a scene (Embree), where they go, how their ranges are disturbed, how the car moves."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import needs_extra
from maxcon.geometry import Pose, rotation_matrices
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.furniture import LasClass, Patch
from maxcon.search.accumulator import NamedOption


class Hits(NamedTuple):
    """Ranges, shape (n,), m, and rows of the triangles that rays met, shape (n,); -1 where a ray met nothing."""

    ranges: NDArray[np.float32]
    triangles: NDArray[np.int32]


def check_embreex() -> None:
    """Check that embreex is installed, before the work whose last step needs it."""
    with needs_extra("embreex", "to cast rays in a simulated city", "demo"):
        import embreex  # noqa: F401


class Caster(Protocol):
    """A scene that a scanner can cast its rays into: normals, shape (t, 3), and classes, (t,), of its triangles."""

    normals: NDArray[np.float32]
    classes: NDArray[np.uint8]

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits: ...  # noqa: D102


class RayCaster:
    """Triangles made ready for casting rays (Embree) in float32: coordinates must be small."""

    def __init__(self, city: Patch) -> None:
        check_embreex()
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        corners = city.corners
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        self.city = city
        self.classes = city.classes
        self.normals: NDArray[np.float32] = (normals / np.where(lengths > 0.0, lengths, 1.0)).astype(np.float32)
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, corners.astype(np.float32))

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hit of each ray, origins and unit directions of shape (n, 3), in the frame of the corners, m."""
        found = self._scene.run(np.ascontiguousarray(origins), np.ascontiguousarray(directions), output=True)
        return Hits(found["tfar"], found["primID"])


class Returns(NamedTuple):
    """Points that a scanner measured, in order of time; city metres."""

    points: NDArray[np.float64]  # (n, 3), with range noise
    origins: NDArray[np.float64]  # (n, 3), where each ray started
    times: NDArray[np.float64]  # (n,), s
    triangles: NDArray[np.int32]  # (n,), of the caster
    classes: NDArray[np.uint8]  # (n,), LasClass of what was hit
    intensities: NDArray[np.float32]  # (n,), 0 to 1: reflectance times the cosine of incidence


REFLECTANCES = np.zeros(256)
"""Part of the light that comes back from a surface of each class hit at a right angle, 0 to 1."""
REFLECTANCES[list(LasClass)] = [0.45, 0.25, 0.5, 0.45, 0.4, 0.6, 0.35, 0.7]


@dataclass(frozen=True, slots=True)
class RangeFinder:
    """Limits and errors of a scanner's range measurement."""

    noise: float  # standard deviation of a range, m
    dropout: float  # ratio of the returns that is lost at random, 0 to 1
    min_range: float  # m; returns nearer are lost
    max_range: float  # m; returns farther are lost

    def are_returns(self, hits: Hits) -> NDArray[np.bool_]:
        """Which hits give a return if none drops out, shape (n,): those within the limits of the range."""
        is_near = (hits.ranges >= self.min_range) & (hits.ranges <= self.max_range)
        return np.asarray((hits.triangles >= 0) & is_near)

    def measure(
        self, caster: Caster, origins: NDArray[np.float64], directions: NDArray[np.float64], times: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> Returns:  # fmt: skip
        """Return what rays measure: origins, city metres, and unit directions, (n, 3), at `times`, (n,), s."""
        hits = caster.cast(origins.astype(np.float32), directions.astype(np.float32))
        rows = np.flatnonzero(self.are_returns(hits) & (rng.random(len(origins)) >= self.dropout))
        triangles = hits.triangles[rows]
        starts, ways = origins[rows], directions[rows]
        ranges = hits.ranges[rows] + self.noise * rng.standard_normal(len(rows))
        classes = caster.classes[triangles]
        cosines = np.abs(np.einsum("ij,ij->i", caster.normals[triangles], ways))
        intensities = (REFLECTANCES[classes] * cosines).astype(np.float32)
        return Returns(starts + ranges[:, None] * ways, starts, times[rows], triangles, classes, intensities)


AT_ORIGIN = (Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),)
SCAN_TIME = 0.1  # duration of one scan: a turn, or what a non-repetitive scanner accumulates, s


class Rays(NamedTuple):
    """Rays of one scan in the sensor frame."""

    origins: NDArray[np.float64]  # (n, 3), m
    directions: NDArray[np.float64]  # (n, 3), unit vectors
    offsets: NDArray[np.float64]  # (n,), when each is fired, less the time of the scan, s


@dataclass(frozen=True, slots=True)
class Scanner(RangeFinder, ABC):
    """A scanner with a firing pattern, or several of a kind, whose points are merged into one scan."""

    mounts: tuple[Pose, ...]  # T_sensor_scanner of each of them
    accumulates: ClassVar[bool] = False
    """Whether a scan is always simulated with the motion within it."""

    @abstractmethod
    def pattern(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit rays of the scan at `time` (s) in the scanner's frame, shape (n, 3), and their offsets, (n,), s."""

    def rays(self, time: float) -> Rays:
        """Return the rays of the scan at `time` (s) of all scanners."""
        directions, offsets = self.pattern(time)
        return Rays(
            np.repeat([mount.position for mount in self.mounts], len(offsets), axis=0),
            np.concatenate([directions @ mount.rotation.T for mount in self.mounts]),
            np.tile(offsets, len(self.mounts)),
        )

    def scan(self, caster: Caster, pose: Pose, time: float, rng: np.random.Generator) -> Returns:
        """Return one scan from `pose` (T_city_sensor) at `time` (s)."""
        rays = self.rays(time)
        origins = rays.origins @ pose.rotation.T + pose.position
        return self.measure(caster, origins, rays.directions @ pose.rotation.T, np.full(len(origins), time), rng)


@dataclass(frozen=True, slots=True)
class RotatingScanner(Scanner):
    """A scanner with layers of fixed elevation that turns about its z axis; the default is a Velodyne VLP-16."""

    noise: float = 0.03
    dropout: float = 0.03
    min_range: float = 1.0
    max_range: float = 100.0
    mounts: tuple[Pose, ...] = AT_ORIGIN
    n_layers: int = 16  # evenly spaced, where `elevations_deg` are not given
    lowest_deg: float = -15.0
    highest_deg: float = 15.0
    azimuth_step_deg: float = 0.2  # from one column of points to the next
    elevations_deg: tuple[float, ...] = ()  # of each layer, rising

    @property
    def elevations(self) -> NDArray[np.float64]:
        """Elevation of each layer, lowest first, shape (n_layers,), rad."""
        return np.radians(self.elevations_deg or np.linspace(self.lowest_deg, self.highest_deg, self.n_layers))

    @property
    def n_columns(self) -> int:
        """Number of columns of points in a turn."""
        return round(360.0 / self.azimuth_step_deg)

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit rays of one turn in the scanner's frame, column by column, shape (n_columns * n_layers, 3)."""
        azimuths = np.radians(np.arange(self.n_columns) * self.azimuth_step_deg)
        azimuth, elevation = (grid.ravel() for grid in np.meshgrid(azimuths, self.elevations, indexing="ij"))
        return _unit_rays(azimuth, elevation)

    def pattern(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """One turn, the same at each time; it begins in driving direction, half a turn before `time`."""
        return self.directions, np.repeat(_offsets(self.n_columns), len(self.elevations))


@dataclass(frozen=True, slots=True)
class RosetteScanner(Scanner):
    """A scanner whose pattern does not repeat: two prisms turn in opposite directions, and their deflections add."""

    noise: float = 0.02
    dropout: float = 0.03
    min_range: float = 0.5
    max_range: float = 100.0
    mounts: tuple[Pose, ...] = AT_ORIGIN
    width_deg: float = 60.0  # field of view without the turn of the head
    lowest_deg: float = -30.0
    highest_deg: float = 30.0
    prism_rates: tuple[float, float] = (121.57, 77.73)  # turns per second
    head_rate: float = 0.0  # turns per second of the head about its z axis
    n_beams: int = 1  # fired in turn, by the same turn of the first prism apart
    point_rate: float = 200_000.0  # rays per second
    accumulates: ClassVar[bool] = True

    def pattern(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rays around `time`, where the prisms and the head are then."""
        offsets = _offsets(round(self.point_rate * SCAN_TIME))
        turns = 2.0 * math.pi * (time + offsets)
        first = self.prism_rates[0] * turns + np.arange(len(offsets)) * (2.0 * math.pi / self.n_beams)
        second = -self.prism_rates[1] * turns
        across, up = np.cos(first) + np.cos(second), np.sin(first) + np.sin(second)
        middle, height = 0.5 * (self.lowest_deg + self.highest_deg), self.highest_deg - self.lowest_deg
        azimuth = np.radians(0.25 * self.width_deg * across) + self.head_rate * turns
        return _unit_rays(azimuth, np.radians(middle + 0.25 * height * up)), offsets


def _offsets(n: int) -> NDArray[np.float64]:
    """When each of `n` firings, spread evenly over the time of a scan, takes place, less its middle, shape (n,), s."""
    return ((np.arange(n) + 0.5) / n - 0.5) * SCAN_TIME


def _unit_rays(azimuth: NDArray[np.float64], elevation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors, shape (n, 3), from angles, shape (n,), rad."""
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)


@dataclass(frozen=True, slots=True)
class ProfileScanner(RangeFinder):
    """A scanner whose ray turns in a vertical plane; the motion of the vehicle spaces its profiles."""

    noise: float = 0.01
    dropout: float = 0.01
    min_range: float = 1.5
    max_range: float = 60.0
    turn_deg: float = 45.0  # angle from the driving direction to the plane, degrees, counter-clockwise
    side: float = 0.0  # distance of the mount to the left of the vehicle's middle, m
    line_rate: float = 100.0  # profiles per second: the slower the drive, the denser the points
    points_per_line: int = 960  # rays of a whole turn, the blind ones included
    blind_deg: float = 45.0  # half angle about the nadir that the vehicle itself hides, degrees

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angle of each ray of a profile from the nadir, shape (k,), rad, without the blind part."""
        angles = (np.arange(self.points_per_line) + 0.5) * (2.0 * math.pi / self.points_per_line)
        blind = math.radians(self.blind_deg)
        return np.asarray(angles[(angles >= blind) & (angles <= 2.0 * math.pi - blind)])

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit rays of one profile in the vehicle frame, shape (k, 3)."""
        turn = math.radians(self.turn_deg)
        across, up = np.array([math.cos(turn), math.sin(turn), 0.0]), np.array([0.0, 0.0, 1.0])
        return np.outer(np.sin(self.angles), across) - np.outer(np.cos(self.angles), up)

    def n_lines(self, drive: Drive) -> int:
        """Number of whole profiles in `drive`."""
        return int((drive.times[-1] - drive.times[0]) * self.line_rate)

    def scan(self, caster: Caster, drive: Drive, first: int, n_lines: int, rng: np.random.Generator) -> Returns:
        """Return `n_lines` profiles of a drive, city metres, from number `first` on; the vehicle moves within each."""
        starts = drive.times[0] + np.arange(first, first + n_lines + 1) / self.line_rate
        positions, angles = drive.at(starts)
        rotations = rotation_matrices(*angles.T)
        mounts = positions + rotations[:, :, 1] * self.side
        part = self.angles / (2.0 * math.pi)
        origins = mounts[:-1, None] + part[:, None] * np.diff(mounts, axis=0)[:, None]
        times = starts[:-1, None] + part / self.line_rate
        directions = self.directions @ rotations[:-1].transpose(0, 2, 1)
        return self.measure(caster, origins.reshape(-1, 3), directions.reshape(-1, 3), times.ravel(), rng)


MAPPING_SCANNERS = ProfileScanner(turn_deg=45.0, side=0.3), ProfileScanner(turn_deg=-45.0, side=-0.3)
"""The two profile scanners of a mobile mapping vehicle, turned 45 degrees to either side."""
VLP_32C_DEG = (
    -25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333,
    -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0,
    10.333, 15.0,
)  # fmt: skip
"""Elevations of the layers: half of them within 2.3 degrees of the horizon."""
HDL_64E_DEG = tuple(np.concatenate([np.linspace(-24.33, -8.83, 32), np.linspace(-8.33, 2.0, 32)]).round(3).tolist())
"""Elevations of the layers: two blocks of 32, the lower with steps of 1/2 degree, the upper of 1/3 degree."""


PANDAR_128_DEG = tuple(
    np.concatenate([np.linspace(-25.0, -6.5, 38), np.arange(-6.0, 2.0, 0.125), np.linspace(2.0, 15.0, 26)]).tolist()
)
"""Elevations of the layers: 64 of them from -6 to 2 degrees, the others about half a degree apart."""


class ScannerLayout(NamedOption, option="scanner"):
    """A scanner by its product name, with ten scans a second; or two of a kind, one on either side of the vehicle."""

    VLP_16 = "vlp-16"
    VLP_32C = "vlp-32c"
    HDL_64E = "hdl-64e"
    OS1_64 = "os1-64"
    OS1_128 = "os1-128"
    OS_DOME_128 = "os-dome-128"
    XT_32 = "xt-32"
    PANDAR_128 = "pandar-128"
    MID_360 = "mid-360"
    AVIA = "avia"
    TWO_VLP_16 = "two-vlp-16"
    TWO_OS_DOME_128 = "two-os-dome-128"

    def scanner(self) -> Scanner:
        """Return the scanner with the field of view, the points and the ranges of its data sheet."""
        return DATA_SHEETS[self]


def _either_side(out: float, tilt_deg: float) -> tuple[Pose, Pose]:
    """Mounts `out` to the left and to the right (m), each turned so that its z axis leans outwards by `tilt_deg`."""
    tilt = math.radians(tilt_deg)
    return Pose(0.0, out, 0.0, -tilt, 0.0, 0.0), Pose(0.0, -out, 0.0, tilt, 0.0, 0.0)


OS1 = RotatingScanner(lowest_deg=-22.5, highest_deg=22.5, azimuth_step_deg=360.0 / 1024, min_range=0.5, max_range=120.0)
# The layers of a dome cover the hemisphere about its z axis.
OS_DOME_128 = replace(OS1, n_layers=128, lowest_deg=0.0, highest_deg=89.5, max_range=45.0)
DATA_SHEETS: dict[ScannerLayout, Scanner] = {
    ScannerLayout.VLP_16: RotatingScanner(),
    ScannerLayout.VLP_32C: RotatingScanner(max_range=200.0, elevations_deg=VLP_32C_DEG),
    ScannerLayout.HDL_64E: RotatingScanner(
        azimuth_step_deg=360.0 / 2083, noise=0.02, max_range=120.0, elevations_deg=HDL_64E_DEG
    ),
    ScannerLayout.OS1_64: replace(OS1, n_layers=64),
    ScannerLayout.OS1_128: replace(OS1, n_layers=128),
    ScannerLayout.OS_DOME_128: OS_DOME_128,
    ScannerLayout.XT_32: RotatingScanner(
        n_layers=32, lowest_deg=-16.0, azimuth_step_deg=0.18, noise=0.01, min_range=0.05, max_range=120.0
    ),
    ScannerLayout.PANDAR_128: RotatingScanner(
        azimuth_step_deg=0.2, noise=0.02, min_range=0.3, max_range=200.0, elevations_deg=PANDAR_128_DEG
    ),
    ScannerLayout.MID_360: RosetteScanner(
        min_range=0.1,
        max_range=70.0,
        lowest_deg=-7.0,
        highest_deg=52.0,
        head_rate=10.7,
        n_beams=4,
        prism_rates=(803.7, 524.9),
    ),
    ScannerLayout.AVIA: RosetteScanner(
        min_range=1.0, max_range=190.0, width_deg=70.4, lowest_deg=-38.6, highest_deg=38.6, n_beams=6, point_rate=240e3
    ),
    ScannerLayout.TWO_VLP_16: RotatingScanner(mounts=_either_side(0.6, 25.0)),
    ScannerLayout.TWO_OS_DOME_128: replace(OS_DOME_128, mounts=_either_side(0.8, 90.0)),
}


class DeskewErrors(NamedTuple):
    """Bounds of the uniform errors of the motion that a scan is deskewed by."""

    speed: float = 0.02  # relative
    turn_rate_deg: float = 0.3  # degrees per second
    tilt_rate_deg: float = 0.5  # degrees per second


def scan_moving(
    scanner: Scanner, caster: Caster, drive: Drive, time: float, rng: np.random.Generator,
    errors: DeskewErrors | None = None,
) -> Returns:  # fmt: skip
    """Return one scan from a moving vehicle, city metres, deskewed to `time` (s) by a motion with `errors`."""
    bounds, rays = errors or DeskewErrors(), scanner.rays(time)
    positions, rotations = _poses_at(drive, time + rays.offsets)
    origins = positions + np.einsum("nij,nj->ni", rotations, rays.origins)
    directions = np.einsum("nij,nj->ni", rotations, rays.directions)
    returns = scanner.measure(caster, origins, directions, time + rays.offsets, rng)
    speed_error = bounds.speed * rng.uniform(-1.0, 1.0)
    rates = np.array([bounds.tilt_rate_deg, bounds.tilt_rate_deg, bounds.turn_rate_deg]) * math.pi / 180.0
    rates *= rng.uniform(-1.0, 1.0, 3)
    positions, rotations = _poses_at(drive, returns.times)
    points_sensor = np.einsum("nji,nj->ni", rotations, returns.points - positions)
    (here,), (rotation_here,) = _poses_at(drive, np.array([time]))
    believed = rotation_matrices(*np.outer(rates, returns.times - time))
    turns = rotation_here @ believed @ rotation_here.T @ rotations
    shifts = (1.0 + speed_error) * (positions - here)
    return returns._replace(points=np.einsum("nij,nj->ni", turns, points_sensor) + shifts + here)


def _poses_at(drive: Drive, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions, shape (n, 3), m, and rotations, (n, 3, 3), of the sensor on a drive at `times`, (n,), s."""
    positions, angles = drive.at(times)
    return positions, rotation_matrices(*angles.T)
