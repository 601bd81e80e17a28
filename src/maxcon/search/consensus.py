# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The consensus set: which scan points match the map at one cell."""

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, voxel_centers, voxel_indices
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.matching import cells_of, turn, upright
from maxcon.search.space import Cell, SearchSpace

__all__ = ["consensus_set"]


def consensus_set(scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, cell: Cell) -> NDArray[np.bool_]:
    """Whether each scan point falls in a voxel of the map when the sensor is at `cell`.

    Parameters
    ----------
    scan : Scan
        n points, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        The cells.
    cell : tuple of 3 int
        (heading, y, x) of one of them.

    Returns
    -------
    array, shape (n,), bool
    """
    space = cells_of(space, point_map)
    heading, iy, ix = cell
    _, ny, nx = space.shape
    scan_upright = upright(scan, prior)
    points = turn(scan_upright.points, prior.heading + space.headings[heading]) + [prior.x, prior.y, 0.0]
    indices = voxel_indices(points, point_map.cell) + np.array([ix - nx // 2, iy - ny // 2, 0], dtype=np.int32)
    if len(indices) == 0:
        return np.zeros(0, bool)
    low, high = indices.min(axis=0), indices.max(axis=0)
    size = (high - low + 1).astype(np.int64)
    wanted = _flat(indices - low, size)
    centers = voxel_centers(indices, point_map.cell)[:, :2]
    is_matched = np.zeros(len(indices), bool)
    for tile in point_map.tiles_around(centers, 0.0):
        voxels = tile.voxels
        is_near = ((voxels >= low) & (voxels <= high)).all(axis=1)
        is_matched |= np.isin(wanted, _flat(voxels[is_near] - low, size))
    return is_matched


def _flat(indices: NDArray[np.int32], size: NDArray[np.int64]) -> NDArray[np.int64]:
    x, y, z = indices.T.astype(np.int64)
    numbers: NDArray[np.int64] = (z * size[1] + y) * size[0] + x
    return numbers
