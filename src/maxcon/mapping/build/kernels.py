# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled loops of the map build: moments of voxels, planes and shapes of their neighbourhoods, numbers of places."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.scan.plane_kernels import covariance, plane_normal

# Two rounds of multiplying and folding (the finalizer of splitmix64): one-to-one, and spread evenly.
FIRST_FACTOR = np.uint64(0xBF58476D1CE4E5B9)
SECOND_FACTOR = np.uint64(0x94D049BB133111EB)
INDEX_BITS = 21


@njit(nogil=True, cache=True)
def gather_points(order, keys, inside, sides, counts, sums, outers, side_sums):
    """Sum the points of each voxel.

    order : (n,) numbers of the points by ascending key; keys : (n,) int64; inside : (n, 3) float32,
    position in the voxel, m; sides : (n, 3) float32, direction to the sensor or normal.
    counts (n,), sums (n, 3), outers (n, 6), side_sums (n, 3) : out, zeroed; the first rows are filled.
    Returns the number of voxels.
    """
    voxel = -1
    previous = np.int64(0)
    for i in order:
        if voxel < 0 or keys[i] != previous:
            voxel += 1
            previous = keys[i]
        counts[voxel] += 1
        x, y, z = np.float64(inside[i, 0]), np.float64(inside[i, 1]), np.float64(inside[i, 2])
        sums[voxel, 0] += x
        sums[voxel, 1] += y
        sums[voxel, 2] += z
        outers[voxel, 0] += x * x
        outers[voxel, 1] += x * y
        outers[voxel, 2] += x * z
        outers[voxel, 3] += y * y
        outers[voxel, 4] += y * z
        outers[voxel, 5] += z * z
        for axis in range(3):
            side_sums[voxel, axis] += sides[i, axis]
    return voxel + 1


@njit(nogil=True, cache=True)
def _add_shifted(weight, count, sums, outers, dx, dy, dz, total_sums, total_outers):
    """Add a voxel's moments, times a weight, moved by (dx, dy, dz)."""
    n = weight * count
    sx, sy, sz = weight * sums[0], weight * sums[1], weight * sums[2]
    total_sums[0] += sx + n * dx
    total_sums[1] += sy + n * dy
    total_sums[2] += sz + n * dz
    total_outers[0] += weight * outers[0] + 2.0 * sx * dx + n * dx * dx
    total_outers[1] += weight * outers[1] + sx * dy + sy * dx + n * dx * dy
    total_outers[2] += weight * outers[2] + sx * dz + sz * dx + n * dx * dz
    total_outers[3] += weight * outers[3] + 2.0 * sy * dy + n * dy * dy
    total_outers[4] += weight * outers[4] + sy * dz + sz * dy + n * dy * dz
    total_outers[5] += weight * outers[5] + 2.0 * sz * dz + n * dz * dz
    return n


@njit(nogil=True, cache=True)
def merge_voxels(order, parents, shifts, in_counts, in_sums, in_outers, counts, sums, outers):
    """Sum the moments of voxels that share a parent.

    order : voxels by ascending parent; parents : (n,) int64; shifts : (n, 3) float64, m, from the
    parent's corner to the voxel's. counts, sums, outers : out, zeroed. Returns the number of parents.
    """
    voxel = -1
    previous = np.int64(0)
    for i in order:
        if voxel < 0 or parents[i] != previous:
            voxel += 1
            previous = parents[i]
        counts[voxel] += _add_shifted(
            1.0, in_counts[i], in_sums[i], in_outers[i], shifts[i, 0], shifts[i, 1], shifts[i, 2],
            sums[voxel], outers[voxel],
        )  # fmt: skip
    return voxel + 1


@njit(nogil=True, cache=True)
def _reach_line(line, key, keys, row, layer, reach, first):
    """Find one of the (2 reach + 1)^2 lines of voxels around a voxel: its steps (z, y), middle key and first voxel.

    key : of the voxel; they ascend from call to call. first : ((2 reach + 1)^2,) int64, where each line was reached
    last, zeroed before the first call; in and out.
    """
    width = 2 * reach + 1
    dz, dy = line // width - reach, line % width - reach
    middle = key + dz * layer + dy * row
    k = first[line]
    while k < keys.shape[0] and keys[k] < middle - reach:
        k += 1
    first[line] = k
    return dz, dy, middle, k


