# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled code reads what a table of tiles points at, and asks no more: where there is no tile, zeros must lie."""

import numpy as np

from maxcon.map import PATCH_VOXELS, TILE_VOXELS
from maxcon.search.tile_table import TileTable


def test_where_there_is_no_tile_no_patch_of_it_holds_anything():
    table = TileTable.of({}, (2, 3), TILE_VOXELS, 5)
    assert (table.grid.tolist(), table.rows.shape) == ([[0, 0, 0], [0, 0, 0]], (1, 8))
    layers, nothing = table.kept
    (at, n_held, *arrays) = table.rows[0].tolist()
    assert (layers.shape, layers.dtype, layers.any()) == ((1, 5), np.int32, False)
    assert at == layers.ctypes.data
    assert nothing.size == n_held * (TILE_VOXELS // PATCH_VOXELS) ** 2  # a word of 64 layers for each patch
    assert (nothing.dtype, nothing.any()) == (np.uint64, False)
    assert arrays == [nothing.ctypes.data] * 6
