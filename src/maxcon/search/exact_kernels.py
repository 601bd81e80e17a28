# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled inner loops for single cells. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS
from maxcon.search.kernels import ROUNDER

__all__ = ["moments_of_cells"]

PATCH_BITS = PATCH_VOXELS.bit_length() - 1


@njit(nogil=True, cache=True)
def _voxel(x, y, layer, patch_starts, voxel_columns):
    """Number of the voxel (x, y) of a layer of a tile, -1 where there is none."""
    patch = (layer * TILE_PATCHES + (y >> PATCH_BITS)) * TILE_PATCHES + (x >> PATCH_BITS)
    low, end = patch_starts[patch], patch_starts[patch + 1]
    high = end
    while low < high:  # voxels of a patch are sorted by y, then x
        middle = (low + high) >> 1
        at_x, at_y = voxel_columns[middle, 0], voxel_columns[middle, 1]
        if at_y < y or (at_y == y and at_x < x):
            low = middle + 1
        else:
            high = middle
    return low if low < end and voxel_columns[low, 0] == x and voxel_columns[low, 1] == y else -1


@njit(nogil=True, cache=True)
def moments_of_cells(
    offsets, groups, starts, ends, ranks, layers, columns, turned, corner, patch_starts, voxel_columns, voxel_normals,
    counts, is_weighted, is_signed, moments,
):  # fmt: skip
    """Add the matches of some groups of scan points with one tile to the moments of some cells of one heading.

    offsets : (c, 2) int64, (x, y) of each cell, voxels; groups : their numbers; starts, ends : points of each group;
    ranks : number of its layer among the scan's; layers : that layer's number in the tile, -1 for none;
    columns : (2, n) int32, turned : (3, n) float32. The tile as for `kernels.accumulate_tile`, and with the same
    arithmetic. moments : (c, 4) float64, in and out.
    """
    back = np.float32(0.0 if is_signed else -1.0)
    for group in groups:
        layer = layers[ranks[group]]
        if layer < 0:
            continue
        for i in range(starts[group], ends[group]):
            for c in range(offsets.shape[0]):
                x = columns[0, i] + offsets[c, 0] - corner[0]
                y = columns[1, i] + offsets[c, 1] - corner[1]
                if x < 0 or y < 0 or x >= TILE_VOXELS or y >= TILE_VOXELS:
                    continue
                k = _voxel(x, y, layer, patch_starts, voxel_columns)
                if k < 0:
                    continue
                nx, ny, nz = voxel_normals[k, 0], voxel_normals[k, 1], voxel_normals[k, 2]
                weight = 1.0
                if is_weighted:
                    cosine = turned[0, i] * nx + turned[1, i] * ny + turned[2, i] * nz
                    weight = np.float64(max(cosine, back * cosine))
                times = np.float64(counts[k]) if counts.shape[0] > 0 else 1.0
                weight *= times
                moments[c, 0] += times
                moments[c, 1] += weight * np.float64(nx * nx) + ROUNDER - ROUNDER
                moments[c, 2] += weight * np.float64(nx * ny) + ROUNDER - ROUNDER
                moments[c, 3] += weight * np.float64(ny * ny) + ROUNDER - ROUNDER
