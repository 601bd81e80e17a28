# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: the plane through points, from their second moments."""

import numpy as np
from numba import njit

__all__ = ["covariance", "plane_normal"]


@njit(nogil=True, cache=True)
def covariance(count, sums, outers, matrix):
    """Covariance matrix (3, 3), out, of `count` points from their sums (3,) and sums of products (6,).

    Products in the order xx, xy, xz, yy, yz, zz.
    """
    mean_x, mean_y, mean_z = sums[0] / count, sums[1] / count, sums[2] / count
    matrix[0, 0] = outers[0] / count - mean_x * mean_x
    matrix[0, 1] = matrix[1, 0] = outers[1] / count - mean_x * mean_y
    matrix[0, 2] = matrix[2, 0] = outers[2] / count - mean_x * mean_z
    matrix[1, 1] = outers[3] / count - mean_y * mean_y
    matrix[1, 2] = matrix[2, 1] = outers[4] / count - mean_y * mean_z
    matrix[2, 2] = outers[5] / count - mean_z * mean_z


@njit(nogil=True, cache=True)
def plane_normal(matrix, normal):
    """Write the eigenvector of the smallest eigenvalue of a covariance matrix; return all three eigenvalues.

    The eigenvalues (ascending) by the trigonometric solution of the characteristic cubic; the vector as
    the largest cross product of two rows of (matrix - eigenvalue I). matrix : (3, 3) float64 symmetric;
    normal : (3,) float64, out, zeros where every direction is the same.
    """
    normal[:] = 0.0
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
    a, b, c = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    spread = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if spread <= 1e-12 * abs(mean) or spread == 0.0:
        return mean, mean, mean
    d, e, f = matrix[0, 1], matrix[0, 2], matrix[1, 2]
    determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    angle = np.arccos(min(1.0, max(-1.0, determinant / (2.0 * spread**3)))) / 3.0
    largest = mean + 2.0 * spread * np.cos(angle)
    smallest = mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
    middle = 3.0 * mean - largest - smallest
    _null_vector(matrix, smallest, normal)
    return smallest, middle, largest


@njit(nogil=True, cache=True)
def _null_vector(matrix, eigenvalue, vector):
    """Unit vector at right angles to all rows of (matrix - eigenvalue I)."""
    best = 0.0
    for i in range(3):
        j = (i + 1) % 3
        ax, ay, az = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        bx, by, bz = matrix[j, 0], matrix[j, 1], matrix[j, 2]
        if i == 0:
            ax -= eigenvalue
            by -= eigenvalue
        elif i == 1:
            ay -= eigenvalue
            bz -= eigenvalue
        else:
            az -= eigenvalue
            bx -= eigenvalue
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        squared = x * x + y * y + z * z
        if squared > best:
            best = squared
            length = np.sqrt(squared)
            vector[0], vector[1], vector[2] = x / length, y / length, z / length
