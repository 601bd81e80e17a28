# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The tiles and the ground of a map on disk: read when asked for, and checked against their checksums (D10)."""

import threading
from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.map.ground import GroundTile, RecentTiles, ground_voxels
from maxcon.map.kept_tiles import KeptTiles
from maxcon.map.layout import TILE_VOXELS, TileKey
from maxcon.map.manifest import REBUILD, Manifest
from maxcon.map.records import (
    CLASSES,
    GROUND,
    TILES,
    classes_of_batch,
    classes_schema,
    ground_schema,
    tile_of_batch,
    tile_schema,
)
from maxcon.map.section import Section
from maxcon.map.storage import MapFiles
from maxcon.map.surface_class import SurfaceClass
from maxcon.map.tile import VoxelTile

__all__ = ["GroundStore", "TileStore"]

GROUND_AHEAD = 2
"""With the ground of a tile, that of so many tiles on each side is announced: it is likely to be needed next."""
UPDATE = "Update the map it was made of again with `maxcon map update`."


class TileStore:
    """The tiles of a map on disk, read and checked when asked for, and kept in a bounded cache.

    Parameters
    ----------
    files : MapFiles
        The map's files.
    manifest : Manifest
        Its manifest.
    cache_bytes : int
        Size of all kept tiles and their indices; the ones used longest ago go first.
    left_out : collection of SurfaceClass, optional
        Voxels of these classes are left out, and tiles have no classes then. Nothing is left out if None.

    Raises
    ------
    MapError
        If the tiles have other columns.
    """

    def __init__(
        self, files: MapFiles, manifest: Manifest, *, cache_bytes: int, left_out: Collection[SurfaceClass] | None = None
    ) -> None:
        self._section = Section(files, manifest, TILES, tile_schema())
        self._classes = Section(files, manifest, CLASSES, classes_schema())
        self._left_out = left_out
        self._cache: KeptTiles[VoxelTile] = KeptTiles(cache_bytes)

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles there are."""
        return self._section.keys

    def load(self, key: TileKey) -> VoxelTile:
        """Return a tile, from the cache or from the file.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        return self._cache.load(key, lambda: self._read(key))

    def announce(self, keys: Iterable[TileKey]) -> None:
        """Announce tiles that will be needed soon: those of a map on a network are fetched in the background."""
        wanted = [key for key in keys if key not in self._cache]
        self._section.announce(wanted)
        self._classes.announce(wanted)

    def _read(self, key: TileKey) -> VoxelTile:
        tile = tile_of_batch(key, self._section.batch(key))
        if not tile.is_in_order:
            raise MapError(
                f"Expected the voxels of {self._section.where(key)} in the order of the search, got another. {REBUILD}"
            )
        if key not in self._classes.keys:
            return tile
        tile = replace(tile, classes=self._classes_of(tile))
        return tile if self._left_out is None else tile.without(self._left_out)

    def _classes_of(self, tile: VoxelTile) -> NDArray[np.uint8]:
        classes = classes_of_batch(self._classes.batch(tile.key))
        if len(classes) != len(tile) or not np.isin(classes, list(SurfaceClass)).all():
            raise MapError(
                f"Expected a class for each of {len(tile):,} voxels in {self._classes.where(tile.key)}, got other"
                f" numbers. {UPDATE}"
            )
        return classes


class GroundStore:
    """The ground of a map on disk, read when asked for; the tiles used last are kept.

    Parameters
    ----------
    files : MapFiles
        The map's files.
    manifest : Manifest
        Its manifest.

    Raises
    ------
    MapError
        If the ground has other columns.
    """

    def __init__(self, files: MapFiles, manifest: Manifest) -> None:
        self._section = Section(files, manifest, GROUND, ground_schema())
        self._n_cells = TILE_VOXELS // ground_voxels(manifest.cell)
        self._recent = RecentTiles()
        self._lock = threading.Lock()

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles that have ground."""
        return self._section.keys

    def load(self, key: TileKey) -> GroundTile:
        """Return the ground of a tile.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        with self._lock:
            known = self._recent.get(key)
            return self._recent.keep(known if known is not None else self._read(key))

    def _read(self, key: TileKey) -> GroundTile:
        around = range(-GROUND_AHEAD, GROUND_AHEAD + 1)
        near = [(key[0] + x, key[1] + y) for x in around for y in around]
        self._section.announce([other for other in near if other not in self._recent])
        batch = self._section.batch(key)
        columns = batch.column("column").flatten().to_numpy().reshape(-1, 2)
        heights = batch.column("height").to_numpy()
        n = self._n_cells
        is_inside = ((columns >= 0) & (columns < n)).all() and bool(np.isfinite(heights).all())
        cells = columns[:, 1].astype(np.int64) * n + columns[:, 0]
        if not (is_inside and (np.diff(cells) >= 0).all()):
            raise MapError(
                f"Expected the heights of {self._section.where(key)} in the order of their cells, got another."
                f" {REBUILD}"
            )
        return GroundTile.from_rows(key, columns, heights, n)
