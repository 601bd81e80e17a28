# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which blocks of space were seen when: on disk while clouds are read, to tell passes apart (decision 23)."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.mapping.build.spill import TileFiles
from maxcon.map import TILE_VOXELS, TileKey

__all__ = ["SIGHTING", "SightingSpill", "block_voxels"]

BLOCK_EDGE = 0.25
"""The edge of a block is a power of two of voxels, the nearest to this, m."""
STRETCH = 5.0
"""s; within it a block is noted once. A fraction of the pause between two passes."""

SIGHTING = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("time", "<f8")])
"""One stretch in which a block was seen: its column in the tile and its layer, and the stretch's beginning (s)."""


def block_voxels(cell: float) -> int:
    """How many voxels of edge `cell` (m) make the edge of a block; 4 at 6 cm."""
    power = round(math.log2(BLOCK_EDGE / cell))
    return int(2 ** min(max(power, 0), TILE_VOXELS.bit_length() - 1))


class SightingSpill(TileFiles):
    """Sorts what was seen when into tiles, and keeps it on disk until each tile is made.

    Parameters
    ----------
    folder : Path
        A folder for the files; the caller removes it.
    cell : float
        Voxel edge, m.
    """

    def __init__(self, folder: Path, cell: float) -> None:
        super().__init__(folder, SIGHTING, "seen")
        self._cell = cell
        self._edge = block_voxels(cell)

    def add(self, points: NDArray[np.float64], times: NDArray[np.float64] | None) -> None:
        """Take points, shape (n, 3), local frame, m, with times, shape (n,), s; those without one are left out."""
        if times is None:
            return
        is_timed = np.isfinite(times)
        if not is_timed.any():
            return
        blocks = voxel_indices(points[is_timed], self._cell).astype(np.int64) // self._edge
        stretches = np.floor(times[is_timed] / STRETCH)
        first = _first_of_each(np.column_stack([blocks, _ranks(stretches)]))
        blocks, stretches = blocks[first], stretches[first]
        n = TILE_VOXELS // self._edge
        keys = (blocks[:, :2] // n).astype(np.int32)
        records = np.empty(len(blocks), SIGHTING)
        records["column"] = blocks[:, :2] - keys * n
        records["layer"] = blocks[:, 2]
        records["time"] = stretches * STRETCH
        self._put(keys, records)

    def gather(self, key: TileKey) -> None:
        """Keep each sighting of a tile once."""
        if self.has(key):
            records = self.load(key)
            columns = (records["column"][:, 0], records["column"][:, 1], records["layer"], records["time"])
            order = np.lexsort(columns)
            is_new = np.ones(len(order), bool)
            is_new[1:] = np.logical_or.reduce([np.diff(values[order]) != 0 for values in columns])
            self.replace(key, records[order[is_new]])

    def load(self, key: TileKey) -> NDArray[np.void]:
        """Return all sightings of a tile (`SIGHTING`)."""
        if not self.has(key):
            return np.empty(0, SIGHTING)
        return np.concatenate([np.empty(0, SIGHTING), *self.records(key)])


def _ranks(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of each value among the different ones."""
    return np.unique(values, return_inverse=True)[1].astype(np.int64)


def _first_of_each(rows: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the number of the first of each kind of row, shape (n, m); of all rows where their ranges are too wide."""
    lowest = rows.min(axis=0)
    ranges = [int(number) for number in rows.max(axis=0) - lowest + 1]
    if math.prod(ranges) >= 2**62:
        return np.arange(len(rows))
    return np.unique(np.ravel_multi_index(tuple((rows - lowest).T), tuple(ranges)), return_index=True)[1]
