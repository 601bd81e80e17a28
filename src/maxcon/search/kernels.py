# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled inner loops of the exhaustive search: from visits to sums. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map import PATCH_VOXELS
from maxcon.search.adding_kernels import ROUNDER, add_alike, add_once, add_times
from maxcon.search.visit_kernels import RIM, rectangle_in_tile

__all__ = ["accumulate_tile"]

# Voxels that a visit takes at a time, a multiple of BLOCK: laid out they fit into the L1 cache.
CAPACITY = 256

# Weights are made by so many at a time: what the compiler makes of a whole block has no remainder.
BLOCK = 32

# Shifts instead of divisions: with these the search took 1.16 times as long.
PATCH_BITS = PATCH_VOXELS.bit_length() - 1


@njit(nogil=True, cache=True)
def _take(voxel_columns, first, last, low, span, taken, n_taken):
    """Append to `taken` those voxels of a run that lie in a rectangle; without a branch. Returns how many."""
    for k in range(first, last):
        taken[n_taken] = k
        x = np.uint32(np.int32(voxel_columns[np.uint64(k), 0]) - low[0])
        y = np.uint32(np.int32(voxel_columns[np.uint64(k), 1]) - low[1])
        n_taken += np.uint64((x <= span[0]) & (y <= span[1]))
    return n_taken


@njit(nogil=True, cache=True)
def _lay_out(taken, voxel_columns, voxel_normals, counts, stride, normals, factors, cells, times):
    """Lay out the taken voxels as the votes read them: those with a normal first, then the others.

    normals : (3, c) float32; factors : (4 c,) float64, 0, nx nx, nx ny, ny ny; cells : (c,) int32, where in the
    sums a scan point in voxel (0, 0) meets them; times : (c,) float64, their counts, if any. All out.
    Returns how many have a normal.
    """
    has_counts = counts.shape[0] > 0
    one, n_normals, n_left = np.uint64(1), np.uint64(0), np.uint64(taken.shape[0])
    for number in taken:
        k = np.uint64(number)
        nx, ny, nz = voxel_normals[k, 0], voxel_normals[k, 1], voxel_normals[k, 2]
        has_normal = np.uint64((nx != 0.0) | (ny != 0.0) | (nz != 0.0))
        n_left -= one - has_normal
        to = n_normals if has_normal == one else n_left
        n_normals += has_normal
        normals[0, to], normals[1, to], normals[2, to] = nx, ny, nz
        at = np.uint64(4) * to
        factors[at + np.uint64(1)] = nx * nx
        factors[at + np.uint64(2)] = nx * ny
        factors[at + np.uint64(3)] = ny * ny
        cells[to] = np.int32(4) * (np.int32(voxel_columns[k, 1]) * stride + np.int32(voxel_columns[k, 0]))
        if has_counts:
            times[to] = counts[k]
    return np.int64(n_normals)


@njit(nogil=True, cache=True)
def _lay_out_alike(n_taken, without_normal, factors, times, rows):
    """Lay out what a match of weight `without_normal` adds at each voxel: rows : (4 c,) float64, out."""
    has_counts = times.shape[0] > 0
    for j in range(n_taken):
        at, n_points = np.uint64(4 * j), 1.0
        if has_counts:
            n_points = times[j]
        weight, rows[at] = without_normal * n_points, n_points
        for channel in range(np.uint64(1), np.uint64(4)):
            rows[at + channel] = weight * factors[at + channel] + ROUNDER - ROUNDER


