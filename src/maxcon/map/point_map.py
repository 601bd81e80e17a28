# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PointMap: the voxels of a dense point cloud, in tiles around a local frame (D1, D4)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.geometry import LocalFrame
from maxcon.geometry.arrays import as_points, as_unit_normals
from maxcon.map.ground import GroundInMemory, GroundPatch, GroundSource, ground_patch
from maxcon.map.layout import TILE_VOXELS, TileKey
from maxcon.map.sigma import UNKNOWN_SIGMA, check_sigma
from maxcon.map.surface_class import NOT_SEARCHED, SurfaceClass
from maxcon.map.tile import TileSource, VoxelTile
from maxcon.map.voxelize import split_into_tiles, voxelize

__all__ = ["PointMap"]


# Comparisons of rectangles with tiles that are made at once: a few MB.
MOST_AT_ONCE = 1_000_000


class _TilesInMemory:
    """Tiles that were made here."""

    def __init__(self, tiles: dict[TileKey, VoxelTile]) -> None:
        self._tiles = tiles

    @property
    def keys(self) -> frozenset[TileKey]:
        return frozenset(self._tiles)

    def load(self, key: TileKey) -> VoxelTile:
        return self._tiles[key]


class PointMap:
    """The map a scan is localized in. Make one with `from_points` or `open`.

    A pickle of one that was opened holds its path, not its voxels: it is opened again where it is read.

    Attributes
    ----------
    frame : LocalFrame
        Where the local frame lies in global coordinates.
    cell : float
        Voxel edge, m: the cell edge of any search in this map.
    is_signed : bool
        Whether normals are turned to the sensor's side. If not, w = abs(n_scan . n_map) (D5).
    sigma : float
        How well the map is known: standard deviation of its position along any axis, m.
    tile_voxels : int
        Voxels along an edge of a tile.
    """

    def __init__(
        self,
        frame: LocalFrame,
        cell: float,
        is_signed: bool,
        tiles: TileSource,
        sigma: float = UNKNOWN_SIGMA,
        ground: GroundSource | None = None,
        tile_voxels: int = TILE_VOXELS,
    ) -> None:
        self.frame = frame
        self.cell = cell
        self.is_signed = is_signed
        self.sigma = sigma
        self.tile_voxels = tile_voxels
        self._tiles = tiles
        self._ground: GroundSource = ground if ground is not None else GroundInMemory({})
        self._sorted_keys = np.array(sorted(tiles.keys), dtype=np.int64).reshape(-1, 2)
        self._levels: dict[int, PointMap] = {1: self}
        self._made_by: tuple[Callable[..., PointMap], tuple[Any, ...]] | None = None
        self._fetch_ahead: Callable[[Iterable[TileKey]], None] | None = None

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        return super().__reduce_ex__(protocol) if self._made_by is None else self._made_by

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        normals: ArrayLike,
        cell: float = 0.06,
        *,
        frame: LocalFrame | None = None,
        is_signed: bool = True,
        sigma: float = UNKNOWN_SIGMA,
        ground: ArrayLike | None = None,
    ) -> PointMap:
        """Rasterize points with normals into a map in memory.

        Parameters
        ----------
        points, normals : array_like, shape (m, 3)
            Local frame, m; unit normals, a row of zeros where there is none.
        cell : float
            Voxel edge, m.
        frame : LocalFrame, optional
            Where the local frame lies; at the global origin, without a CRS, if not given.
        is_signed : bool
            Whether the normals are turned to the sensor's side.
        sigma : float
            How well the points are known: standard deviation of their common position along any axis, m.
        ground : array_like, shape (k, 3), optional
            Points on the ground, local frame, m: their heights are kept in a grid beside the voxels.

        Raises
        ------
        ArrayError
            If a shape is wrong, a value is not finite, a normal is not a unit vector, `cell` is not positive or `sigma`
            negative.
        """
        check_sigma(sigma)
        if not (math.isfinite(cell) and cell > 0.0):
            raise ArrayError(f"Expected a positive voxel edge `cell` in m, got {cell}.")
        points = as_points(points, "points")
        normals = as_unit_normals(normals, len(points), "normals")
        tiles = split_into_tiles(*voxelize(points, normals, cell, is_signed=is_signed))
        on_ground = None if ground is None else GroundInMemory.of_points(as_points(ground, "ground"), cell)
        return cls(frame or LocalFrame(), float(cell), is_signed, _TilesInMemory(tiles), float(sigma), on_ground)

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        cache_bytes: int = 2**31,
        left_out: Collection[SurfaceClass] | None = NOT_SEARCHED,
    ) -> PointMap:
        """Open a map on disk; tiles are loaded when a search comes near them.

        Parameters
        ----------
        path : path or str
            The folder `maxcon map build` made; or the address it was copied to: `s3://bucket/prefix`, `http://`,
            `https://`.
        cache_bytes : int
            Tiles are kept up to this size in all, the ones used longest ago go first.
        left_out : collection of SurfaceClass, optional
            What of an updated map is left out: by default what is gone. Nothing if None, and tiles have classes then.

        Raises
        ------
        MapError
            If it is not a map, is of another format version, or its manifest is broken.
        """
        from maxcon.map.manifest import read_manifest
        from maxcon.map.storage import address_of, open_place
        from maxcon.map.store import GroundStore, TileStore

        files = open_place(path)
        manifest = read_manifest(files)
        store = TileStore(files, manifest, cache_bytes=cache_bytes, left_out=left_out)
        frame, ground = LocalFrame(manifest.origin, manifest.crs), GroundStore(files, manifest)
        opened = cls(frame, manifest.cell, manifest.is_signed, store, manifest.sigma, ground)
        address = address_of(path)
        opened._made_by = _opened, (address or str(Path(path).absolute()), cache_bytes, left_out)
        opened._fetch_ahead = store.announce if address else None
        return opened

    def level(self, factor: int) -> PointMap:
        """Return the same map in voxels `factor` times as large, without ground; tiles are merged when a search asks.

        Parameters
        ----------
        factor : int
            A power of two, at most 32.

        Raises
        ------
        OptionError
            If it is not.
        """
        if factor not in self._levels:
            from maxcon.map.level import MergedTiles, check_factor

            check_factor(factor)
            merged = MergedTiles(self._tiles, factor, is_signed=self.is_signed)
            level = PointMap(
                self.frame, self.cell * factor, self.is_signed, merged, self.sigma,
                tile_voxels=self.tile_voxels // factor,
            )  # fmt: skip
            level._made_by = PointMap.level, (self, factor)
            level._fetch_ahead = self._fetch_ahead
            self._levels.setdefault(factor, level)  # the first one, where several threads ask at once
        return self._levels[factor]

    @property
    def tile_keys(self) -> frozenset[TileKey]:
        """Keys of all tiles, loaded or not."""
        return self._tiles.keys

    @property
    def has_ground(self) -> bool:
        """Whether the height of the ground is known anywhere."""
        return bool(self._ground.keys)

    def ground_around(self, x: float, y: float, reach: float) -> GroundPatch:
        """Heights of the ground in the square of half width `reach` (m) around (x, y), local frame, m."""
        return ground_patch(self._ground, self.cell, x, y, reach)

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(x, y) of the lower and of the upper corner of all tiles, local frame, m."""
        edge = self.tile_voxels * self.cell
        keys = np.array(sorted(self._tiles.keys)).reshape(-1, 2)
        if not len(keys):
            return (0.0, 0.0), (0.0, 0.0)
        (x_low, y_low), (x_high, y_high) = keys.min(axis=0) * edge, (keys.max(axis=0) + 1) * edge
        return (float(x_low), float(y_low)), (float(x_high), float(y_high))

    def tiles_within(self, x: float, y: float, reach: float) -> list[VoxelTile]:
        """Tiles that meet the square of half width `reach` (m) around (x, y), local frame, ordered by key."""
        return self._load(self.keys_within(x, y, reach))

    def announce(self, keys: Iterable[TileKey]) -> None:
        """Announce tiles that will be needed soon: those of a map on a network are fetched in the background."""
        if self._fetch_ahead is not None:
            self._fetch_ahead(keys)

    def announce_around(self, places: Iterable[tuple[float, float]], reach: float) -> None:
        """Announce the tiles around places (x, y), local frame, m; costs nothing where the map is on this machine."""
        if self._fetch_ahead is not None:
            self._fetch_ahead(sorted({key for x, y in places for key in self._keys_within(x, y, reach)}))

    def _load(self, keys: Sequence[TileKey]) -> list[VoxelTile]:
        if len(keys) > 1:
            self.announce(keys)
        return [self._tiles.load(key) for key in keys]

    def keys_within(self, x: float, y: float, reach: float) -> list[TileKey]:
        """Keys of the tiles that `tiles_within` gives, in order; loads nothing."""
        return sorted(self._keys_within(x, y, reach))

    def tile(self, key: TileKey) -> VoxelTile:
        """Load one tile, a key of `tile_keys`."""
        return self._tiles.load(key)

    def tiles_met(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> list[VoxelTile]:
        """Tiles that meet any of the rectangles from `low` to `high`, shape (n, 2), local frame, m, ordered by key."""
        edge = self.tile_voxels * self.cell
        if not len(low):
            return []
        first, last = np.floor(low / edge), np.floor(high / edge)
        is_new = np.ones(len(first), bool)  # neighbours meet the same tiles: most are told apart by the one before
        is_new[1:] = ((first[1:] != first[:-1]) | (last[1:] != last[:-1])).any(axis=1)
        first, last = first[is_new], last[is_new]
        keys = self._sorted_keys
        near = keys[((keys >= first.min(axis=0)) & (keys <= last.max(axis=0))).all(axis=1)]
        met = [
            part[((first[:, None] <= part) & (last[:, None] >= part)).all(axis=2).any(axis=0)]
            for part in np.array_split(near, 1 + len(near) * len(first) // MOST_AT_ONCE)
        ]
        return self._load([(x, y) for x, y in np.concatenate(met).tolist()])

    def tiles_around(self, places: NDArray[np.float64], margin: float) -> list[VoxelTile]:
        """Tiles within `margin` (m), along x and y, of any of the places, shape (n, 2), local frame, ordered by key.

        As `tiles_met` of squares, for thousands of them; the margin is at most half the edge of a tile.
        """
        from maxcon.map import tile_kernels

        if not (len(places) and len(self._sorted_keys)):
            return []
        corner, end = self._sorted_keys.min(axis=0) - 1, self._sorted_keys.max(axis=0) + 1
        is_met = np.zeros((end - corner + 1)[::-1], bool)  # with a rim for what lies outside
        tile_kernels.mark_tiles(places, margin, self.tile_voxels * self.cell, corner, is_met)
        x, y = (self._sorted_keys - corner).T
        return self._load([(kx, ky) for kx, ky in self._sorted_keys[is_met[y, x]].tolist()])

    def covers(self, x: float, y: float, reach: float = 0.0) -> bool:
        """Whether any tile meets the square of half width `reach` (m) around (x, y), local frame; loads nothing."""
        return bool(self._keys_within(x, y, reach))

    def _keys_within(self, x: float, y: float, reach: float) -> list[TileKey]:
        edge = self.tile_voxels * self.cell
        x_first, x_last = math.floor((x - reach) / edge), math.floor((x + reach) / edge)
        y_first, y_last = math.floor((y - reach) / edge), math.floor((y + reach) / edge)
        keys = self._tiles.keys
        if (x_last - x_first + 1) * (y_last - y_first + 1) <= len(keys):
            columns, rows = range(x_first, x_last + 1), range(y_first, y_last + 1)
            return [(kx, ky) for kx in columns for ky in rows if (kx, ky) in keys]
        return [(kx, ky) for kx, ky in keys if x_first <= kx <= x_last and y_first <= ky <= y_last]

    def all_voxels(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
        """Indices (m, 3), counts (m,) and normals (m, 3) of every voxel: for small maps and tests."""
        tiles = [self._tiles.load(key) for key in sorted(self._tiles.keys)]
        return (
            np.concatenate([tile.voxels for tile in tiles] or [np.empty((0, 3), np.int32)]),
            np.concatenate([tile.counts for tile in tiles] or [np.empty(0, np.int32)]),
            np.concatenate([tile.normals for tile in tiles] or [np.empty((0, 3), np.float32)]),
        )


def _opened(path: str, cache_bytes: int, left_out: Collection[SurfaceClass] | None) -> PointMap:
    return PointMap.open(path, cache_bytes=cache_bytes, left_out=left_out)