@njit(nogil=True, cache=True)
def _sum_neighbourhood(
    i, keys, counts, sums, outers, edge, row, layer, reach, count_cap, first, total_sums, total_outers
):
    """Sum the moments of the (2 reach + 1)^3 voxels around voxel `i`, from its own corner; call with `i` ascending.

    Parameters as of `neighbourhood_normals`. first : as of `_reach_line`. total_sums, total_outers : out. Returns the
    sum of weights and of occupied voxels.
    """
    total_sums[:] = 0.0
    total_outers[:] = 0.0
    weight_sum = 0.0
    n_voxels = 0
    n, width = keys.shape[0], 2 * reach + 1
    for line in range(width * width):
        dz, dy, middle, k = _reach_line(line, keys[i], keys, row, layer, reach, first)
        while k < n and keys[k] <= middle + reach:
            dx = keys[k] - middle
            weight = min(1.0, count_cap / counts[k])
            weight_sum += _add_shifted(
                weight, counts[k], sums[k], outers[k], dx * edge, dy * edge, dz * edge, total_sums, total_outers
            )
            n_voxels += 1
            k += 1
    return weight_sum, n_voxels


@njit(nogil=True, cache=True)
def neighbourhood_normals(
    keys, counts, sums, outers, wanted, edge, row, layer, reach, count_cap, least_voxels, flatness, normals
):
    """Fit a plane to the points of the (2 reach + 1)^3 voxels around each voxel.

    keys : (n,) int64, ascending, (z layer + y row + x) of each voxel, rows padded by at least `reach`;
    wanted : (n,) bool, whether the normal is asked for; edge : voxel edge, m; count_cap : a voxel weighs at
    most as many points; least_voxels : fewer occupied voxels leave the normal open; flatness : so does a
    smallest eigenvalue above this share of the middle one, or a middle one below (edge / 2)^2.
    normals : (n, 3) float64, out, zeros where open.
    """
    first = np.zeros((2 * reach + 1) ** 2, np.int64)
    total_sums, total_outers = np.zeros(3), np.zeros(6)
    matrix, normal = np.zeros((3, 3)), np.zeros(3)
    for i in range(keys.shape[0]):
        if not wanted[i]:
            continue
        weight_sum, n_voxels = _sum_neighbourhood(
            i, keys, counts, sums, outers, edge, row, layer, reach, count_cap, first, total_sums, total_outers
        )
        if n_voxels < least_voxels:
            continue
        covariance(weight_sum, total_sums, total_outers, matrix)
        smallest, middle_value, _ = plane_normal(matrix, normal)
        if middle_value >= 0.25 * edge * edge and smallest <= flatness * middle_value:
            normals[i] = normal


@njit(nogil=True, cache=True)
def scatters(keys, counts, sums, outers, edge, row, layer, reach, count_cap, least_voxels, scatter):
    """Smallest by largest eigenvalue of the points in the (2 reach + 1)^3 voxels around each voxel.

    Parameters as of `neighbourhood_normals`. scatter : (n,) float64, out, from 0 for a plane to 1 for a ball; NaN where
    fewer than `least_voxels` are occupied.
    """
    first = np.zeros((2 * reach + 1) ** 2, np.int64)
    total_sums, total_outers = np.zeros(3), np.zeros(6)
    matrix, normal = np.zeros((3, 3)), np.zeros(3)
    for i in range(keys.shape[0]):
        weight_sum, n_voxels = _sum_neighbourhood(
            i, keys, counts, sums, outers, edge, row, layer, reach, count_cap, first, total_sums, total_outers
        )
        scatter[i] = np.nan
        if n_voxels >= least_voxels:
            covariance(weight_sum, total_sums, total_outers, matrix)
            smallest, _, largest = plane_normal(matrix, normal)
            if largest > 0.0:
                scatter[i] = max(0.0, smallest / largest)


@njit(nogil=True, cache=True)
def sums_near(keys, values, row, layer, reach, totals):
    """Sum values over the (2 reach + 1)^3 voxels around each voxel.

    keys : (n,) int64, ascending, rows padded by at least `reach`; values : (n, m) float64. totals : (n, m), out,
    zeroed.
    """
    width = 2 * reach + 1
    first = np.zeros(width * width, np.int64)
    n = keys.shape[0]
    for i in range(n):
        for line in range(width * width):
            _, _, middle, k = _reach_line(line, keys[i], keys, row, layer, reach, first)
            while k < n and keys[k] <= middle + reach:
                for j in range(values.shape[1]):
                    totals[i, j] += values[k, j]
                k += 1


@njit(nogil=True, cache=True)
def place_keys(points, edge, keys):
    """Number the cube that each point is in, as if by chance: numbers that end in so many zeros are an even sample.

    points : (n, 3) float64, m; edge : of the cubes, m. keys : (n,) uint64, out. Cubes 2^21 edges apart along an axis
    share their number.
    """
    mask = np.int64((1 << INDEX_BITS) - 1)
    for n in range(points.shape[0]):
        packed = np.int64(0)
        for axis in range(3):
            packed = (packed << INDEX_BITS) | (np.int64(np.floor(points[n, axis] / edge)) & mask)
        key = np.uint64(packed)
        key = (key ^ (key >> np.uint64(30))) * FIRST_FACTOR
        key = (key ^ (key >> np.uint64(27))) * SECOND_FACTOR
        keys[n] = key ^ (key >> np.uint64(31))
