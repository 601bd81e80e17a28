# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Fewer points for nearest neighbours: what falls into one cube becomes one point."""

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.map.voxelize import turn_alike

__all__ = ["merge_planes", "thin"]

# Cubes are numbered in int64: 2^21 along each axis.
MOST_CUBES = 2**21

LEAST_AGREEMENT = 0.8
"""Length of the mean normal of a cube's points (0 for one without) from which they are called a plane."""


def thin(points: NDArray[np.float64], edge: float) -> NDArray[np.float64]:
    """Mean of the points in each cube of edge `edge` (m), shape (m, 3), ordered by (z, y, x) of the cubes.

    The points themselves where `edge` is 0.
    """
    if edge == 0.0:
        return points
    cube, n_cubes = _cubes(points, edge)
    return _sums(points, cube, n_cubes) / np.bincount(cube, minlength=n_cubes)[:, None]


def merge_planes(
    points: NDArray[np.float64], normals: NDArray[np.floating], edge: float, *, is_signed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean point and mean unit normal of each cube of edge `edge`.

    points, normals: shape (n, 3); m; unit normals, zeros for none.
    edge: m.
    is_signed: whether normals are turned to the sensor's side; otherwise n and -n mean the same.
    Returns points, normals: shape (m, 3); ordered by (z, y, x) of the cubes. A normal is zero where the normals in its
        cube disagree or many are missing: at the edge of a house their mean belongs to no surface.
    """
    cube, n_cubes = _cubes(points, edge)
    if not is_signed:
        normals = turn_alike(normals.astype(np.float64), cube, n_cubes)
    counts = np.bincount(cube, minlength=n_cubes)[:, None]
    mean_points, mean_normals = _sums(points, cube, n_cubes) / counts, _sums(normals, cube, n_cubes) / counts
    lengths = np.linalg.norm(mean_normals, axis=1, keepdims=True)
    is_plane = lengths >= LEAST_AGREEMENT
    return mean_points, np.divide(mean_normals, lengths, out=np.zeros_like(mean_normals), where=is_plane)


def _cubes(points: NDArray[np.float64], edge: float) -> tuple[NDArray[np.int64], int]:
    """Return the number of the cube of each point, 0, 1, ... in the order (z, y, x), and how many there are."""
    if not len(points):
        return np.empty(0, np.int64), 0
    indices = [np.floor(column / edge) for column in points.T]
    firsts = [index.min() for index in indices]
    if max(index.max() - first for index, first in zip(indices, firsts, strict=True)) >= MOST_CUBES:
        extent = float(np.ptp(points, axis=0).max())
        raise ArrayError(
            f"Expected points within {MOST_CUBES * edge:.3g} m of each other, got {extent:.3g} m. Drop stray points,"
            " or thin less finely."
        )
    x, y, z = ((index - first).astype(np.int64) for index, first in zip(indices, firsts, strict=True))
    n_x, n_y = int(x.max()) + 1, int(y.max()) + 1
    found, cube = np.unique((z * n_y + y) * n_x + x, return_inverse=True)
    return cube, len(found)


def _sums(values: NDArray[np.floating], cube: NDArray[np.int64], n_cubes: int) -> NDArray[np.float64]:
    return np.column_stack([np.bincount(cube, weights=column, minlength=n_cubes) for column in values.T])
