# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled loop of the comparison of passes: which place each point is at."""

import numpy as np
from maxcon._system.kernel_cache import njit

__all__ = ["place_keys"]

# Two rounds of multiplying and folding (the finalizer of splitmix64): one-to-one, and spread evenly.
FIRST_FACTOR = np.uint64(0xBF58476D1CE4E5B9)
SECOND_FACTOR = np.uint64(0x94D049BB133111EB)
INDEX_BITS = 21


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
