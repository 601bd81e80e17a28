# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A street of hand-made facades that repeat every 3 m, but for a porch; and what a scanner sees of it."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from maxcon import MaximumConsensus, PointMap, Pose, Scan, SearchSpace
from maxcon.geometry import wrap_angle

PERIOD = 3.0
PORCH = 40.0
"""Where along the street the one thing stands that does not repeat, m."""
SIGHT = 15.0
"""How far along the street the scanner sees, m."""
CELL = 0.06


def _wall(corner, along, height=3.0):
    """Points every 5 cm on an upright rectangle from a corner (x, y) along a vector (x, y), m."""
    length = math.hypot(*along)
    s, z = np.meshgrid(np.arange(0.025, length, 0.05), np.arange(0.025, height, 0.05))
    towards = np.array(along) / length
    return np.column_stack([np.asarray(corner) + s.reshape(-1, 1) * towards, z.ravel()])


def _street(first=-30.0, last=90.0):
    """Points and normals of two facades 12 m apart with a pilaster every 3 m, and of a porch on the left."""
    parts = []
    for side in (-1.0, 1.0):
        inwards = (0.0, -side, 0.0)
        parts.append((_wall((first, side * 6.03), (last - first, 0.0)), inwards))
        for x in np.arange(first, last, PERIOD):
            parts.append((_wall((x + 0.02, side * 5.63), (0.0, side * 0.4)), (-1.0, 0.0, 0.0)))
            parts.append((_wall((x + 0.52, side * 5.63), (0.0, side * 0.4)), (1.0, 0.0, 0.0)))
    parts.append((_wall((PORCH + 1.2, 3.5), (0.0, 2.5)), (-1.0, 0.0, 0.0)))
    parts.append((_wall((PORCH + 4.2, 3.5), (0.0, 2.5)), (1.0, 0.0, 0.0)))
    return (
        np.concatenate([points for points, _ in parts]),
        np.concatenate([np.tile(normal, (len(points), 1)) for points, normal in parts]),
    )


@dataclass(frozen=True)
class Street:
    """The map of the street, and scans of it."""

    points: np.ndarray
    normals: np.ndarray
    point_map: PointMap

    def scan(self, pose, n_points=2500, seed=0):
        """What is seen from a pose: some points of the map, 1 cm off."""
        rng = np.random.default_rng([seed, round(1e3 * pose.x) + 10**6])
        seen = np.flatnonzero(np.abs(self.points[:, 0] - pose.x) < SIGHT)
        chosen = rng.choice(seen, n_points, replace=False)
        points = self.points[chosen] + 0.01 * rng.standard_normal((n_points, 3))
        return Scan((points - pose.position) @ pose.rotation, self.normals[chosen] @ pose.rotation)

    def clutter(self, seed=0):
        """A scan that shows nothing of the street."""
        rng = np.random.default_rng(seed)
        points = rng.uniform([-5.0, -4.0, -1.0], [5.0, 4.0, 1.0], (2500, 3))
        return Scan(points, np.tile([0.0, 0.0, 1.0], (2500, 1)))


@pytest.fixture(scope="session")
def street():
    points, normals = _street()
    return Street(points, normals, PointMap.from_points(points, normals, cell=CELL))


@pytest.fixture(scope="session")
def method():
    """Looks 3.96 m around a prior: at one period to either side."""
    return MaximumConsensus(SearchSpace(3.96, CELL, 1.0, 0.5))


def where(x):
    """The vehicle's true pose: it sways a little on its way along the street."""
    return Pose(x, 0.3 * math.sin(0.1 * x), 1.5, 0.005, -0.01, 0.03 * math.cos(0.1 * x))


def is_right(pose, x, distance=0.1):
    """Whether a pose lies within a distance (m) and a degree of the true one."""
    true = where(x)
    turn = abs(wrap_angle(pose.heading - true.heading))
    return math.hypot(pose.x - true.x, pose.y - true.y) < distance and turn < math.radians(1.0)
