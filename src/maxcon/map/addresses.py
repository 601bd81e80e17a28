# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Addresses: where the arrays of a tile lie in memory.

A scan meets tens of tiles: to hand over their arrays to a kernel one by one took longer than to look up all points in
them. So look-ups of single voxels get one table of addresses (`VoxelLookup`, `search.tile_table.TileTable`), and
`lookup_kernels` reads what lies there.

**An address is valid only as long as the `Addresses` object that gave it**, which keeps the arrays alive: a table must
keep the `Addresses` of all its tiles as long as it lives. A copy, also one in another process, has its own addresses.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Addresses"]


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where the arrays of a tile lie in memory: occupancy (held, numbers, words, firsts), normals, counts and means.

    Parameters
    ----------
    values : array, shape (7,), uint64
        Addresses of their first items.
    kept : tuple of arrays
        The arrays, in one piece each: they live as long as their addresses.
    """

    values: NDArray[np.uint64]
    kept: tuple[NDArray[Any], ...]

    @classmethod
    def of(cls, *arrays: NDArray[Any]) -> "Addresses":
        """Addresses of arrays, or of copies in one piece."""
        kept = tuple(np.ascontiguousarray(array) for array in arrays)
        return cls(np.array([array.ctypes.data for array in kept], np.uint64), kept)

    def __reduce__(self) -> tuple[Any, ...]:
        return Addresses.of, self.kept  # a copy lies elsewhere