@njit(nogil=True, cache=True, forceinline=True)
def _weigh(normals, n_normals, turned, i, back, weights):
    """Weights of the matches of a scan point: w = max(c, 0) where normals have a side, |c| = max(c, -c) where not.

    back : 0, or -1 where not.
    """
    nx, ny, nz = turned[0, i], turned[1, i], turned[2, i]
    for j in range((n_normals + BLOCK - 1) // BLOCK * BLOCK):
        cosine = nx * normals[0, j] + ny * normals[1, j] + nz * normals[2, j]
        weights[j] = max(cosine, back * cosine)


@njit(nogil=True, cache=True)
def _vote(
    headings, points, columns, turned, origin, stride, back, n_normals, n_taken, normals, factors, cells, times,
    weights, sums,
):  # fmt: skip
    """Add the matches of scan points with the laid out voxels to the sums of some headings.

    headings, points : first and end; origin : where in the sums a point in voxel (0, 0) meets a voxel (0, 0).
    """
    for heading in range(headings[0], headings[1]):
        cell_sums = sums[heading]
        for i in range(points[0], points[1]):
            base = 4 * ((origin[1] - columns[heading, 1, i]) * stride + origin[0] - columns[heading, 0, i])
            _weigh(normals, n_normals, turned[heading], i, back, weights)
            for j in range(n_normals):
                add_once(cell_sums, base + cells[j], factors, weights, times, j)
            for j in range(n_normals, n_taken):
                cell_sums[np.uint64(base + cells[j])] += 1.0


@njit(nogil=True, cache=True)
def _vote_times(
    headings, points, columns, turned, origin, stride, back, n_normals, n_taken, normals, factors, cells, times,
    weights, sums,
):  # fmt: skip
    """As `_vote`, each voxel as often as it has points."""
    for heading in range(headings[0], headings[1]):
        cell_sums = sums[heading]
        for i in range(points[0], points[1]):
            base = 4 * ((origin[1] - columns[heading, 1, i]) * stride + origin[0] - columns[heading, 0, i])
            _weigh(normals, n_normals, turned[heading], i, back, weights)
            for j in range(n_normals):
                weights[j] *= times[j]
            for j in range(n_normals):
                add_times(cell_sums, base + cells[j], factors, weights, times, j)
            for j in range(n_normals, n_taken):
                cell_sums[np.uint64(base + cells[j])] += times[j]


@njit(nogil=True, cache=True)
def _vote_alike(headings, points, columns, origin, stride, n_taken, cells, rows, sums):
    """Add the matches of scan points without a normal: those in one voxel add the same, and are added at once.

    headings, points : first and end; points in one voxel follow each other.
    """
    for heading in range(headings[0], headings[1]):
        cell_sums, i = sums[heading], points[0]
        while i < points[1]:
            x, y, n_alike = columns[heading, 0, i], columns[heading, 1, i], 0.0
            while i < points[1] and columns[heading, 0, i] == x and columns[heading, 1, i] == y:
                n_alike += 1.0
                i += 1
            base = 4 * ((origin[1] - y) * stride + origin[0] - x)
            for j in range(n_taken):
                add_alike(cell_sums, base + cells[j], rows, n_alike, j)


@njit(nogil=True, cache=True)
def _visit(
    taken, headings, points, columns, turned, voxel_columns, voxel_normals, counts, origin, stride, weighting,
    normals, factors, cells, times, weights, rows, sums,
):  # fmt: skip
    """Add the matches of the scan points of a visit with the taken voxels, at all its headings."""
    n_taken = taken.shape[0]
    without_normal, back = weighting
    n_normals = _lay_out(taken, voxel_columns, voxel_normals, counts, stride, normals, factors, cells, times)
    first, middle, end = points
    if times.shape[0] == 0:
        _vote(
            headings, (first, middle), columns, turned, origin, stride, back, n_normals, n_taken, normals,
            factors, cells, times, weights, sums,
        )  # fmt: skip
    else:
        _vote_times(
            headings, (first, middle), columns, turned, origin, stride, back, n_normals, n_taken, normals,
            factors, cells, times, weights, sums,
        )  # fmt: skip
    if middle < end:
        _lay_out_alike(n_taken, without_normal, factors, times, rows)
        _vote_alike(headings, (middle, end), columns, origin, stride, n_taken, cells, rows, sums)


@njit(nogil=True, cache=True)
def accumulate_tile(
    numbers, visits, starts, middles, ranks, layers, columns, turned, corner, edge, patch_starts, voxel_columns,
    voxel_normals, counts, window, stride, without_normal, is_signed, sums,
):  # fmt: skip
    """Add all matches of some scan points with one tile to the sums of some headings.

    numbers : which visits; visits : (m, 7) as planned; starts : (groups + 1,), first point of each group;
    middles : (groups,), its first point without a normal; ranks : (groups,), number of its height layer among
    the scan's; layers : that layer's number in the tile, -1 for none; columns : (headings, 2, n) int32, the
    points' voxels; turned : (headings, 3, n) float32, their normals.
    corner : (x, y) voxel index of the tile; edge : voxels along its edge; voxel_columns : (k, 2) int16;
    voxel_normals : (k, 3) float32; counts : (k,) int32, or empty where a voxel counts once.
    window : (x first, x last, y first, y last) offset; stride : cells from one row of the sums to the next;
    without_normal : weight of a match whose scan point has no normal; sums : (headings, 4 rows stride) float64, with a
    rim of RIM cells where voxels fall that only other points of a visit meet.
    """
    stride, n_patches = np.int32(stride), edge >> PATCH_BITS
    origin = (RIM + corner[0] - window[0], RIM + corner[1] - window[2])
    weighting = (np.float64(without_normal), np.float32(0.0 if is_signed else -1.0))
    taken = np.empty(CAPACITY, np.int64)
    normals, factors = np.zeros((3, CAPACITY), np.float32), np.zeros(4 * CAPACITY)
    cells, weights, rows = np.empty(CAPACITY, np.int32), np.empty(CAPACITY), np.empty(4 * CAPACITY)
    times = np.empty(CAPACITY if counts.shape[0] > 0 else 0)
    for number in numbers:
        group = visits[number, 0]
        layer = layers[ranks[group]]
        if layer < 0:
            continue
        headings = (visits[number, 1], visits[number, 2])
        points = (starts[group], middles[group], starts[group + 1])
        x_first, x_last, y_first, y_last = rectangle_in_tile(visits[number], window, corner, edge)
        low, span = (x_first, y_first), (np.uint32(x_last - x_first), np.uint32(y_last - y_first))
        n_taken = np.uint64(0)
        for py in range(y_first >> PATCH_BITS, (y_last >> PATCH_BITS) + 1):
            row = (layer * n_patches + py) * n_patches
            k = np.int64(patch_starts[row + (x_first >> PATCH_BITS)])
            run_end = np.int64(patch_starts[row + (x_last >> PATCH_BITS) + 1])
            while k < run_end:
                end = min(run_end, k + CAPACITY - np.int64(n_taken))
                n_taken = _take(voxel_columns, k, end, low, span, taken, n_taken)
                k = end
                if n_taken == CAPACITY:
                    _visit(
                        taken, headings, points, columns, turned, voxel_columns, voxel_normals, counts, origin,
                        stride, weighting, normals, factors, cells, times, weights, rows, sums,
                    )  # fmt: skip
                    n_taken = np.uint64(0)
        if n_taken > 0:
            _visit(
                taken[:n_taken], headings, points, columns, turned, voxel_columns, voxel_normals, counts, origin,
                stride, weighting, normals, factors, cells, times, weights, rows, sums,
            )  # fmt: skip
