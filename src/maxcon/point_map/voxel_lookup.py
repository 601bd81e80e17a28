# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""VoxelLookup: the voxels of several tiles, found one by one from compiled code."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.point_map.tile import Addresses, VoxelTile

__all__ = ["VoxelLookup"]


@dataclass(frozen=True, slots=True)
class VoxelLookup:
    """Tiles in one table, so that one call of a kernel looks up points in all of them.

    Parameters
    ----------
    rows : array, shape (n_tiles + 1, 9), uint64
        For each tile addresses of: the number that each height layer has in it, -1 for none (int32); how many words
        each column of patches has (a number, not an address); the tile's `Addresses`: occupancy, normals, counts,
        means. The first row is for where there is no tile.
    grid : array, shape (ny, nx), int32
        Rows of the tiles, by their keys.
    corner : tuple of 4 int
        Key (x, y) of the grid's first tile; z index of the first height layer, and how many there are.
    kept : tuple
        What lies at the addresses: it lives as long as the lookup.
    """

    rows: NDArray[np.uint64]
    grid: NDArray[np.int32]
    corner: tuple[int, int, int, int]
    kept: tuple[NDArray[np.int32] | Addresses, ...]

    @classmethod
    def of(cls, tiles: Sequence[VoxelTile], z_first: int, z_last: int) -> "VoxelLookup":
        """Lookup in some tiles, for voxels of z index `z_first` to `z_last`."""
        keys = np.array([tile.key for tile in tiles], np.int64).reshape(-1, 2)
        low = keys.min(axis=0) if tiles else np.zeros(2, np.int64)
        nx, ny = keys.max(axis=0) - low + 1 if tiles else (0, 0)
        grid = np.zeros((int(ny), int(nx)), np.int32)
        layers = np.full((len(tiles) + 1, z_last - z_first + 1), -1, np.int32)
        rows = np.zeros((len(tiles) + 1, 9), np.uint64)
        rows[:, 0] = layers.ctypes.data + layers.strides[0] * np.arange(len(layers))
        for row, tile in enumerate(tiles, 1):
            grid[tile.key[1] - low[1], tile.key[0] - low[0]] = row
            in_tile = tile.index.layers
            first, end = np.searchsorted(in_tile, [z_first, z_last + 1])
            layers[row, in_tile[first:end] - z_first] = np.arange(first, end)
            rows[row, 1], rows[row, 2:] = tile.occupancy.held.shape[2], tile.addresses.values
        corner = (int(low[0]), int(low[1]), z_first, z_last - z_first + 1)
        return cls(rows, grid, corner, (layers, *(tile.addresses for tile in tiles)))
