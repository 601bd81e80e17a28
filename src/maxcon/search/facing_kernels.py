# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which voxels of a tile face along an axis, compiled. Arrays in, arrays out."""

import numpy as np
from numba import njit

__all__ = ["NORMAL_STEP", "facing_voxels"]

# Normals are kept as whole multiples of this, in half of the memory.
NORMAL_STEP = 1.0 / 32767.0


@njit(nogil=True, cache=True)
def facing_voxels(patch_starts, columns, normals, counts, axis, least, starts, facing_columns, steps, values):
    """Copy those voxels that add more than `least` along an axis, in their order.

    patch_starts : (p + 1,) int64; columns : (k, 2) int16; normals : (k, 3) float32; counts : (k,) int32, or empty
    where a voxel counts once; axis : (x, y) float32, unit, or zeros to count.
    starts : (p + 1,) int32, facing_columns : (k, 2) int16, steps : (k, 3) int16, normals in NORMAL_STEP, values : (k,)
    float32, what a match of weight one adds; all out. Returns how many voxels there are.
    """
    has_counts, is_count = counts.shape[0] > 0, axis[0] == 0.0 and axis[1] == 0.0
    n = np.uint64(0)
    for patch in range(patch_starts.shape[0] - 1):
        starts[patch] = n
        for k in range(np.uint64(patch_starts[patch]), np.uint64(patch_starts[patch + 1])):
            along = normals[k, 0] * axis[0] + normals[k, 1] * axis[1]
            value = np.float32(1.0) if is_count else along * along
            if has_counts:
                value *= np.float32(counts[k])
            facing_columns[n, 0], facing_columns[n, 1] = columns[k, 0], columns[k, 1]
            for i in range(3):
                steps[n, i] = np.int16(np.rint(normals[k, i] * np.float32(1.0 / NORMAL_STEP)))
            values[n] = value
            n += np.uint64(value > least)
    starts[-1] = n
    return n
