# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Vegetation among unclassified surfaces: where the points around are scattered in all directions (decision 23)."""

import math

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.voxel_moments import LAYER, ROW, VoxelMoments, voxel_keys

__all__ = ["is_vegetation"]

SHAPE_EDGE = 0.12
"""Of the voxels whose shape is looked at, m: the power of two of a map's voxels nearest to this."""
REACH = 2
"""Voxels around them on each side: cubes of 0.6 m."""
COUNT_CAP = 8.0
LEAST_VOXELS = 4
SCATTERED = 0.2
"""Smallest by largest eigenvalue from which on points are scattered: the corner of a house stays below."""
LEAST_SHARE = 0.55
"""Of the voxels within cubes of 1.2 m that are scattered, in vegetation."""


def is_vegetation(moments: VoxelMoments, cell: float) -> NDArray[np.bool_]:
    """Which voxels of a tile with its halo, without the ground, are vegetation.

    Parameters
    ----------
    moments : VoxelMoments
        The voxels.
    cell : float
        Voxel edge, m.
    """
    from maxcon.mapping.build.shape_kernels import scatters, sums_near

    level, edge, place = moments, cell, np.arange(len(moments))
    for _ in range(max(0, round(math.log2(SHAPE_EDGE / cell)))):
        level, edge, parents = level.coarser(edge), 2.0 * edge, voxel_keys(level.indices >> 1)
        place = np.searchsorted(level.keys, parents)[place]
    scatter = np.empty(len(level))
    scatters(
        level.keys, level.counts, level.sums, level.outers, edge, ROW, LAYER, REACH, COUNT_CAP,
        LEAST_VOXELS, scatter,
    )  # fmt: skip
    blocks, block_of_voxel = np.unique(voxel_keys(level.indices >> 1), return_inverse=True)
    is_known = np.isfinite(scatter)
    is_scattered = is_known & (np.nan_to_num(scatter) > SCATTERED)
    counted = np.column_stack(
        [np.bincount(block_of_voxel, shown, len(blocks)) for shown in (is_scattered, is_known)]
    )
    totals = np.zeros_like(counted)
    sums_near(blocks, counted, ROW, LAYER, REACH, totals)
    is_green = (totals[:, 1] > 0.0) & (totals[:, 0] >= LEAST_SHARE * totals[:, 1])
    green: NDArray[np.bool_] = is_green[block_of_voxel][place]
    return green
