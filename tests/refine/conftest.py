import math

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan

CELL = 0.06


def planes_of_a_yard(offset, n_per_square_metre, rng):
    """Points and normals of four thin walls and two eaves about the origin, moved by `offset`."""
    parts = []
    for azimuth, distance, half in ((0.1, 9.0, 8.0), (1.6, 6.0, 9.0), (3.1, 11.0, 7.0), (4.9, 7.0, 9.0)):
        n = int(2 * half * 6.0 * n_per_square_metre)
        u, h = rng.uniform(-half, half, n), rng.uniform(-1.0, 5.0, n)
        normal = np.array([-math.cos(azimuth), -math.sin(azimuth), 0.0])
        along = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
        parts.append((-distance * normal + u[:, None] * along + h[:, None] * [0, 0, 1], normal))
    for x, y, z in ((5.0, 3.0, 3.3), (-6.0, -3.0, 2.4), (2.0, -5.0, 3.9), (-4.0, 4.0, 2.9)):
        n = int(16.0 * n_per_square_metre)
        points = np.column_stack([rng.uniform(x - 2, x + 2, n), rng.uniform(y - 2, y + 2, n), np.full(n, z)])
        parts.append((points, np.array([0.0, 0.0, -1.0])))
    points = np.concatenate([points for points, _ in parts]) + offset
    normals = np.concatenate([np.tile(normal, (len(points), 1)) for points, normal in parts])
    return points, normals


@pytest.fixture(scope="session")
def yard():
    """Make a map and a scan of thin walls that lie anywhere between the faces of voxels."""

    def make(seed=0, at=(0.0, 0.0, 0.0), noise=0.0, share_with_normals=1.0, n_per_square_metre=400, sigma=0.0):
        rng = np.random.default_rng(seed)
        offset = rng.uniform(-0.5, 0.5, 3) + at
        points, normals = planes_of_a_yard(offset, n_per_square_metre, rng)
        noisy = points + rng.normal(0.0, noise, (len(points), 1)) * normals
        point_map = PointMap.from_points(noisy, normals, CELL, sigma=sigma)
        truth = Pose(*offset, 0.004, -0.003, 0.4)
        points, normals = planes_of_a_yard(offset, 40, rng)
        points = points + rng.normal(0.0, noise, (len(points), 1)) * normals
        normals[rng.random(len(normals)) > share_with_normals] = 0.0
        scan = Scan((points - truth.position) @ truth.rotation, normals @ truth.rotation)
        return scan, point_map, truth

    return make
