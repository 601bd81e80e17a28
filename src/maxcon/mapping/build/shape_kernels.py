# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled loops over the neighbourhoods of voxels: how scattered their points are, and sums of a few numbers."""

import numpy as np
from maxcon._system.kernel_cache import njit

from maxcon.mapping.build.kernels import reach_line, sum_neighbourhood
from maxcon.scan.plane_kernels import covariance, plane_normal

__all__ = ["scatters", "sums_near"]


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
        weight_sum, n_voxels = sum_neighbourhood(
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
            _, _, middle, k = reach_line(line, keys[i], keys, row, layer, reach, first)
            while k < n and keys[k] <= middle + reach:
                for j in range(values.shape[1]):
                    totals[i, j] += values[k, j]
                k += 1
