# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The voxels of a tile merged to larger ones, compiled. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map.tile import MEAN_STEPS, PATCH_VOXELS
from maxcon.point_map.voxelize import CANCELLED_LENGTH

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
def merge(columns, layers, counts, normals, means, edge, factor, is_signed):
    """Merge the voxels of a tile to voxels `factor` times as large, of which `edge` make its edge.

    columns : (n, 2) int16; layers, counts : (n,) int32; normals : (n, 3) float32; means : (n, 3) uint8; in order.
    Returns the same of the larger voxels, in order.
    """
    n = columns.shape[0]
    of_place = np.full(edge * edge, -1, np.int32)
    places, order = np.empty(edge * edge, np.int64), np.empty(edge * edge, np.int64)
    merged_columns, merged_layers = np.empty((n, 2), np.int16), np.empty(n, np.int32)
    merged_counts = np.empty(n, np.int32)
    merged_normals, merged_means = np.empty((n, 3), np.float32), np.empty((n, 3), np.uint8)
    sums, totals, n_points = (
        np.empty((edge * edge, 3)),
        np.empty((edge * edge, 3)),
        np.empty((edge * edge, 1), np.int64),
    )
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
                k,
                (x, y),
                layers[k],
                counts,
                normals,
                means,
                factor,
                is_signed,
                n_points[at],
                sums[at],
                totals[at],
            )
            k += 1
        order[:n_places] = np.argsort(places[:n_places])
        for i in order[:n_places]:
            place, patch = places[i], places[i] >> (2 * PATCH_BITS)
            merged_columns[n_merged, 0] = (patch % (edge >> PATCH_BITS) << PATCH_BITS) + (place & INSIDE)
            merged_columns[n_merged, 1] = (patch // (edge >> PATCH_BITS) << PATCH_BITS) + (
                place >> PATCH_BITS & INSIDE
            )
            merged_layers[n_merged], merged_counts[n_merged] = layer, min(n_points[i, 0], 2**31 - 1)
            _settle(
                n_points[i, 0], sums[i], totals[i], factor, merged_normals[n_merged], merged_means[n_merged]
            )
            of_place[place] = -1
            n_merged += 1
    return (
        merged_columns[:n_merged].copy(),
        merged_layers[:n_merged].copy(),
        merged_counts[:n_merged].copy(),
        merged_normals[:n_merged].copy(),
        merged_means[:n_merged].copy(),
    )
