# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map in large voxels at their height above the ground, and squares of cells in which a scanner may stand.

With heights above the ground a scan needs no height to be compared with the map. A voxel keeps no normals, but which
orientation bins they are in.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.map import PointMap, TileKey
from maxcon.map.tile import TileCache
from maxcon.relocalization.kernels import BLOCK, N_BLOCKS, REGION

if TYPE_CHECKING:
    from maxcon.map.ground import GroundPatch

HIGHEST = 30.0
"""Voxels, and points, higher above the ground do not take part, m."""
# A scanner may stand up to so far from known ground, m: a parked truck hides some.
BESIDE_GROUND = 2.0
# Ground up to so far outside a tile is read, m: where there is none, the height of the nearest cell is taken.
GROUND_MARGIN = 16.0
N_BINS = 7
"""Orientation bins, sectors of azimuth: a bit of a byte each."""
BIN_WIDTH = 2.0 * np.pi / N_BINS
ANY_BIN = N_BINS
"""Number of the eighth bit, which every voxel with points has."""
# A voxel is in every bin whose middle is within 60 degrees of its normal, flattened.
LEAST_COSINE = 0.5

REACH = 84.0
"""Farthest points of a scan that take part, m, horizontally."""
# Cells up to so many beyond a region can be counted with its voxels, too, as `recount` does.
BORDER = 3
# Tiles and regions are kept up to these sizes in all; the ones used longest ago go first.
TILE_BYTES, REGION_BYTES = 2**27, 2**28


@dataclass(frozen=True, slots=True)
class Level:
    """Cell edge of a search in a level of the map, and edge of the cubes of the thinned scan, m."""

    cell: float
    thinning: float


@dataclass(frozen=True, slots=True, eq=False)
class CoarseTile:
    """One tile of the map, with heights above the ground.

    columns: shape (n, 2), int32; (x, y) index of each voxel, local frame.
    layers: shape (n,), int16; its height above the ground in voxels.
    bins: shape (n,), uint8; see `_bins_of_voxels`.
    is_allowed: shape (edge, edge); whether a scanner may stand at the middle of cell (y, x) of the tile.
    """

    columns: NDArray[np.int32]
    layers: NDArray[np.int16]
    bins: NDArray[np.uint8]
    is_allowed: NDArray[np.bool_]

    @property
    def n_bytes(self) -> int:
        """Memory it holds."""
        return self.columns.nbytes + self.layers.nbytes + self.bins.nbytes + self.is_allowed.nbytes


class CoarseTiles:
    """LRU cache of the tiles of a level of a map, with heights above the ground; a MapError if it has no ground."""

    def __init__(self, point_map: PointMap, level: Level) -> None:
        if not point_map.has_ground:
            raise MapError(
                "Expected a map that knows the height of the ground, to be searched without a prior, got one without."
                " Build it anew of clouds whose ground is classified, or localize with a prior."
            )
        self.map = point_map
        self.level = point_map.nearest_level(level.cell)
        self.edge = self.level.tile_voxels
        """Cells along an edge of a tile."""
        self.cell = self.level.cell
        """Edge of a voxel, and of a cell, m."""
        self.n_layers = int(np.ceil(HIGHEST / self.cell))
        self.load = TileCache(partial(_coarse_tile, point_map, self.level, self.n_layers), TILE_BYTES).load

    @cached_property
    def keys(self) -> frozenset[TileKey]:
        """Keys of all tiles and of their neighbours: where there is nothing but ground the map has no tile."""
        return frozenset((x + i, y + j) for x, y in self.map.tile_keys for i in (-1, 0, 1) for j in (-1, 0, 1))


def _coarse_tile(point_map: PointMap, level: PointMap, n_layers: int, key: TileKey) -> CoarseTile:
    """Return a tile of a level of a map, with heights above the ground of the map."""
    edge, cell = level.tile_voxels, level.cell
    half = 0.5 * edge * cell
    patch = point_map.ground_around((2 * key[0] + 1) * half, (2 * key[1] + 1) * half, half + GROUND_MARGIN)
    heights, distances = _filled(patch)
    cells = np.arange(edge) + 0.5
    x, y = (key[0] * edge + cells) * cell, (key[1] * edge + cells) * cell
    is_allowed = distances[_nearest_cells(patch, x[None, :], y[:, None])] <= BESIDE_GROUND
    if key not in point_map.tile_keys:
        return CoarseTile(np.empty((0, 2), np.int32), np.empty(0, np.int16), np.empty(0, np.uint8), is_allowed)
    tile = level.tile(key)
    points = tile.mean_points(cell)
    above = points[:, 2] - heights[_nearest_cells(patch, points[:, 0], points[:, 1])]
    layers = np.floor(above / cell)
    takes_part = (layers >= 0) & (layers < n_layers)
    bins = _bins_of_voxels(tile.normals, is_signed=point_map.is_signed)
    return CoarseTile(tile.voxels[takes_part, :2], layers[takes_part].astype(np.int16), bins[takes_part], is_allowed)


