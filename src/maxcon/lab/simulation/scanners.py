# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scanners: rays cast into a scene (Embree), where they go, how their ranges are disturbed, how the car moves."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

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
    """A city, a suburb or a road user, made ready for casting rays (Embree).

    city: its coordinates must be small, m: rays are cast in float32, whose steps are 0.01 mm at 150 m.
    """

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
    """Points that a scanner measured, in order of time.

    points, origins: shape (n, 3); with range noise, and where each ray started, city metres.
    times: shape (n,); s.
    triangles, classes: shape (n,); index, among those of the caster, and LasClass of the triangle that was hit.
    intensities: shape (n,), float32; 0 to 1: reflectance times the cosine of incidence.
    """

    points: NDArray[np.float64]
    origins: NDArray[np.float64]
    times: NDArray[np.float64]
    triangles: NDArray[np.int32]
    classes: NDArray[np.uint8]
    intensities: NDArray[np.float32]


REFLECTANCES = np.zeros(256)
"""Part of the light that comes back from a surface of each class hit at a right angle, 0 to 1."""
REFLECTANCES[list(LasClass)] = [0.45, 0.25, 0.5, 0.45, 0.4, 0.6, 0.35, 0.7]


@dataclass(frozen=True, slots=True)
class RangeFinder:
    """Limits and errors of a scanner's range measurement.

    noise: standard deviation of a range, m.
    dropout: ratio of the returns that is lost at random, 0 to 1.
    min_range, max_range: returns nearer or farther are lost, m.
    """

    noise: float
    dropout: float
    min_range: float
    max_range: float

    def are_returns(self, hits: Hits) -> NDArray[np.bool_]:
        """Which hits give a return if none drops out, shape (n,): those within the limits of the range."""
        is_near = (hits.ranges >= self.min_range) & (hits.ranges <= self.max_range)
        return np.asarray((hits.triangles >= 0) & is_near)

    def measure(
        self,
        caster: Caster,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        times: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> Returns:
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


@dataclass(frozen=True, slots=True)
class RotatingScanner(RangeFinder):
    """A scanner with layers of fixed elevation that turns about its z axis; the default is a Velodyne VLP-16.

    Sensor axes: x forward, y left, z up. The rays of one turn start at one place: scans are taken for perfectly
    deskewed (`scan_moving` simulates the motion within a scan, and a deskewing with errors).

    n_layers, lowest_deg, highest_deg: layers, evenly spaced in elevation, where `elevations_deg` are not given.
    azimuth_step_deg: from one column of points to the next, degrees.
    elevations_deg: elevation of each layer, rising, degrees.
    """

    noise: float = 0.03
    dropout: float = 0.03
    min_range: float = 1.0
    max_range: float = 100.0
    n_layers: int = 16
    lowest_deg: float = -15.0
    highest_deg: float = 15.0
    azimuth_step_deg: float = 0.2
    elevations_deg: tuple[float, ...] = ()

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
        """Unit rays of one turn in the sensor frame, column by column, shape (n_columns * n_layers, 3)."""
        azimuths = np.radians(np.arange(self.n_columns) * self.azimuth_step_deg)
        azimuth, elevation = (grid.ravel() for grid in np.meshgrid(azimuths, self.elevations, indexing="ij"))
        level = np.cos(elevation)
        return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)

    def scan(self, caster: Caster, pose: Pose, time: float, rng: np.random.Generator) -> Returns:
        """Return one scan from `pose` (T_city_sensor) at `time` (s)."""
        directions = self.directions @ pose.rotation.T
        origins = np.broadcast_to(pose.position, directions.shape)
        return self.measure(caster, origins, directions, np.full(len(directions), time), rng)


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


class ScannerLayout(NamedOption, option="scanner"):
    """A scanner by its product name, turning ten times a second."""

    VLP_16 = "vlp-16"
    VLP_32C = "vlp-32c"
    HDL_64E = "hdl-64e"
    OS1_64 = "os1-64"

    def scanner(self) -> RotatingScanner:
        """Return the scanner with the elevations, columns and ranges of its data sheet."""
        return DATA_SHEETS[self]


DATA_SHEETS = {
    ScannerLayout.VLP_16: RotatingScanner(),
    ScannerLayout.VLP_32C: RotatingScanner(max_range=200.0, elevations_deg=VLP_32C_DEG),
    ScannerLayout.HDL_64E: RotatingScanner(
        azimuth_step_deg=360.0 / 2083, noise=0.02, max_range=120.0, elevations_deg=HDL_64E_DEG
    ),
    ScannerLayout.OS1_64: RotatingScanner(
        n_layers=64, lowest_deg=-22.5, highest_deg=22.5, azimuth_step_deg=360.0 / 1024, min_range=0.5, max_range=120.0
    ),
}
TURN_TIME = 0.1  # duration of one turn of the scanner, s


class DeskewErrors(NamedTuple):
    """Bounds of the errors of the motion that a scan is deskewed by: each is uniform within plus and minus its bound.

    The speed is relative, rates are in degrees per second. By default the first and the last points of a scan are off
    by up to 8 mm at 8 m/s, and by up to 5 mm (heading) and 9 mm (tilt) 20 m away.
    """

    speed: float = 0.02
    turn_rate_deg: float = 0.3
    tilt_rate_deg: float = 0.5


def scan_moving(
    scanner: RotatingScanner,
    caster: Caster,
    drive: Drive,
    time: float,
    rng: np.random.Generator,
    errors: DeskewErrors | None = None,
) -> Returns:
    """Return one scan from a vehicle that moves, deskewed to `time` (s), in city metres.

    A turn begins in driving direction, half a turn before `time`. Each column of rays starts where the vehicle is at
    the column's own time. A point is then transformed from the sensor at that time to the sensor at `time` by the true
    motion between both with `errors` (the defaults if None): its displacement is scaled, and a small rotation added.
    For a vehicle that stands, and without errors, this is `RotatingScanner.scan`.
    """
    bounds, n_columns = errors or DeskewErrors(), scanner.n_columns
    offsets = ((np.arange(n_columns) + 0.5) / n_columns - 0.5) * TURN_TIME
    positions, angles = drive.at(time + offsets)
    rotations = rotation_matrices(*angles.T)
    rays = scanner.directions.reshape(n_columns, -1, 3)
    directions = (rays @ rotations.transpose(0, 2, 1)).reshape(-1, 3)
    columns = np.repeat(np.arange(n_columns), rays.shape[1])
    returns = scanner.measure(caster, positions[columns], directions, (time + offsets)[columns], rng)
    speed_error = bounds.speed * rng.uniform(-1.0, 1.0)
    rates = np.array([bounds.tilt_rate_deg, bounds.tilt_rate_deg, bounds.turn_rate_deg]) * math.pi / 180.0
    rates *= rng.uniform(-1.0, 1.0, 3)
    rows = np.rint((returns.times - time - offsets[0]) / TURN_TIME * n_columns).astype(np.int64)
    points_sensor = np.einsum("nji,nj->ni", rotations[rows], returns.points - returns.origins)
    here, angles_here = (column[0] for column in drive.at([time]))
    rotation_here, believed = rotation_matrices(*angles_here), rotation_matrices(*np.outer(rates, offsets))
    turns = rotation_here @ believed @ rotation_here.T @ rotations
    shifts = (1.0 + speed_error) * (positions - here)
    return returns._replace(points=np.einsum("nij,nj->ni", turns[rows], points_sensor) + shifts[rows] + here)
