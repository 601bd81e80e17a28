"""Towns of short walls, and scans of them from a known pose."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

import towns
from maxcon import PointMap, Pose, Scan

CELL = 0.06
TRUTH = Pose(1.23, -0.87, 1.6, 0.0, 0.0, 0.4)


def walls(seed, n_walls=26, reach=22.0):
    """Points and normals of short walls along and across, facing the origin, up to 4 m high."""
    return towns.walls(seed, n_walls, reach, lengths=(2.0, 7.0), height=4.0, step=0.04, noise=0.005)


def seen(points, normals, truth, seed, n_points=4000):
    """A scan of some of the points, with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    which = rng.choice(len(points), n_points, replace=False)
    noisy = points[which] + rng.normal(0.0, 0.01, (n_points, 3))
    return Scan((noisy - truth.position) @ truth.rotation, normals[which] @ truth.rotation)


@cache
def made(seed, scan_seed=None, cell=CELL):
    """Map and scan of a town."""
    points, normals = walls(seed)
    return PointMap.from_points(points, normals, cell), seen(points, normals, TRUTH, scan_seed or seed)


def twins(apart, part=slice(None)):
    """Map and scan of walls that stand once more, in part, so many metres along x."""
    points, normals = walls(5, n_walls=12, reach=8.0)
    both = np.concatenate([points, (points + [apart, 0.0, 0.0])[part]]), np.concatenate([normals, normals[part]])
    return PointMap.from_points(*both, CELL), seen(points, normals, TRUTH, 6)


def beside(x=0.0, y=0.0, z=0.0, turn_deg=0.0):
    """The true pose moved and turned."""
    return replace(TRUTH.translated([x, y, z]), heading=TRUTH.heading + math.radians(turn_deg))
