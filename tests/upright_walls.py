"""Upright walls for scenes made by hand: points and normals, which are horizontal and to the left of a wall's way."""

import numpy as np


def _with_normals(points, way):
    x, y = np.asarray(way) / np.linalg.norm(way)
    return points, np.tile([-y, x, 0.0], (len(points), 1))


def on_grid(start, end, heights=(0.0, 3.0), step=0.05, first=0.0):
    """A wall from start to end, (x, y), with a point each step, along it from `first` on."""
    way = np.subtract(end, start)
    length = np.linalg.norm(way)
    at, z = (grid.ravel() for grid in np.meshgrid(np.arange(first, length, step), np.arange(*heights, step)))
    return _with_normals(np.column_stack([start + at[:, None] * way / length, z]), way)


def scattered(start, end, n, seed, heights=(0.0, 3.0)):
    """A wall with points anywhere; seed: of them, or a generator."""
    rng, way = np.random.default_rng(seed), np.subtract(end, start)
    return _with_normals(np.column_stack([start + rng.random((n, 1)) * way, rng.uniform(*heights, n)]), way)


def joined(*walls):
    return tuple(np.concatenate(parts) for parts in zip(*walls, strict=True))
