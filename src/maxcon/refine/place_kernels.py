# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: the moments of a scan at one pose. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.lookup_kernels import find_in_patch, find_patch, plane_of_voxel
from maxcon.refine.kernels import rotation_and_axes, turned


@njit(nogil=True, cache=True)
def add_moments(points, normals, unknowns, cell, weights, is_signed, by_points, table, moments):
    """Add count, Nxx, Nxy and Nyy (equation (4)) of the matches of a scan at a pose, whatever its cell, to moments.

    points, normals : (n, 3) float64, sensor frame, m; a normal of zeros where there is none; unknowns : (6,), x, y, z,
    roll, pitch, heading, m and rad; cell : edge of a voxel, m; weights : of a match by the cosine of its normals (1) or
    whatever that is (0), and of one whose scan point has no normal; is_signed : whether the map's normals have a side;
    by_points : whether a match counts as often as the voxel has map points; table : of the map's tiles, see
    `VoxelTable`; moments : (4,).
    """
    R, _ = rotation_and_axes(unknowns[3:])
    _add_all(points, normals, R, unknowns, cell, weights, is_signed, by_points, table, moments)


@njit(nogil=True, cache=True, counts_references=False)
def _add_all(points, normals, R, unknowns, cell, weights, is_signed, by_points, table, moments):
    """Add the moments, given the rotation (3, 3) of the pose."""
    by_cosine, without_normal = weights
    counts = table[9]
    for i in range(points.shape[0]):
        dx, dy, dz = turned(R, (points[i, 0], points[i, 1], points[i, 2]))
        x, y = np.int64(np.floor((dx + unknowns[0]) / cell)), np.int64(np.floor((dy + unknowns[1]) / cell))
        z = np.int64(np.floor((dz + unknowns[2]) / cell))
        patch = find_patch(x, y, z, table)
        if patch < 0:
            continue
        number = find_in_patch(x, y, patch, table)
        if number < 0:
            continue
        mx, my, mz, _, _, _ = plane_of_voxel(number, x, y, z, cell, table)
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        weight = 1.0
        if a == 0.0 and b == 0.0 and c == 0.0:
            weight = without_normal
        elif by_cosine != 0.0:
            nx, ny, nz = turned(R, (a, b, c))
            cosine = nx * mx + ny * my + nz * mz
            weight = max(0.0, cosine) if is_signed else abs(cosine)
        times = np.float64(counts[number]) if by_points else 1.0
        weight *= times
        moments[0] += times
        moments[1] += weight * mx * mx
        moments[2] += weight * mx * my
        moments[3] += weight * my * my
