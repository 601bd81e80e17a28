# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The voxels of a tile merged to larger ones, compiled. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.map.layout import MEAN_STEPS, PATCH_VOXELS
from maxcon.map.voxelize import CANCELLED_LENGTH

__all__ = ["merge"]

PATCH_BITS = PATCH_VOXELS.bit_length() - 1
INSIDE = PATCH_VOXELS - 1


@njit(nogil=True, cache=True)
def _place(x, y, edge):
    """Number of a column of a tile in the order of the search: (patch y, patch x, y, x)."""
    patch = (y >> PATCH_BITS) * (edge >> PATCH_BITS) + (x >> PATCH_BITS)
    return ((patch << PATCH_BITS) + (y & INSIDE) << PATCH_BITS) + (x & INSIDE)


@njit(nogil=True, cache=True)
def _add(k, column, layer, counts, normals, means, factor, is_signed, n_points, sums, total):
    """Add voxel k to a larger one: its points to n_points, (1,), their normals to `sums`, positions to `total`, (3,).

    Positions are counted in edges of the smaller voxel, from the corner of the larger one.
    """
    n, along = np.int64(counts[k]), 1.0
    if not is_signed and (sums[0] * normals[k, 0] + sums[1] * normals[k, 1] + sums[2] * normals[k, 2] < 0.0):
        along = -1.0
    within = (column[0] % factor, column[1] % factor, layer % factor)
    for axis in range(3):
        sums[axis] += along * n * np.float64(normals[k, axis])
        total[axis] += n * (within[axis] + (means[k, axis] + 0.5) / MEAN_STEPS)
    n_points[0] += n


@njit(nogil=True, cache=True)
def _settle(n, sums, total, factor, normal, mean):
    """Mean normal, (3,) float32, out, zeros where the sum cancels, and mean position, (3,) uint8, out, of n points."""
    length = np.sqrt(sums[0] * sums[0] + sums[1] * sums[1] + sums[2] * sums[2])
    for axis in range(3):
        normal[axis] = sums[axis] / length if length > CANCELLED_LENGTH * n else 0.0
        step = np.int64(np.floor(total[axis] / n * (MEAN_STEPS / factor)))
        mean[axis] = min(max(step, 0), MEAN_STEPS - 1)


@njit(nogil=True, cache=True)
def _column(place, edge):
    """Column (x, y) of a tile whose number in the order of the search is `place`."""
    n_patches, patch = edge >> PATCH_BITS, place >> (2 * PATCH_BITS)
    x = (patch % n_patches << PATCH_BITS) + (place & INSIDE)
    return x, (patch // n_patches << PATCH_BITS) + (place >> PATCH_BITS & INSIDE)


@njit(nogil=True, cache=True)
def merge(columns, layers, counts, normals, means, edge, factor, is_signed):
    """Merge the voxels of a tile to voxels `factor` times as large, of which `edge` make its edge.

    columns : (n, 2) int16; layers, counts : (n,) int32; normals : (n, 3) float32; means : (n, 3) uint8; in order.
    Returns the same of the larger voxels, in order.
    """
    n, n_columns = columns.shape[0], edge * edge
    of_place, places = np.full(n_columns, -1, np.int32), np.empty(n_columns, np.int64)
    sums, totals = np.empty((n_columns, 3)), np.empty((n_columns, 3))
    n_points = np.empty((n_columns, 1), np.int64)
    to_columns, to_layers, to_counts = (np.empty((n, 2), np.int16), np.empty(n, np.int32), np.empty(n, np.int32))
    to_normals, to_means = np.empty((n, 3), np.float32), np.empty((n, 3), np.uint8)
    n_merged, k = 0, 0
    while k < n:
        layer, n_places = layers[k] // factor, 0
        while k < n and layers[k] // factor == layer:
            x, y = np.int64(columns[k, 0]), np.int64(columns[k, 1])
            place = _place(x // factor, y // factor, edge)
            at = of_place[place]
            if at < 0:
                at = of_place[place] = n_places
                places[n_places] = place
                n_points[at], sums[at], totals[at] = 0, 0.0, 0.0
                n_places += 1
            _add(
                k, (x, y), layers[k], counts, normals, means, factor, is_signed, n_points[at], sums[at], totals[at]
            )  # fmt: skip
            k += 1
        for i in np.argsort(places[:n_places]):
            to_columns[n_merged, 0], to_columns[n_merged, 1] = _column(places[i], edge)
            to_layers[n_merged], to_counts[n_merged] = layer, min(n_points[i, 0], 2**31 - 1)
            _settle(n_points[i, 0], sums[i], totals[i], factor, to_normals[n_merged], to_means[n_merged])
            of_place[places[i]] = -1
            n_merged += 1
    last = slice(0, n_merged)
    return (
        to_columns[last].copy(), to_layers[last].copy(), to_counts[last].copy(), to_normals[last].copy(),
        to_means[last].copy(),
    )  # fmt: skip
