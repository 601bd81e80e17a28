# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Making one tile of a map: the moments of its voxels, then their normals, which need the tiles around."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from maxcon.mapping.spill import TileSpill
from maxcon.mapping.voxel_moments import HALO_VOXELS, VoxelMoments
from maxcon.mapping.voxel_normals import plane_normals, turn_to_side
from maxcon.point_map import TILE_VOXELS, TileKey, VoxelTile
from maxcon.point_map.voxelize import mean_normals, mean_steps, tile_of_voxels

__all__ = ["TileMaker"]


class TileMaker:
    """Makes tiles of sorted points. First `gather` every tile, then `make` any of them.

    Parameters
    ----------
    spill : TileSpill
        The points.
    folder : Path
        Where moments are kept in between.
    cell : float
        Voxel edge, m.
    has_normals : bool
        Whether the points' sides are their normals; otherwise planes are fitted.
    is_signed : bool
        Whether normals are turned to the points' sides.
    """

    def __init__(
        self, spill: TileSpill, folder: Path, cell: float, *, has_normals: bool, is_signed: bool
    ) -> None:
        self._spill = spill
        self._folder = folder
        self._cell = cell
        self._has_normals = has_normals
        self._is_signed = is_signed
        self._keys = frozenset(spill.keys)

    def gather(self, key: TileKey) -> None:
        """Sum the points of a tile into its voxels and keep these on disk."""
        moments = VoxelMoments.from_records(self._spill.records(key))
        moments.save(self._path(key))
        self._spill.remove(key)

    def make(self, key: TileKey) -> VoxelTile:
        """Return a tile; it and the tiles around it have been gathered."""
        own = VoxelMoments.load(self._path(key))
        if self._has_normals:
            normals = mean_normals(own.sides, own.counts)
        else:
            moments = VoxelMoments.concatenate([own, *self._halo(key)])
            x, y = moments.indices[:, 0], moments.indices[:, 1]
            is_own = (x >= 0) & (x < TILE_VOXELS) & (y >= 0) & (y < TILE_VOXELS)
            fitted = plane_normals(moments, self._cell, is_own)[is_own]
            normals = (turn_to_side(fitted, own.sides) if self._is_signed else fitted).astype(np.float32)
        return tile_of_voxels(
            key,
            own.indices[:, :2].astype(np.int16),
            np.ascontiguousarray(own.indices[:, 2]),
            own.counts.astype(np.int32),
            normals,
            mean_steps(own.sums, own.counts, self._cell),
        )

    def clear(self, keys: Sequence[TileKey]) -> None:
        """Remove what was kept in between."""
        for key in keys:
            self._path(key).unlink()

    def _halo(self, key: TileKey) -> Iterator[VoxelMoments]:
        """Voxels of the tiles around, as far as neighbourhoods reach; x and y from this tile's corner."""
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                neighbour = (key[0] + dx, key[1] + dy)
                if (dx, dy) == (0, 0) or neighbour not in self._keys:
                    continue
                moments = VoxelMoments.load(self._path(neighbour))
                x = moments.indices[:, 0] + dx * TILE_VOXELS
                y = moments.indices[:, 1] + dy * TILE_VOXELS
                is_near = (
                    (x >= -HALO_VOXELS)
                    & (x < TILE_VOXELS + HALO_VOXELS)
                    & (y >= -HALO_VOXELS)
                    & (y < TILE_VOXELS + HALO_VOXELS)
                )
                yield moments.select(is_near, (dx * TILE_VOXELS, dy * TILE_VOXELS))

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.npz"