def _bins_of_voxels(normals: NDArray[np.float32], *, is_signed: bool) -> NDArray[np.uint8]:
    """Bits (n,) of all orientation bins near the normals (n, 3), map axes, of voxels; and bit `ANY_BIN`."""
    bits = np.full(len(normals), 1 << ANY_BIN, np.uint8)
    for number in range(N_BINS):
        along = normals[:, 0] * np.cos(number * BIN_WIDTH) + normals[:, 1] * np.sin(number * BIN_WIDTH)
        bits[(along if is_signed else np.abs(along)) > LEAST_COSINE] |= np.uint8(1 << number)
    return bits


def _filled(patch: "GroundPatch") -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """The lowest level of a patch of ground, that of the nearest cell where there is none, and how far that is, m.

    Where a patch has no ground at all, heights are NaN and infinitely far.
    """
    from scipy.ndimage import distance_transform_edt

    heights = patch.heights[0]
    is_unknown = np.isnan(heights)
    if is_unknown.all():
        return heights, np.full(heights.shape, np.inf)
    distances, (rows, columns) = distance_transform_edt(is_unknown, sampling=patch.edge, return_indices=True)
    return heights[rows, columns], distances


def _nearest_cells(
    patch: "GroundPatch", x: NDArray[np.floating], y: NDArray[np.floating]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of the cells of a patch of ground that places lie in, or the nearest."""
    _, ny, nx = patch.heights.shape
    rows = np.clip(np.floor(y / patch.edge).astype(np.int64) - patch.first[1], 0, ny - 1)
    columns = np.clip(np.floor(x / patch.edge).astype(np.int64) - patch.first[0], 0, nx - 1)
    return rows, columns


class Area(NamedTuple):
    """A circle in which a scanner is known to stand: its middle (x, y), local frame, and its radius, m."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True, eq=False)
class Voxels:
    """The voxels of a region and of a margin around it, and unions of them for bounds.

    bins: shape (n_layers, ny, nx), uint8; bits of orientation bins, 0 where there is no voxel.
    is_allowed: shape (REGION, REGION); whether a scanner may stand in cell (y, x).
    """

    bins: NDArray[np.uint8]
    is_allowed: NDArray[np.bool_]

    @cached_property
    def pooled(self) -> NDArray[np.uint8]:
        """Union of the bins of 2 x 2 voxels from (y, x) on: for bounds of four cells."""
        return _pooled(self.bins, 1)

    @cached_property
    def blocks(self) -> NDArray[np.uint64]:
        """Union of the bins of 4 x 4 voxels, (n_layers, 8, 4, 4, n, 2): (layer, bin, py, px, Y, word).

        Bit X of both words is that of the block from voxel (4 Y + py, 4 X + px) on.
        """
        pooled = _pooled(self.pooled, 2)
        n_layers, width, _ = pooled.shape
        n = width // BLOCK
        parts = pooled.reshape(n_layers, n, BLOCK, n, BLOCK).transpose(0, 2, 4, 1, 3)
        bits = np.zeros((n_layers, BLOCK, BLOCK, 8, n, 2 * N_BLOCKS), bool)
        for number in range(8):
            bits[:, :, :, number, :, :n] = parts & (1 << number)
        bytes_of_rows = np.packbits(bits, axis=-1, bitorder="little")
        return np.ascontiguousarray(bytes_of_rows.view("<u8").astype(np.uint64).transpose(0, 3, 1, 2, 4, 5))

    @property
    def n_bytes(self) -> int:
        """Memory it holds once its bounds are made."""
        return 5 * self.bins.nbytes


def _pooled(bins: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Union of the bins of each voxel and of those `step` farther along x, y and both."""
    along = bins.copy()
    along[:, :, :-step] |= bins[:, :, step:]
    both = along.copy()
    both[:, :-step] |= along[:, step:]
    return both


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A square of REGION x REGION cells, `first` the (x, y) index of the first, in which a scanner may stand.

    margin: cells that the voxels reach beyond it on every side.
    voxels: those of the region and its margin.
    is_allowed: shape (REGION, REGION); whether a scanner may stand in cell (y, x), inside of the area.
    """

    first: tuple[int, int]
    margin: int
    voxels: Voxels
    is_allowed: NDArray[np.bool_]

    @property
    def rows(self) -> NDArray[np.uint64]:
        """Blocks in which a scanner may stand somewhere: bit X of word Y, shape (N_BLOCKS,)."""
        is_met = self.is_allowed.reshape(N_BLOCKS, BLOCK, N_BLOCKS, BLOCK).any(axis=(1, 3))
        return np.packbits(is_met, axis=-1, bitorder="little").view("<u8").astype(np.uint64).ravel()


class Regions:
    """LRU cache of the regions of a map; cells whose middle lies outside of `area`, if given, are left out."""

    def __init__(self, tiles: CoarseTiles, area: Area | None = None) -> None:
        self.tiles = tiles
        self.area = area
        # Cells that the voxels of a region reach beyond it: the reach of a scan from BORDER beyond; whole blocks.
        self.margin = -(-(int(REACH / tiles.cell) + 1 + BORDER) // BLOCK) * BLOCK
        self._kept = TileCache(partial(_voxels_of_region, tiles, self.margin), REGION_BYTES)

    def within(self, area: Area | None) -> "Regions":
        """The same regions with another area, or none; the cache is shared."""
        regions = Regions(self.tiles, area)
        regions._kept = self._kept
        return regions

    @cached_property
    def n_allowed(self) -> dict[TileKey, int]:
        """Number of cells in which a scanner may stand, of each region that has any, by key in order."""
        edge = self.tiles.edge
        keys = {key for x, y in self.tiles.keys for key in _squares(x * edge, y * edge, edge, REGION)}
        if self.area is not None:
            x, y, reach = (int(value // self.tiles.cell) for value in self.area)
            keys.intersection_update(_squares(x - reach - 1, y - reach - 1, 2 * reach + 4, REGION))
        counts = {key: int((_standable(self.tiles, key) & self._is_inside(key)).sum()) for key in sorted(keys)}
        return {key: count for key, count in counts.items() if count}

    @property
    def keys(self) -> list[TileKey]:
        """Keys of the regions in which a scanner may stand, in order."""
        return list(self.n_allowed)

    def load(self, key: TileKey) -> Region:
        """Return a region by its key: (x, y) of its first cell, divided by REGION."""
        voxels = self._kept.load(key)
        is_allowed = voxels.is_allowed & self._is_inside(key)
        return Region((key[0] * REGION, key[1] * REGION), self.margin, voxels, is_allowed)

    def _is_inside(self, key: TileKey) -> NDArray[np.bool_]:
        """Which cells of a region lie in the area, shape (REGION, REGION)."""
        if self.area is None:
            return np.ones((REGION, REGION), bool)
        x, y = ((key[axis] * REGION + np.arange(REGION) + 0.5) * self.tiles.cell for axis in (0, 1))
        return np.asarray(np.hypot(x[None, :] - self.area.x, y[:, None] - self.area.y) <= self.area.radius)


def _voxels_of_region(tiles: CoarseTiles, margin: int, key: TileKey) -> Voxels:
    """Return the voxels of a region and of a margin around it, and where a scanner may stand in it."""
    width = REGION + 2 * margin
    corner = np.array(key) * REGION - margin
    bins = np.zeros((tiles.n_layers, width, width), np.uint8)
    for tile_key in _squares(int(corner[0]), int(corner[1]), width, tiles.edge):
        if tile_key not in tiles.map.tile_keys:
            continue
        tile = tiles.load(tile_key)
        x, y = (tile.columns - corner).T
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < width)
        # Two voxels above each other may fall into one layer: it has the bins of both.
        np.bitwise_or.at(bins, (tile.layers[inside], y[inside], x[inside]), tile.bins[inside])
    return Voxels(bins, _standable(tiles, key))


def _standable(tiles: CoarseTiles, key: TileKey) -> NDArray[np.bool_]:
    """Where a scanner may stand in a region, shape (REGION, REGION)."""
    edge, (first_x, first_y) = tiles.edge, (key[0] * REGION, key[1] * REGION)
    is_allowed = np.zeros((REGION, REGION), bool)
    for x, y in _squares(first_x, first_y, REGION, edge):
        if (x, y) in tiles.keys:
            left, low = x * edge - first_x, y * edge - first_y
            rows, columns = (slice(max(at, 0), min(at + edge, REGION)) for at in (low, left))
            mine = slice(rows.start - low, rows.stop - low), slice(columns.start - left, columns.stop - left)
            is_allowed[rows, columns] = tiles.load((x, y)).is_allowed[mine]
    return is_allowed


def _squares(x: int, y: int, width: int, edge: int) -> list[TileKey]:
    """Keys of the squares of an edge that meet the square of `width` cells from (x, y) on."""
    return list(product(range(x // edge, (x + width - 1) // edge + 1), range(y // edge, (y + width - 1) // edge + 1)))
