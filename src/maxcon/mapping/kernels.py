"""Compiled loops of map building: moments of voxels, planes of neighbourhoods."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.scan.plane_kernels import covariance, plane_normal


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
def merge_voxels(parent, shifts, in_counts, in_sums, in_outers, counts, sums, outers):
    """Sum moments, out, zeroed, of voxels that share a parent; `shifts` (n, 3), m, from its corner to theirs."""
    for i in range(parent.shape[0]):
        k = parent[i]
        counts[k] += _add_shifted(
            1.0, in_counts[i], in_sums[i], in_outers[i], shifts[i, 0], shifts[i, 1], shifts[i, 2], sums[k], outers[k]
        )


@njit(nogil=True, cache=True)
def _reach_line(line, key, keys, row, layer, reach, first):
    """Find a line of voxels around that of a key: its steps (z, y), middle key and first voxel."""
    # Keys ascend from call to call; `first`: where each line was reached last, in and out.
    width = 2 * reach + 1
    dz, dy = line // width - reach, line % width - reach
    middle = key + dz * layer + dy * row
    k = first[line]
    while k < keys.shape[0] and keys[k] < middle - reach:
        k += 1
    first[line] = k
    return dz, dy, middle, k


@njit(nogil=True, cache=True)
def neighbourhood_planes(
    keys, counts, sums, outers, wanted, edge, row, layer, reach, count_cap, least_voxels, values, normals
):
    """Fit a plane to the points of the (2 reach + 1)^3 voxels around each wanted voxel.

    keys : (n,) int64, ascending, (z layer + y row + x), rows padded by at least `reach`; count_cap : a voxel weighs at
    most as many points; least_voxels : fewer occupied ones leave the plane open. values, normals : (n, 3), out:
    eigenvalues, ascending, m^2, and unit normals; where the plane is open they stay as they are.
    """
    width = 2 * reach + 1
    n, first = keys.shape[0], np.zeros(width * width, np.int64)
    total_sums, total_outers = np.zeros(3), np.zeros(6)
    matrix, normal = np.zeros((3, 3)), np.zeros(3)
    for i in range(n):
        if not wanted[i]:
            continue
        total_sums[:] = 0.0
        total_outers[:] = 0.0
        weight_sum = 0.0
        n_voxels = 0
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
        if n_voxels >= least_voxels:
            covariance(weight_sum, total_sums, total_outers, matrix)
            values[i, 0], values[i, 1], values[i, 2] = plane_normal(matrix, normal)
            normals[i] = normal


@njit(nogil=True, cache=True)
def sums_near(keys, values, row, layer, reach, totals):
    """Sum values (n, m) over the (2 reach + 1)^3 voxels around each voxel, into zeroed totals; keys as above."""
    width = 2 * reach + 1
    first = np.zeros(width * width, np.int64)
    for i in range(keys.shape[0]):
        for line in range(width * width):
            _, _, middle, k = _reach_line(line, keys[i], keys, row, layer, reach, first)
            while k < keys.shape[0] and keys[k] <= middle + reach:
                for j in range(values.shape[1]):
                    totals[i, j] += values[k, j]
                k += 1
