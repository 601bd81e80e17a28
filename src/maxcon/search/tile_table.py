# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""TileTable: the tiles around a scan for look-ups of single points; it holds addresses, see `map.tile.Addresses`."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.map import PATCH_VOXELS, VoxelTile
from maxcon.map.tile import Addresses

__all__ = ["TileTable"]


@dataclass(frozen=True, slots=True)
class TileTable:
    """The tiles around a scan in one array, so that one call of the kernel looks up points in all of them.

    Parameters
    ----------
    rows : array, shape (n_tiles + 1, 8), uint64
        Addresses of the arrays of each tile, as `cell_kernels.moments_of_cells` reads them. The first row is for
        where there is no tile.
    grid : array, shape (ny, nx), int32
        Rows of the tiles, by their keys.
    kept : tuple
        The arrays at the addresses: they live as long as the table.
    """

    rows: NDArray[np.uint64]
    grid: NDArray[np.int32]
    kept: tuple[NDArray[Any] | Addresses, ...]

    @classmethod
    def of(
        cls, tiles: dict[int, tuple[VoxelTile, NDArray[np.int64]]], shape: tuple[int, int], edge: int, n_layers: int
    ) -> "TileTable":
        """Table of the tiles of a `PreparedScan`, from its fields; its points lie in `n_layers` height layers."""
        layers = np.zeros((len(tiles) + 1, n_layers), np.int32)
        nothing, kept = np.zeros((edge // PATCH_VOXELS) ** 2, np.uint64), []
        rows, grid = np.empty((len(layers), 8), np.uint64), np.zeros(shape, np.int32)
        rows[:, 0] = layers.ctypes.data + layers.strides[0] * np.arange(len(layers))
        rows[0, 1:] = [1, *[nothing.ctypes.data] * 6]
        for row, (slot, (tile, tile_layers)) in enumerate(tiles.items(), 1):
            grid.flat[slot] = row
            layers[row] = np.where(tile_layers < 0, len(tile.index.layers), tile_layers)[:n_layers]
            addresses = tile.addresses  # once: the table must keep the very ones whose values it has
            rows[row, 1], rows[row, 2:] = tile.occupancy.held.shape[2], addresses.values[:6]
            kept.append(addresses)
        return cls(rows, grid, (layers, nothing, *kept))
