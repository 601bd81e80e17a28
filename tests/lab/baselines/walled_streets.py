"""Streets whose walls are known exactly, at any angle, and scans of them."""

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan
from maxcon.lab.baselines import Icp, MultiStart

STREET_ANGLE = math.radians(31.0)
CELL = 0.02
ROWS = np.arange(1.01, 3.6, 0.5)


@dataclass
class Street:
    """Upright walls in street axes (x along), seen by a sensor at `sensor` (map axes).

    Voxels of 2 cm: their centres are off an oblique wall by less than a centimetre, and by nothing in the mean.
    """

    angle: float = STREET_ANGLE
    sensor: Pose = field(default_factory=lambda: Pose(3.217, -1.463, 1.7, 0.0, 0.0, 0.4))
    walls: list = field(default_factory=list)

    def wall(self, *corners):
        """Add a wall along a line of corners, (x, y) in street axes about the sensor."""
        self.walls += list(itertools.pairwise(corners))
        return self

    def facades(self, half_width=6.0, length=60.0):
        for y in (-half_width, half_width):
            self.wall((-length / 2, y), (length / 2, y))
        return self

    def pilasters(self, at, half_width=6.0, depth=1.0):
        """Add walls across, on both sides of the street."""
        for x in at:
            for y, inwards in ((-half_width, 1.0), (half_width, -1.0)):
                self.wall((x, y), (x, y + inwards * depth))
        return self

    def _on_walls(self, step, heights, seed=None):
        c, s = math.cos(self.angle), math.sin(self.angle)
        rotation = np.array([[c, -s], [s, c]])
        generator = np.random.default_rng(seed)
        points, normals = [], []
        for start, end in self.walls:
            start, end = (rotation @ corner + self.sensor.position[:2] for corner in (start, end))
            length = np.linalg.norm(end - start)
            along = (end - start) / length
            normal = np.array([-along[1], along[0]])
            normal *= np.sign(normal @ (self.sensor.position[:2] - start))
            at = np.arange(0.5 * step, length, step)
            if seed is None:
                at, z = (grid.ravel() for grid in np.meshgrid(at, heights))
            else:
                at = generator.uniform(0.0, length, len(at))
                z = generator.uniform(heights[0], heights[-1], len(at))
            points.append(np.column_stack([start + at[:, None] * along, z]))
            normals.append(np.tile([*normal, 0.0], (len(at), 1)))
        return np.concatenate(points), np.concatenate(normals)

    @property
    def point_map(self):
        return PointMap.from_points(*self._on_walls(CELL / 3, ROWS), CELL)

    def scan(self, step=0.15, seed=1):
        points, _ = self._on_walls(step, ROWS, seed)
        return Scan((points - self.sensor.position) @ self.sensor.rotation)

    def prior(self, along=0.0, across=0.0, turn_deg=0.0):
        """Return a pose that is off by that much in street axes, m, and degrees."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return replace(
            self.sensor, x=self.sensor.x + c * along - s * across, y=self.sensor.y + s * along + c * across,
            heading=self.sensor.heading + math.radians(turn_deg),
        )  # fmt: skip

    def error(self, pose):
        """(along, across) in street axes, m."""
        dx, dy = pose.x - self.sensor.x, pose.y - self.sensor.y
        c, s = math.cos(self.angle), math.sin(self.angle)
        return c * dx + s * dy, -s * dx + c * dy

    def distance(self, pose):
        return math.hypot(*self.error(pose))


def skip_without_its_package(method):
    """Skip a test of a method whose package is not installed."""
    if not isinstance(method, Icp | MultiStart):
        pytest.importorskip("small_gicp")


def same(a, b):
    """Whether two estimates are equal to the last bit."""
    names = ("pose", "score", "cell", "status", "share", "runner_up")
    return all(getattr(a, name) == getattr(b, name) for name in names) and (a.cofactor == b.cofactor).all()
