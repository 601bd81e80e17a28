"""The ground of a map: heights in a grid of about half a metre, tile by tile, beside the voxels."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.map.layout import TILE_VOXELS, TileKey
from maxcon.map.tile import TilesInMemory, TileSource

GROUND_EDGE = 0.5  # the edge of a cell of the grid is a power of two of voxels, the nearest to this, m
HEADROOM = 2.0  # ground that lies farther than this above other ground of the same cell is another level, m: a bridge
LEAST_SHARE = 0.1  # a level has at least this share of the points of the fullest one of its cell: a stray point is none


def ground_voxels(cell: float, edge: float = GROUND_EDGE) -> int:
    """How many voxels of edge `cell` (m) make the edge of a cell of the ground grid: a power of two, 8 at 6 cm."""
    return int(2 ** min(max(round(math.log2(edge / cell)), 0), TILE_VOXELS.bit_length() - 1))


@dataclass(frozen=True, slots=True, eq=False)
class GroundTile:
    """The ground of one tile of the map."""

    key: TileKey  # the tile's (x, y) index
    # (levels, n, n): height of the ground in cell (y, x) of the tile, local frame, m, from the lowest level on; NaN
    # where there is none. There are n cells along an edge, `TILE_VOXELS` / `ground_voxels`.
    heights: NDArray[np.float32]

    def rows(self) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
        """(x, y) of cells, shape (m, 2), and heights, shape (m,), m, in the order (y, x, height)."""
        y, x, level = np.nonzero(np.isfinite(self.heights.transpose(1, 2, 0)))
        return np.column_stack([x, y]).astype(np.int16), self.heights[level, y, x]

    def points(self, edge: float, at: tuple[float, ...] = (0.5, 0.5)) -> NDArray[np.float64]:
        """A point of each height, in the order of `rows`, (n, 3), m; `edge` of a cell, m, `at`: where in it."""
        columns, heights = self.rows()
        return np.column_stack([(columns + np.array(self.key) * self.heights.shape[1] + at) * edge, heights])

    @classmethod
    def from_rows(
        cls, key: TileKey, columns: NDArray[np.integer], heights: NDArray[np.floating], n: int
    ) -> "GroundTile":
        """Return the tile whose `rows` these are, of n cells along an edge."""
        return cls(key, _stack_levels(columns[:, 1].astype(np.int64) * n + columns[:, 0], heights, n))

    @property
    def n_heights(self) -> int:
        """How many heights there are in all cells and levels."""
        return int(np.count_nonzero(np.isfinite(self.heights)))

    @property
    def n_bytes(self) -> int:
        """Memory it holds."""
        return self.heights.nbytes


def _stack_levels(cells: NDArray[np.integer], heights: NDArray[np.floating], n: int) -> NDArray[np.float32]:
    """Heights by (level, y, x) from those of cells y * n + x, which come ascending in (cell, height)."""
    is_first = np.diff(cells, prepend=-1) != 0
    first = np.flatnonzero(is_first)[np.cumsum(is_first) - 1] if len(cells) else np.empty(0, np.int64)
    level = np.arange(len(cells)) - first
    stacked = np.full((int(level.max(initial=0)) + 1, n * n), np.nan, np.float32)
    stacked[level, cells] = heights
    return stacked.reshape(-1, n, n)


def levels_of_points(
    columns: NDArray[np.integer], heights: NDArray[np.floating], n: int, gap: float
) -> tuple[NDArray[np.int64], NDArray[np.floating], NDArray[np.int64]]:
    """Cell y * n + x, median height (m) and number of points of each level of each cell, ascending, `gap` (m) apart."""
    cells = columns[:, 1].astype(np.int64) * n + columns[:, 0]
    order = np.lexsort((heights, cells))
    cells, heights = cells[order], heights[order]
    starts = np.flatnonzero((np.diff(cells, prepend=-1) != 0) | (np.diff(heights, prepend=0.0) > gap))
    counts = np.diff(starts, append=len(cells))
    return cells[starts], heights[starts + (counts - 1) // 2], counts


def ground_of_points(columns: NDArray[np.integer], heights: NDArray[np.floating], n: int) -> NDArray[np.float32]:
    """Ground by (level, y, x), m: medians of heights (m,), m, of points in (x, y) cells (m, 2), n along an edge."""
    cells, medians, counts = levels_of_points(columns, heights, n, HEADROOM)
    fullest = np.zeros(n * n, np.int64)
    np.maximum.at(fullest, cells, counts)
    is_level = counts >= LEAST_SHARE * fullest[cells]
    return _stack_levels(cells[is_level], medians[is_level], n)


def ground_in_memory(points: NDArray[np.float64], cell: float) -> TilesInMemory[GroundTile]:
    """Return the ground of a map of edge `cell` (m) from points on it, shape (n, 3), local frame, m."""
    edge, n = ground_voxels(cell), TILE_VOXELS // ground_voxels(cell)
    columns = voxel_indices(points, cell)[:, :2] // edge
    keys = columns // n
    tiles = {}
    for x, y in np.unique(keys, axis=0).tolist():
        is_here = (keys == [x, y]).all(axis=1)
        inside = columns[is_here] - np.array([x, y]) * n
        tiles[(x, y)] = GroundTile((x, y), ground_of_points(inside, points[is_here, 2], n))
    return TilesInMemory(tiles)


@dataclass(frozen=True, slots=True, eq=False)
class GroundPatch:
    """The ground around a place."""

    heights: NDArray[np.float32]  # (levels, ny, nx): as in `GroundTile`
    first: tuple[int, int]  # (x, y) number of its first cell, counted from the local frame's origin
    edge: float  # of a cell, m

    def points(self) -> NDArray[np.float64]:
        """Return a point in the middle of each cell, at each of its heights, shape (n, 3), local frame, m."""
        levels, rows, columns = np.nonzero(np.isfinite(self.heights))
        middles = (np.column_stack([columns, rows]) + 0.5 + np.array(self.first)) * self.edge
        return np.column_stack([middles, self.heights[levels, rows, columns]])

    def cells_at(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the cells that places (x, y), m, lie in, or of the nearest."""
        _, ny, nx = self.heights.shape
        rows = np.clip(np.floor(y / self.edge).astype(np.int64) - self.first[1], 0, ny - 1)
        return rows, np.clip(np.floor(x / self.edge).astype(np.int64) - self.first[0], 0, nx - 1)

    def filled(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Heights, those of the nearest cell where none are known, and how far that is, (ny, nx), m; infinity: none."""
        from scipy.ndimage import distance_transform_edt

        is_unknown = np.isnan(self.heights[0])
        if is_unknown.all():
            return self.heights, np.full(is_unknown.shape, np.inf)
        distances, (rows, columns) = distance_transform_edt(is_unknown, sampling=self.edge, return_indices=True)
        return self.heights[:, rows, columns], distances


def ground_patch(source: TileSource[GroundTile], cell: float, x: float, y: float, reach: float) -> GroundPatch:
    """Return the ground in the square of half width `reach` (m) around (x, y), of a map of edge `cell` (m)."""
    edge, n = ground_voxels(cell) * cell, TILE_VOXELS // ground_voxels(cell)
    (x_first, y_first), (x_last, y_last) = (
        [math.floor(value / edge) for value in (x + side, y + side)] for side in (-reach, reach)
    )
    keys = [(kx, ky) for ky in range(y_first // n, y_last // n + 1) for kx in range(x_first // n, x_last // n + 1)]
    tiles = [source.load(key) for key in keys if key in source.keys]
    n_levels, ny, nx = max((len(tile.heights) for tile in tiles), default=1), y_last - y_first + 1, x_last - x_first + 1
    heights = np.full((n_levels, ny, nx), np.nan, np.float32)
    for tile in tiles:
        column, row = tile.key[0] * n - x_first, tile.key[1] * n - y_first
        met = tile.heights[:, max(0, -row) : ny - row, max(0, -column) : nx - column]
        heights[: len(met), max(0, row) : row + n, max(0, column) : column + n] = met
    return GroundPatch(heights, (x_first, y_first), edge)
