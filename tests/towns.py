"""Small towns of walls on ground, level or sloping, and scans of them."""

import numpy as np

from maxcon import PointMap, Pose, Scan

CELL = 0.12
HEIGHT = 1.8


def walls(seed, n_walls=40, reach=35.0, middle=(0.0, 0.0), *, lengths=(3.0, 12.0), height=None, step=0.1, noise=0.0):
    """Points and normals of walls along and across, facing the middle, on level ground at 0; else 3 to 9 m high."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for number in range(n_walls):
        start, length = rng.uniform(-reach, reach, 2), rng.uniform(*lengths)
        top = rng.uniform(3.0, 9.0) if height is None else height
        run = np.array([1.0, 0.0]) if number % 2 else np.array([0.0, 1.0])
        along, up = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, length, step), np.arange(0.1, top, 0.1)))
        on_wall = np.column_stack([start + along[:, None] * run, up])
        normal = np.array([run[1], run[0], 0.0])
        normal *= -np.sign(normal[:2] @ (start + 0.5 * length * run)) or 1.0
        points.append(on_wall + rng.normal(0.0, noise, on_wall.shape) if noise else on_wall)
        normals.append(np.tile(normal, (len(on_wall), 1)))
    return np.concatenate(points) + [*middle, 0.0], np.concatenate(normals)


def ground(reach=40.0, middle=(0.0, 0.0), step=0.3):
    """Points on level ground at 0."""
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-reach, reach, step)]))
    return np.column_stack([x + middle[0], y + middle[1], np.zeros(len(x))])


def tilted(points, slope):
    """The same points with the ground sloping by (x, y): walls stay upright."""
    return points + np.column_stack([np.zeros((len(points), 2)), points[:, :2] @ np.asarray(slope)])


def seen(points, normals, on_ground, truth, seed, n_points=6000, reach=45.0):
    """A scan from a pose: some of the wall points around, with 1 cm of noise, and the ground."""
    rng = np.random.default_rng(seed)
    near = np.flatnonzero(np.hypot(*(points[:, :2] - truth.position[:2]).T) < reach)
    which = rng.choice(near, min(n_points, len(near)), replace=False)
    low = on_ground[np.hypot(*(on_ground[:, :2] - truth.position[:2]).T) < 25.0]
    all_points = np.concatenate([points[which], low])
    all_normals = np.concatenate([normals[which], np.tile([0.0, 0.0, 1.0], (len(low), 1))])
    noisy = all_points + rng.normal(0.0, 0.01, all_points.shape)
    return Scan((noisy - truth.position) @ truth.rotation, all_normals @ truth.rotation)


class Town:
    """A map, and scans of it."""

    def __init__(self, seed, slope=(0.0, 0.0), cell=CELL, **kinds):
        self.walls, self.normals = walls(seed, **kinds)
        middle = kinds.get("middle", (0.0, 0.0))
        self.ground = tilted(ground(middle=middle), slope)
        self.walls, self.slope = tilted(self.walls, slope), slope
        self.map = PointMap.from_points(self.walls, self.normals, cell, ground=self.ground)

    def pose(self, x, y, heading):
        """A scanner HEIGHT above the ground, upright."""
        return Pose(x, y, HEIGHT + x * self.slope[0] + y * self.slope[1], 0.0, 0.0, heading)

    def scan(self, truth, seed=0, **kinds):
        """What is seen from there."""
        return seen(self.walls, self.normals, self.ground, truth, seed, **kinds)
