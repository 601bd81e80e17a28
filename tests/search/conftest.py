"""Hand-made scenes whose answer is known."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan

CELL = 0.06


@dataclass
class Scene:
    """Surfaces at right angles to the ground, in map axes; the sensor stands at `sensor`.

    Every surface is drawn by its points in the map and by fewer points, between them, in the scan.
    """

    sensor: Pose = field(default_factory=lambda: Pose(0.013, -0.021, 1.7, 0.0, 0.0, 0.0))
    map_points: list = field(default_factory=list)
    map_normals: list = field(default_factory=list)
    scan_points: list = field(default_factory=list)
    scan_normals: list = field(default_factory=list)

    def wall(self, start, end, *, heights=(1.02, 1.53), repeat=1, scan_step=0.5, in_scan=True, turn=0.0):
        """Add a wall from `start` to `end`, (x, y), turned by `turn` about the origin; it faces the sensor."""
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s], [s, c]])
        start, end = rotation @ np.asarray(start, float), rotation @ np.asarray(end, float)
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        normal = np.array([-along[1], along[0], 0.0])
        if normal[:2] @ (self.sensor.position[:2] - start) < 0.0:
            normal = -normal
        for height in heights:
            dense = self._row(start, along, np.arange(0.0, length, CELL / 3), height)
            sparse = self._row(start, along, np.arange(0.4 * scan_step, length, scan_step), height)
            self.map_points += [dense] * repeat
            self.map_normals += [np.tile(normal, (len(dense), 1))] * repeat
            if in_scan:
                self.scan_points.append(sparse)
                self.scan_normals.append(np.tile(normal, (len(sparse), 1)))
        return self

    @staticmethod
    def _row(start, along, at, height):
        return np.column_stack([start + at[:, None] * along, np.full(len(at), height)])

    @property
    def points(self):
        return np.concatenate(self.map_points)

    @property
    def normals(self):
        return np.concatenate(self.map_normals)

    @property
    def point_map(self):
        return PointMap.from_points(self.points, self.normals, CELL)

    @property
    def scan(self):
        rotation = self.sensor.rotation
        points = np.concatenate(self.scan_points) - self.sensor.position
        return Scan(points @ rotation, np.concatenate(self.scan_normals) @ rotation)

    def prior(self, cells_x, cells_y, turn_deg=0.0):
        """Prior from which the true pose lies that many cells (and degrees) away."""
        sensor = self.sensor
        return Pose(
            sensor.x - cells_x * CELL, sensor.y - cells_y * CELL, sensor.z, sensor.roll, sensor.pitch,
            sensor.heading - np.radians(turn_deg),
        )  # fmt: skip


@pytest.fixture
def scene():
    return Scene()


@pytest.fixture
def turned_scene():
    """The sensor is turned and tilted, as on a real vehicle."""
    return Scene(Pose(0.013, -0.021, 1.7, 0.02, -0.03, 0.9))
