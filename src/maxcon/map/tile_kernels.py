"""Compiled: index and occupancy of a tile, its voxels merged to larger ones, in a dense grid; tiles around positions.

Voxels come in the order (z, patch y, patch x, y, x).
"""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import CANCELLED_LENGTH, MEAN_STEPS, NORMAL_STEPS, PATCH_VOXELS, PRODUCT_STEPS, WORD_BITS

PATCH_BITS = PATCH_VOXELS.bit_length() - 1
INSIDE = PATCH_VOXELS - 1
PATCH_WORDS = PATCH_VOXELS**2 // WORD_BITS


@njit(nogil=True, cache=True)
def _place(x, y, edge):
    """Number of a column of a tile in the order of the search: (patch y, patch x, y, x)."""
    patch = (y >> PATCH_BITS) * (edge >> PATCH_BITS) + (x >> PATCH_BITS)
    return ((patch << PATCH_BITS) + (y & INSIDE) << PATCH_BITS) + (x & INSIDE)


@njit(nogil=True, cache=True)
def find_patches(columns, layers, edge):
    """Find the z index of each layer, the first voxel of each patch of each layer, and how many patches hold voxels.

    The number is -1 if one of the columns (n, 2) lies outside of the tile, or the voxels are not in order.
    """
    n_layers, n_held, before, in_layer = 0, 0, 0, (edge >> PATCH_BITS) ** 2
    for k in range(columns.shape[0]):
        x, y = np.int64(columns[k, 0]), np.int64(columns[k, 1])
        place = _place(x, y, edge)
        is_new = k == 0 or layers[k] > layers[k - 1]
        if not (0 <= x < edge and 0 <= y < edge) or not (is_new or (layers[k] == layers[k - 1] and place > before)):
            return np.empty(0, np.int32), np.zeros(1, np.int32), -1
        n_layers += is_new
        n_held += is_new or place >> 2 * PATCH_BITS > before >> 2 * PATCH_BITS
        before = place
    z_indices, patch_starts = np.empty(n_layers, np.int32), np.empty(n_layers * in_layer + 1, np.int32)
    layer, patch = -1, -1
    for k in range(columns.shape[0]):
        if k == 0 or layers[k] != layers[k - 1]:
            layer += 1
            z_indices[layer] = layers[k]
        here = layer * in_layer + (_place(np.int64(columns[k, 0]), np.int64(columns[k, 1]), edge) >> 2 * PATCH_BITS)
        while patch < here:
            patch += 1
            patch_starts[patch] = k
    patch_starts[patch + 1 :] = columns.shape[0]
    return z_indices, patch_starts, n_held


@njit(nogil=True, cache=True)
def find_occupancy(patch_starts, columns, n_held, held, numbers):
    """Set a bit for each patch that holds voxels and for each voxel; return words and firsts: see `Occupancy`."""
    n_places = held.shape[0]
    n_layers = (patch_starts.shape[0] - 1) // n_places
    for layer in range(n_layers):
        word, bit = layer // WORD_BITS, np.uint64(1) << np.uint64(layer % WORD_BITS)
        for place in range(n_places):
            if patch_starts[layer * n_places + place + 1] > patch_starts[layer * n_places + place]:
                held[place, word] |= bit
    words, firsts = np.zeros((n_held, PATCH_WORDS), np.uint64), np.zeros((n_held, PATCH_WORDS), np.int32)
    number = 0
    for place in range(n_places):
        for layer in range(n_layers):
            if layer % WORD_BITS == 0:
                numbers[place, layer // WORD_BITS] = number
            first, end = patch_starts[layer * n_places + place], patch_starts[layer * n_places + place + 1]
            for k in range(first, end):
                bit = ((columns[k, 1] & INSIDE) << PATCH_BITS) | (columns[k, 0] & INSIDE)
                word = bit // WORD_BITS
                if words[number, word] == 0:
                    firsts[number, word] = k
                words[number, word] |= np.uint64(1) << np.uint64(bit % WORD_BITS)
            number += end > first
        if n_layers % WORD_BITS == 0:
            numbers[place, n_layers // WORD_BITS] = number
    return words, firsts


@njit(nogil=True, cache=True)
def _add(k, column, layer, counts, normals, means, factor, is_signed, n_points, sums, total):
    """Add voxel k to a larger one; positions are in edges of the smaller voxel, from the corner of the larger."""
    n, along = np.int64(counts[k]), 1.0
    if not is_signed and (sums[0] * normals[k, 0] + sums[1] * normals[k, 1] + sums[2] * normals[k, 2] < 0.0):
        along = -1.0
    within = (column[0] % factor, column[1] % factor, layer % factor)
    for axis in range(3):
        sums[axis] += along * n * np.float64(normals[k, axis])
        total[axis] += n * (within[axis] + (means[k, axis] + 0.5) / MEAN_STEPS)
    n_points[0] += n


@njit(nogil=True, cache=True)
def _mean_of(n, sums, total, factor, normal, mean):
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
    """Merge the voxels of a tile, in order, to ones `factor` times as large, `edge` of them to its edge, in order."""
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
            _mean_of(n_points[i, 0], sums[i], totals[i], factor, to_normals[n_merged], to_means[n_merged])
            of_place[places[i]] = -1
            n_merged += 1
    last = slice(0, n_merged)
    return (
        to_columns[last].copy(), to_layers[last].copy(), to_counts[last].copy(), to_normals[last].copy(),
        to_means[last].copy(),
    )  # fmt: skip


@njit(nogil=True, cache=True)
def fill_normals(columns, layers, normals, corner, shape, axis, grid, along, across):
    """Write the normals of a tile's voxels into dense grids (`NormalGrid`).

    corner : (3,) int64, index of the tile's first column in the grid, and what to add to a layer; shape : (nz, ny, nx);
    axis : (2,), a unit vector; grid : (n, 2) int8, along, across : (n,) uint8, out.
    """
    nz, ny, nx = shape
    factor = PRODUCT_STEPS / NORMAL_STEPS**2 * (1.0 + 1e-9)
    for i in range(layers.shape[0]):
        x, y, z = columns[i, 0] + corner[0], columns[i, 1] + corner[1], layers[i] + corner[2]
        if z < 0 or z >= nz or y < 0 or y >= ny or x < 0 or x >= nx:
            continue
        a, b = np.round(NORMAL_STEPS * normals[i, 0]), np.round(NORMAL_STEPS * normals[i, 1])
        if a == 0.0 and b == 0.0:
            continue
        u, v = a * axis[0] + b * axis[1], b * axis[0] - a * axis[1]
        place = (z * ny + y) * nx + x
        grid[place, 0], grid[place, 1] = np.int8(a), np.int8(b)
        along[place], across[place] = np.uint8(np.ceil(factor * u * u)), np.uint8(np.ceil(factor * v * v))


@njit(nogil=True, cache=True)
def mark_tiles(points, rotation, position, margin, edge, corner, is_met):
    """Mark tiles, (nx, ny) from key `corner` on, with a corner of the square within `margin` (m) of a point.

    points : (n, 3), sensor frame, m; rotation, position : (3, 3) and (3,), of the sensor.
    """
    right, top = is_met.shape[0] - 1.0, is_met.shape[1] - 1.0
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + position[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + position[1]
        for side_x in (-margin, margin):
            column = np.int64(min(max(np.floor((x + side_x) / edge) - corner[0], 0.0), right))
            for side_y in (-margin, margin):
                is_met[column, np.int64(min(max(np.floor((y + side_y) / edge) - corner[1], 0.0), top))] = True
