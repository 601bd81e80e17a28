# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""VoxelLookup: the voxels of several tiles, found one by one from compiled code."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.map.addresses import Addresses
from maxcon.map.tile import VoxelTile

__all__ = ["VoxelLookup"]


@dataclass(frozen=True, slots=True)
class VoxelLookup:
    """Tiles in one table, so that one call of a kernel looks up points in all of them.

    Parameters
    ----------
    rows : array, shape (n_tiles + 1, 11), uint64
        For each tile: z index of its lowest height layer, as the bits of an int64; how many layers there are from
        there to the highest; the address of their numbers, -1 for none (int32); how many words each column of patches
        has; the tile's `Addresses`: occupancy, normals, counts, means. The first row is for where there is no tile.
    grid : array, shape (ny, nx), int32
        Rows of the tiles, by their keys.
    corner : tuple of 2 int
        Key (x, y) of the grid's first tile.
    kept : tuple
        The arrays at the addresses: they live as long as the lookup.
    """

    rows: NDArray[np.uint64]
    grid: NDArray[np.int32]
    corner: tuple[int, int]
    kept: tuple[NDArray[np.int32] | Addresses, ...]

    @classmethod
    def of(cls, tiles: Sequence[VoxelTile]) -> "VoxelLookup":
        """Lookup in some tiles."""
        keys = np.array([tile.key for tile in tiles], np.int64).reshape(-1, 2)
        low = keys.min(axis=0) if tiles else np.zeros(2, np.int64)
        nx, ny = keys.max(axis=0) - low + 1 if tiles else (0, 0)
        grid = np.zeros((int(ny), int(nx)), np.int32)
        rows = np.zeros((len(tiles) + 1, 11), np.uint64)
        signed, kept = rows.view(np.int64), list[NDArray[np.int32] | Addresses]()
        for row, tile in enumerate(tiles, 1):
            grid[tile.key[1] - low[1], tile.key[0] - low[0]] = row
            numbers, addresses = tile.layer_numbers, tile.addresses
            if not len(numbers):
                continue
            signed[row, 0] = tile.index.layers[0]
            rows[row, 1:4] = len(numbers), numbers.ctypes.data, tile.occupancy.held.shape[2]
            rows[row, 4:] = addresses.values
            kept += [numbers, addresses]
        return cls(rows, grid, (int(low[0]), int(low[1])), tuple(kept))
