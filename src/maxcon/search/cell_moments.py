# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""CellMoments: the moments of single cells, without those of the cells around."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import Moments
from maxcon.point_map.addresses import Addresses
from maxcon.point_map.layout import PATCH_VOXELS
from maxcon.search.prepared_scan import PreparedScan

__all__ = ["CellMoments"]

# Headings at which the turned scan is kept for later cells; the oldest is dropped first (FIFO).
MOST_HEADINGS_KEPT = 32


@dataclass(frozen=True, slots=True)
class TileTable:
    """The tiles around a scan in one array, so that one call of the kernel looks up points in all of them.

    Parameters
    ----------
    rows : array, shape (n_tiles + 1, 8), uint64
        Addresses of the arrays of each tile, as `exact_kernels.moments_of_cells` reads them. The first row is for
        where there is no tile.
    grid : array, shape (ny, nx), int32
        Rows of the tiles, by their keys.
    kept : tuple
        What lies at the addresses: it lives as long as the table.
    """

    rows: NDArray[np.uint64]
    grid: NDArray[np.int32]
    kept: tuple[NDArray[Any] | Addresses, ...]

    @classmethod
    def of(cls, prepared: PreparedScan) -> "TileTable":
        """Table of the tiles of a prepared scan."""
        n_ranks = int(prepared.ranks.max(initial=0)) + 1
        layers = np.zeros((len(prepared.tiles) + 1, n_ranks), np.int32)
        nothing, kept = np.zeros((prepared.edge // PATCH_VOXELS) ** 2, np.uint64), []
        rows, grid = np.empty((len(layers), 8), np.uint64), np.zeros(prepared.shape, np.int32)
        rows[:, 0] = layers.ctypes.data + layers.strides[0] * np.arange(len(layers))
        rows[0, 1:] = [1, *[nothing.ctypes.data] * 6]
        for row, (slot, (tile, tile_layers)) in enumerate(prepared.tiles.items(), 1):
            grid.flat[slot] = row
            layers[row] = tile_layers
            layers[row, tile_layers < 0] = len(tile.index.layers)  # none
            rows[row, 1], rows[row, 2:] = tile.occupancy.held.shape[2], tile.addresses.values[:6]
            kept.append(tile.addresses)
        return cls(rows, grid, (layers, nothing, *kept))


@dataclass(frozen=True)
class CellMoments:
    """Moments of single cells, equal to those of the exhaustive search to the last bit.

    What all cells share, and what those of one heading share, is made when it is first needed and kept.

    Parameters
    ----------
    prepared : PreparedScan
        The scan and the tiles around.
    """

    prepared: PreparedScan
    _turned: dict[int, tuple[NDArray[np.uint64], NDArray[np.float32]]] = field(default_factory=dict)

    def of(self, heading: int, cells: NDArray[np.int64]) -> Moments:
        """Moments of some cells (n, 3) of one heading, shape (n, 4)."""
        from maxcon.search import exact_kernels

        prepared = self.prepared
        _, ny, nx = prepared.space.shape
        offsets = cells[:, :0:-1] - np.array([nx // 2, ny // 2])
        voxels, normals = self._turned_to(heading)
        _, ranks = self._points
        moments = np.zeros((len(cells), 4))
        exact_kernels.moments_of_cells(
            offsets, voxels, normals, ranks, self._table.rows, prepared.edge.bit_length() - 1,
            self._table.grid, prepared.corner, prepared.is_once, prepared.is_signed, moments,
        )  # fmt: skip
        return moments

    @cached_property
    def _table(self) -> TileTable:
        return TileTable.of(self.prepared)

    @cached_property
    def _points(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Numbers of the points in the order of the look-ups, and the ranks of their layers."""
        from maxcon.search import group_kernels

        prepared = self.prepared
        numbers, ranks = group_kernels.points_of_groups(prepared.starts, prepared.starts[1:], prepared.ranks)
        return numbers, ranks

    def _turned_to(self, heading: int) -> tuple[NDArray[np.uint64], NDArray[np.float32]]:
        """Voxels and normals of all points at a heading, as the kernel takes them."""
        from maxcon.search import exact_kernels

        if heading not in self._turned:
            numbers, _ = self._points
            (columns,), (normals,) = self.prepared.turned(np.array([heading]))
            self._turned[heading] = exact_kernels.points_at_heading(
                columns, normals, numbers, self.prepared.without_normal
            )
            if len(self._turned) > MOST_HEADINGS_KEPT:
                del self._turned[next(iter(self._turned))]
        return self._turned[heading]
