# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled inner loops of the bounds: what matches add along one axis, at most. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map import PATCH_VOXELS, TILE_PATCHES
from maxcon.search.visit_kernels import RIM, rectangle_in_tile

__all__ = ["bound_tile"]

# Voxels that a visit takes at a time: laid out they fit into the L1 cache.
CAPACITY = 256

PATCH_BITS = PATCH_VOXELS.bit_length() - 1


@njit(nogil=True, cache=True)
def _take(voxel_columns, voxel_normals, counts, first, last, low, span, axis, least, taken, values, n_taken):
    """Append to `taken` those voxels of a run that lie in a rectangle and add more than `least`; without a branch.

    values : (c,) float32, out, what a match of weight one adds along the axis. Returns how many are taken.
    """
    has_counts, is_count = counts.shape[0] > 0, axis[0] == 0.0 and axis[1] == 0.0
    for k in range(first, last):
        along = voxel_normals[np.uint64(k), 0] * axis[0] + voxel_normals[np.uint64(k), 1] * axis[1]
        value = np.float32(1.0) if is_count else along * along
        if has_counts:
            value *= np.float32(counts[k])
        taken[n_taken] = k
        values[n_taken] = value
        x = np.uint32(np.int32(voxel_columns[np.uint64(k), 0]) - low[0])
        y = np.uint32(np.int32(voxel_columns[np.uint64(k), 1]) - low[1])
        n_taken += np.uint64((x <= span[0]) & (y <= span[1]) & (value > least))
    return n_taken


@njit(nogil=True, cache=True)
def _vote(
    taken, values, visit, points, columns, turned, voxel_columns, voxel_normals, origin, stride, weighting, scale,
    normals, units, cells, added, sums,
):  # fmt: skip
    """Add what the matches of scan points with the taken voxels add along the axis, rounded up, to the sums.

    weighting : whether weights are cosines, or one; 0 or -1. normals : (3, c), units : (c,) float32,
    cells : (c,) int32, added : (c,) of the type of the sums: scratch.
    """
    is_weighted, back = weighting
    n = taken.shape[0]
    for j in range(n):
        k = np.uint64(taken[j])
        normals[0, j], normals[1, j], normals[2, j] = (
            voxel_normals[k, 0],
            voxel_normals[k, 1],
            voxel_normals[k, 2],
        )
        units[j] = values[j] * scale
        cells[j] = np.int32(voxel_columns[k, 1]) * stride + np.int32(voxel_columns[k, 0])
    for heading in range(visit[1], visit[2]):
        cell_sums = sums[heading]
        for i in range(points[0], points[1]):
            base = (origin[1] - columns[heading, 1, i]) * stride + origin[0] - columns[heading, 0, i]
            if is_weighted:
                nx, ny, nz = turned[heading, 0, i], turned[heading, 1, i], turned[heading, 2, i]
                for j in range(n):
                    cosine = nx * normals[0, j] + ny * normals[1, j] + nz * normals[2, j]
                    # Two more: one to round up, one for what float32 and the rounded sums of the search may differ.
                    added[j] = np.int32(max(cosine, back * cosine) * units[j] + np.float32(2.0))
            else:
                for j in range(n):
                    added[j] = np.int32(units[j] + np.float32(2.0))
            for j in range(n):
                cell_sums[np.uint64(base + cells[j])] += added[j]


@njit(nogil=True, cache=True)
def bound_tile(
    numbers, visits, starts, middles, ranks, layers, columns, turned, corner, patch_starts, voxel_columns,
    voxel_normals, counts, offsets, is_weighted, is_signed, axis, least, scale, sums,
):  # fmt: skip
    """Add what all matches of some scan points with one tile add to N along an axis, at most, to sums.

    As `kernels.accumulate_tile`, but for: points without a normal add nothing; voxels that add no more than
    `least` are left out. axis : (x, y) float32, unit, or zeros to count matches, those of points without a normal
    too; scale : float32, units of the sums in one. sums : (headings, rows stride) int32 or int64.
    """
    first, last, stride = offsets[0], offsets[0] + offsets[1] - 1, np.int32(offsets[2])
    origin = (RIM + corner[0] - first, RIM + corner[1] - first)
    weighting = (is_weighted, np.float32(0.0 if is_signed else -1.0))
    taken, values = np.empty(CAPACITY, np.int64), np.empty(CAPACITY, np.float32)
    normals, units = np.zeros((3, CAPACITY), np.float32), np.zeros(CAPACITY, np.float32)
    cells, added = np.empty(CAPACITY, np.int32), np.empty(CAPACITY, sums.dtype)
    for number in numbers:
        group = visits[number, 0]
        layer = layers[ranks[group]]
        points = (starts[group], starts[group + 1] if axis[0] == 0.0 and axis[1] == 0.0 else middles[group])
        if layer < 0 or points[0] == points[1]:
            continue
        x_first, x_last, y_first, y_last = rectangle_in_tile(visits[number], first, last, corner)
        low, span = (x_first, y_first), (np.uint32(x_last - x_first), np.uint32(y_last - y_first))
        n_taken = np.uint64(0)
        for py in range(y_first >> PATCH_BITS, (y_last >> PATCH_BITS) + 1):
            row = (layer * TILE_PATCHES + py) * TILE_PATCHES
            k = patch_starts[row + (x_first >> PATCH_BITS)]
            run_end = patch_starts[row + (x_last >> PATCH_BITS) + 1]
            while k < run_end:
                end = min(run_end, k + CAPACITY - np.int64(n_taken))
                n_taken = _take(
                    voxel_columns,
                    voxel_normals,
                    counts,
                    k,
                    end,
                    low,
                    span,
                    axis,
                    least,
                    taken,
                    values,
                    n_taken,
                )
                k = end
                if n_taken == CAPACITY:
                    _vote(
                        taken, values, visits[number], points, columns, turned, voxel_columns, voxel_normals, origin,
                        stride, weighting, scale, normals, units, cells, added, sums,
                    )  # fmt: skip
                    n_taken = np.uint64(0)
        if n_taken > 0:
            _vote(
                taken[:n_taken], values, visits[number], points, columns, turned, voxel_columns, voxel_normals, origin,
                stride, weighting, scale, normals, units, cells, added, sums,
            )  # fmt: skip
