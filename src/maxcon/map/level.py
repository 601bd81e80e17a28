# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Levels of a map: its voxels merged to larger ones, tile by tile (decision 21)."""

from maxcon._system.compiled import read_only_view
from maxcon.errors import OptionError
from maxcon.map.kept_tiles import KeptTiles
from maxcon.map.layout import PATCH_VOXELS, TILE_VOXELS, TileKey
from maxcon.map.tile import TileSource, VoxelTile

__all__ = ["FACTORS", "MergedTiles", "check_factor", "merged"]

FACTORS = tuple(2**power for power in range((TILE_VOXELS // PATCH_VOXELS).bit_length()))
"""How many times as large the voxels of a level may be as the map's: whole patches fill a tile."""
LEVEL_BYTES = 2**28
"""Tiles of a level are kept up to this size in all; the ones used longest ago go first."""


def check_factor(factor: int) -> None:
    """Refuse voxels other than 1, 2, 4, ... times as large, up to one patch for a tile.

    Raises
    ------
    OptionError
        If the factor is not a power of two from 1 to 32.
    """
    if factor not in FACTORS:
        raise OptionError(
            f"Expected the voxels of a level to be 1, 2, 4, ... or {FACTORS[-1]} times as large as the map's, got"
            f" {factor}."
        )


def merged(tile: VoxelTile, factor: int, *, is_signed: bool) -> VoxelTile:
    """Return the same square of the map in voxels `factor` times as large.

    A voxel has the points of those in it: their number; the mean of their positions; the mean of their normals, each
    as often as its voxel has points, turned to one side first where normals have none.
    """
    from maxcon.map import level_kernels

    columns, layers, counts, normals, means = level_kernels.merge(
        read_only_view(tile.columns), read_only_view(tile.layers), read_only_view(tile.counts),
        read_only_view(tile.normals), read_only_view(tile.means), tile.edge // factor, factor, is_signed,
    )  # fmt: skip
    return VoxelTile(tile.key, columns, layers, counts, normals, means, tile.edge // factor)


class MergedTiles:
    """The tiles of a level, merged when asked for; those used last are kept.

    Parameters
    ----------
    source : TileSource
        The map's own tiles.
    factor : int
        How many times as large the voxels are.
    is_signed : bool
        Whether the map's normals have a side.
    """

    def __init__(self, source: TileSource, factor: int, *, is_signed: bool) -> None:
        self._source = source
        self._factor = factor
        self._is_signed = is_signed
        self._kept: KeptTiles[VoxelTile] = KeptTiles(LEVEL_BYTES)

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles there are."""
        return self._source.keys

    def load(self, key: TileKey) -> VoxelTile:
        """Return one of them.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        return self._kept.load(key, lambda: merged(self._source.load(key), self._factor, is_signed=self._is_signed))
