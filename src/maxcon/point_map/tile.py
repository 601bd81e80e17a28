# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""VoxelTile: the voxels of one square of the map, in the order the search reads them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["PATCH_VOXELS", "TILE_PATCHES", "TILE_VOXELS", "TileIndex", "TileKey", "VoxelTile", "search_order"]

TileKey = tuple[int, int]
"""(x, y) index of a tile: floor(voxel index / TILE_VOXELS)."""

TILE_VOXELS = 512
PATCH_VOXELS = 16
TILE_PATCHES = TILE_VOXELS // PATCH_VOXELS


@dataclass(frozen=True, slots=True)
class TileIndex:
    """Where each patch of 16 x 16 voxels of one height layer begins in its tile.

    Parameters
    ----------
    layers : array, shape (n_layers,), int32
        The z indices that occur, ascending.
    patch_starts : array, shape (n_layers * TILE_PATCHES**2 + 1,), int64
        The voxels of patch (py, px) of layer k are those from number (k * TILE_PATCHES + py) * TILE_PATCHES
        + px to the next. Patches that follow each other along x are one run of voxels.
    """

    layers: NDArray[np.int32]
    patch_starts: NDArray[np.int64]


@dataclass(frozen=True)
class VoxelTile:
    """The voxels of one tile of the map: 512 x 512 columns, 30.72 m at 6 cm.

    Sorted by (z, patch y, patch x, y, x), see `search_order`. The arrays may be read-only views of a
    mapped file.

    Parameters
    ----------
    key : tuple of 2 int
        The tile's (x, y) index.
    columns : array, shape (n, 2), int16
        (x, y) voxel index less the tile's first, 0 to 511.
    layers : array, shape (n,), int32
        z voxel index.
    counts : array, shape (n,), int32
        How many map points the voxel holds.
    normals : array, shape (n, 3), float32
        Their mean unit normal; zeros where there is none.
    """

    key: TileKey
    columns: NDArray[np.int16]
    layers: NDArray[np.int32]
    counts: NDArray[np.int32]
    normals: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.layers)

    @cached_property
    def index(self) -> TileIndex:
        """Where each patch begins; made when first asked for."""
        layers, patch = self._patches()
        sizes = np.bincount(patch, minlength=len(layers) * TILE_PATCHES**2)
        return TileIndex(layers, np.concatenate([[0], np.cumsum(sizes)]))

    def _patches(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Return the z indices that occur, and the number of each voxel's patch."""
        layers, layer_of_voxel = np.unique(self.layers, return_inverse=True)
        patches = self.columns.astype(np.int64) // PATCH_VOXELS
        return layers, (layer_of_voxel * TILE_PATCHES + patches[:, 1]) * TILE_PATCHES + patches[:, 0]

    @property
    def is_in_order(self) -> bool:
        """Whether columns lie inside the tile, and voxels in the order of the search: what it relies on."""
        if not len(self):
            return True
        if self.columns.min() < 0 or self.columns.max() >= TILE_VOXELS:
            return False
        inside = self.columns.astype(np.int64) % PATCH_VOXELS
        places = (self._patches()[1] * PATCH_VOXELS + inside[:, 1]) * PATCH_VOXELS + inside[:, 0]
        return bool((np.diff(places) > 0).all())

    @property
    def voxels(self) -> NDArray[np.int32]:
        """(x, y, z) voxel indices in the local frame, shape (n, 3)."""
        corner = np.array(self.key, dtype=np.int32) * TILE_VOXELS
        return np.column_stack([self.columns + corner, self.layers])

    @property
    def n_bytes(self) -> int:
        """Memory this tile holds once its index is made."""
        arrays = (self.columns, self.layers, self.counts, self.normals)
        index = (self.index.layers, self.index.patch_starts)
        return sum(array.nbytes for array in arrays + index)


def search_order(columns: NDArray[np.int16], layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the order (z, patch y, patch x, y, x) of voxels with these indices."""
    patches = columns // PATCH_VOXELS
    return np.lexsort((columns[:, 0], columns[:, 1], patches[:, 0], patches[:, 1], layers))
