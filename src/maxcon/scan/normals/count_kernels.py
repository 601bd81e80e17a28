# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: what is counted of a scan to doubt it. Arrays in, numbers out."""

from numba import njit

__all__ = ["count_normals"]


@njit(nogil=True, cache=True)
def count_normals(normals, up, horizontal):
    """How many normals there are, and how many of them are horizontal.

    normals : (n, 3) float64, zeros for none; up : (3,), unit vector in the same axes; horizontal : the product of a
    horizontal normal with it is smaller.
    """
    n_normals, n_horizontal = 0, 0
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        has_normal = (x != 0.0) | (y != 0.0) | (z != 0.0)
        n_normals += has_normal
        n_horizontal += has_normal & (abs(up[0] * x + up[1] * y + up[2] * z) < horizontal)
    return n_normals, n_horizontal
