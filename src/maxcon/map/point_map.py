"""PointMap: the voxels of a dense point cloud, in tiles around a local frame (D1, D4)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.geometry import LocalFrame, Pose
from maxcon.geometry.arrays import as_points, as_unit_normals, read_only_view
from maxcon.map.ground import GroundPatch, GroundTile, ground_in_memory, ground_patch
from maxcon.map.layout import (
    LEVEL_FACTORS,
    NOT_SEARCHED,
    TILE_VOXELS,
    UNKNOWN_SIGMA,
    SurfaceClass,
    TileKey,
    check_sigma,
)
from maxcon.map.normal_grid import NormalGrid, grid_extent
from maxcon.map.tile import TileCache, TilesInMemory, TileSource, VoxelTile
from maxcon.map.voxel_table import MOST_BYTES, TileTable, VoxelTable
from maxcon.map.voxelize import voxelize

AT_ORIGIN = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
LEVEL_BYTES = 2**28  # size of the cache of the tiles of a level
PREFETCHED_AROUND = 2
"""With the ground of a tile, that of so many tiles on each side is prefetched: it is likely to be needed next."""


class PointMap:
    """The map a scan is localized in: voxels of a point cloud, in tiles; and the heights of the ground, if known.

    Make one with `from_points` or `open`. All that its methods take and return is in its local frame, m; global
    coordinates are turned by `frame`. Threads may share a map. A pickle of one that was opened holds its path, not its
    voxels: it is opened again where it is read.

    Attributes
    ----------
    frame : LocalFrame
        Where the local frame lies in global coordinates: origin and CRS.
    cell : float
        Voxel edge, m; cells of a search are as large, or 2, 4, ... 32 times as large (`level`).
    is_signed : bool
        Whether normals are turned to the side that the mapping sensor saw. If not, w = abs(n_scan . n_map) (D5).
    sigma : float
        How well the map is known: standard deviation of the position of its surfaces along any axis, m.
    tile_voxels : int
        Voxels along an edge of a tile.
    """

    def __init__(
        self, frame: LocalFrame, cell: float, is_signed: bool, tiles: TileSource[VoxelTile],
        sigma: float = UNKNOWN_SIGMA, ground: TileSource[GroundTile] | None = None, tile_voxels: int = TILE_VOXELS,
    ) -> None:  # fmt: skip
        self.frame = frame
        self.cell = cell
        self.is_signed = is_signed
        self.sigma = sigma
        self.tile_voxels = tile_voxels
        self._tiles = tiles
        self._ground: TileSource[GroundTile] = ground if ground is not None else TilesInMemory({})
        self._sorted_keys = np.array(sorted(tiles.keys), dtype=np.int64).reshape(-1, 2)
        self._levels: dict[int, PointMap] = {}
        self._table = TileTable()
        self._normal_grid: NormalGrid | None = None
        self._made_by: tuple[Callable[..., PointMap], tuple[Any, ...]] | None = None
        self._prefetch: Callable[[Iterable[TileKey]], None] | None = None

    def __repr__(self) -> str:
        keys = self._sorted_keys
        x, y = (np.ptp(keys, axis=0) + 1 if len(keys) else np.zeros(2)) * self.tile_voxels * self.cell
        return f"PointMap({len(keys)} tiles, {x:.0f} x {y:.0f} m, {self.frame.crs_words})"

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        return super().__reduce_ex__(protocol) if self._made_by is None else self._made_by

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_levels": {}}

    @classmethod
    def from_points(
        cls, points: ArrayLike, normals: ArrayLike, cell: float = 0.06, *, frame: LocalFrame | None = None,
        is_signed: bool = True, sigma: float = UNKNOWN_SIGMA, ground: ArrayLike | None = None,
    ) -> PointMap:  # fmt: skip
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
            Whether the normals are turned to the side that the sensor saw.
        sigma : float
            How well the points are known: standard deviation of their common position along any axis, m.
        ground : array_like, shape (k, 3), optional
            Points on the ground, local frame, m, whose heights are kept beside the voxels: height, roll and pitch of
            poses come from them.

        Raises
        ------
        ArrayError
            If a number or a shape is wrong, or a normal no unit vector.
        """
        check_sigma(sigma)
        if not (math.isfinite(cell) and cell > 0.0):
            raise ArrayError(f"Expected a positive voxel edge `cell` in m, got {cell}.")
        points = as_points(points, "points")
        normals = as_unit_normals(normals, len(points), "normals")
        tiles = voxelize(points, normals, cell, is_signed=is_signed)
        on_ground = None if ground is None else ground_in_memory(as_points(ground, "ground"), cell)
        return cls(frame or LocalFrame(), float(cell), is_signed, TilesInMemory(tiles), float(sigma), on_ground)

    @classmethod
    def open(
        cls, path: str | os.PathLike[str], *, cache_bytes: int = 2**31,
        left_out: Collection[SurfaceClass] | None = NOT_SEARCHED,
    ) -> PointMap:  # fmt: skip
        """Open a map on disk; tiles are loaded when a search comes near them.

        Parameters
        ----------
        path : path or str
            The folder `maxcon map build` made, or the address it was copied to: `s3://bucket/prefix`, `http://`,
            `https://`.
        cache_bytes : int
            Size of the LRU cache of tiles.
        left_out : collection of SurfaceClass, or None
            What of an updated map is left out: by default what is gone. Nothing if None, and tiles have classes then.

        Raises
        ------
        MapError
            If there is no map, or it is broken; later, from searches, if a tile is.
        """
        from maxcon.map.manifest import read_manifest
        from maxcon.map.storage import address_of, open_storage
        from maxcon.map.store import stored_ground, stored_tiles

        storage = open_storage(path)
        manifest = read_manifest(storage)
        tiles = stored_tiles(storage, manifest, cache_bytes=cache_bytes, left_out=left_out)
        frame, ground = LocalFrame(manifest.origin, manifest.crs), stored_ground(storage, manifest)
        opened = cls(frame, manifest.cell, manifest.is_signed, tiles, manifest.sigma, ground)
        address = address_of(path)
        name = address or str(Path(path).absolute())
        opened._made_by = partial(PointMap.open, name, cache_bytes=cache_bytes, left_out=left_out), ()
        opened._prefetch = tiles.prefetch if address else None
        return opened

    def level(self, factor: int) -> PointMap:
        """Return the same map in voxels `factor` (1, 2, 4, ... 32) times as large, without ground.

        Tiles are merged when a search asks for them. Another factor is an OptionError.
        """
        if factor == 1:
            return self
        if factor not in self._levels:
            if factor not in LEVEL_FACTORS:
                raise OptionError(
                    f"Expected the voxels of a level to be 1, 2, 4, ... or {LEVEL_FACTORS[-1]} times as large as the"
                    f" map's, got {factor}. Choose one of these."
                )
            merged = _merged_tiles(self._tiles, factor, self.is_signed)
            level = PointMap(
                self.frame, self.cell * factor, self.is_signed, merged, self.sigma,
                tile_voxels=self.tile_voxels // factor,
            )  # fmt: skip
            level._made_by = PointMap.level, (self, factor)
            level._prefetch = self._prefetch
            self._levels.setdefault(factor, level)  # the first one, where several threads ask at once
        return self._levels[factor]

    def nearest_level(self, cell: float) -> PointMap:
        """Return the level whose voxel edge comes nearest to `cell` (m), by ratio."""
        return self.level(min(LEVEL_FACTORS, key=lambda factor: abs(math.log(factor * self.cell / cell))))

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
        if self._prefetch is not None and isinstance(self._ground, TileCache):
            margin = PREFETCHED_AROUND * self.tile_voxels * self.cell
            self._ground.prefetch(self._keys_in_square(x, y, reach + margin, self._ground.keys))
        return ground_patch(self._ground, self.cell, x, y, reach)

    def normals_around(self, x: float, y: float, reach: float, z: tuple[float, float]) -> NormalGrid:
        """Normals of at least the voxels in the square of half width `reach` around (x, y) and between two heights.

        Local frame, m. The last grid is kept: the next epoch of a drive needs the same one.
        """
        low, high = grid_extent(self.cell, x, y, reach, z)
        kept = self._normal_grid
        if kept is None or not kept.covers(low, high):
            corners = np.array([low, high + 1])[:, :2] * self.cell
            (mid_x, mid_y), half_width = corners.mean(axis=0).tolist(), float(np.ptp(corners, axis=0).max()) / 2.0
            kept = self._normal_grid = NormalGrid.of(self.tiles_within(mid_x, mid_y, half_width), self.cell, low, high)
        return kept

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """(x, y) of the lower and of the upper corner of all tiles, local frame, m."""
        edge, keys = self.tile_voxels * self.cell, self._sorted_keys
        if not len(keys):
            return (0.0, 0.0), (0.0, 0.0)
        (x_low, y_low), (x_high, y_high) = keys.min(axis=0) * edge, (keys.max(axis=0) + 1) * edge
        return (float(x_low), float(y_low)), (float(x_high), float(y_high))

    def keys_within(self, x: float, y: float, reach: float) -> list[TileKey]:
        """Keys of the tiles that meet the square of half width `reach` (m) around (x, y), local frame, in order."""
        return self._keys_in_square(x, y, reach, self._tiles.keys)

    def _keys_in_square(self, x: float, y: float, reach: float, keys: frozenset[TileKey]) -> list[TileKey]:
        edge = self.tile_voxels * self.cell
        x_first, x_last = math.floor((x - reach) / edge), math.floor((x + reach) / edge)
        y_first, y_last = math.floor((y - reach) / edge), math.floor((y + reach) / edge)
        if (x_last - x_first + 1) * (y_last - y_first + 1) <= len(keys):
            columns, rows = range(x_first, x_last + 1), range(y_first, y_last + 1)
            return [(kx, ky) for kx in columns for ky in rows if (kx, ky) in keys]
        return sorted((kx, ky) for kx, ky in keys if x_first <= kx <= x_last and y_first <= ky <= y_last)

    def tiles_within(self, x: float, y: float, reach: float) -> list[VoxelTile]:
        """Tiles of `keys_within`."""
        return self._load(self.keys_within(x, y, reach))

    def covers(self, x: float, y: float, reach: float = 0.0) -> bool:
        """Whether any tile meets the square of half width `reach` (m) around (x, y), local frame; loads nothing."""
        return bool(self.keys_within(x, y, reach))

    def prefetch_around(self, positions: Iterable[tuple[float, float]], reach: float) -> None:
        """Begin to fetch the tiles within `reach` (m) of positions (x, y), local frame, if the map is on a network."""
        if self._prefetch is not None:
            self._prefetch(sorted({key for x, y in positions for key in self.keys_within(x, y, reach)}))

    def prepare(self, x: float, y: float, reach: float) -> None:
        """Load tiles and ground within `reach` (m) of (x, y), local frame: searches there need not wait for them then.

        The table takes the nearest of them, up to half of what it holds at most.
        """
        middle = np.array([x, y]) / (self.tile_voxels * self.cell) - 0.5
        keys = sorted(self.keys_within(x, y, reach), key=lambda key: math.dist(key, middle))
        n_bytes = np.cumsum([tile.n_bytes for tile in self._load(keys)])
        self.table_of(keys[: int(np.searchsorted(n_bytes, MOST_BYTES // 2))])
        for key in self._keys_in_square(x, y, reach, self._ground.keys):
            self._ground.load(key)

    def _load(self, keys: Sequence[TileKey]) -> list[VoxelTile]:
        if len(keys) > 1 and self._prefetch is not None:
            self._prefetch(keys)
        return [self._tiles.load(key) for key in keys]

    def table_of(self, keys: Iterable[TileKey]) -> VoxelTable:
        """`VoxelTable` of some tiles; they are kept for the epochs that follow."""
        return self._table.of(keys, self._load)

    def tile(self, key: TileKey) -> VoxelTile:
        """Load one tile, a key of `tile_keys`."""
        return self._tiles.load(key)

    def keys_around(
        self, points: NDArray[np.float64], margin: float, poses: Sequence[Pose] = (AT_ORIGIN,)
    ) -> list[TileKey]:
        """Keys of the tiles within `margin` (m), along x and y, of points (n, 3), sensor frame, at any pose, in order.

        The margin is at most half the edge of a tile: then a corner of the square around a point lies in each.
        """
        from maxcon.map import tile_kernels

        if not (len(points) and len(self._sorted_keys)):
            return []
        edge = self.tile_voxels * self.cell
        corner, last = self._sorted_keys.min(axis=0) - 1, self._sorted_keys.max(axis=0) + 1
        is_met = np.zeros(last - corner + 1, bool)  # with a border for what lies outside
        for pose in poses:
            tile_kernels.mark_tiles(read_only_view(points), pose.rotation, pose.position, margin, edge, corner, is_met)
        is_met_key = is_met[tuple((self._sorted_keys - corner).T)]
        return [(x, y) for x, y in self._sorted_keys[is_met_key].tolist()]

    def all_voxels(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
        """Indices (m, 3), counts (m,) and normals (m, 3) of every voxel: for small maps and tests."""
        tiles = [self._tiles.load(key) for key in sorted(self._tiles.keys)]
        return (
            np.concatenate([tile.voxels for tile in tiles] or [np.empty((0, 3), np.int32)]),
            np.concatenate([tile.counts for tile in tiles] or [np.empty(0, np.int32)]),
            np.concatenate([tile.normals for tile in tiles] or [np.empty((0, 3), np.float32)]),
        )


def _merged_tiles(source: TileSource[VoxelTile], factor: int, is_signed: bool) -> TileCache[VoxelTile]:
    """Return the tiles of a level: counts add up; positions and normals are means, each as often as it has points."""

    def merge(key: TileKey) -> VoxelTile:
        from maxcon.map import tile_kernels

        tile = source.load(key)
        given = (tile.columns, tile.layers, tile.counts, tile.normals, tile.means)
        edge = tile.edge // factor
        columns, layers, counts, normals, means = tile_kernels.merge(
            *(read_only_view(array) for array in given), edge, factor, is_signed
        )
        return VoxelTile(key, columns, layers, counts, normals, means, edge)

    return TileCache(merge, LEVEL_BYTES, source.keys)
