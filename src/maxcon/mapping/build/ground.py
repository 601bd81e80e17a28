"""Ground of a tile where points are not classified: lowest level surfaces, or a simple morphological filter (SMRF).

The filter of Pingel, Clarke and McBride (ISPRS Journal 77, 2013): what an opening with growing windows removes from the
lowest surface by more than a slope explains is an object; the ground is interpolated through what is left. It looks at
most `REACH` far, so that tiles can be made one by one.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey, VoxelTile
from maxcon.map.ground import GroundTile, ground_voxels, levels_of_points
from maxcon.mapping.build.tile_points import VoxelMoments

LEAST_VOXELS = 3  # fewest voxels of a surface in a cell of the ground grid: a stray point is none
SURFACE_DEPTH = 0.3  # m, largest height difference between these voxels, and between a level surface and the next

LEVEL = math.cos(math.radians(20.0))  # smallest |z| of the normals of a level surface
NEARBY = 3.0  # m, radius in which level surfaces are compared
STEEPEST = 0.25  # slope of the ground: what rises faster above another surface, as a car's roof, is none; a ramp is

LOWEST_PIT = 1.0  # m: a cell so far below all around it is no ground, but a reflection in a puddle
LARGEST_WINDOW = 14.0  # m, half width of the largest window: buildings up to twice as wide are removed
SLOPE = 0.2  # largest slope of the ground, unless it is as wide as the windows
STEP = 0.15  # m; kerbs are no objects, and noise is not
# Half widths, in cells, of the squares whose mean fills a hole in the ground: the first that has any ground.
FILLS = (1, 2, 4, 8, 12)
REACH = 2.0 * LARGEST_WINDOW  # m: how far the filter looks; filling looks no farther than the rest of a tile's edge

# One point on the ground: its cell of the ground grid, and its height in the local frame (m).
GROUND_POINT = np.dtype([("column", "<i2", 2), ("height", "<f4")])
# Gives heights (y, x) of a tile's cells; None where there is no tile.
HeightsOf = Callable[[TileKey], NDArray[np.floating] | None]


def ground_records(points: NDArray[np.float64], cell: float) -> tuple[NDArray[np.int32], NDArray[np.void]]:
    """Tiles, shape (n, 2), and records (`GROUND_POINT`) of points on the ground, shape (n, 3), local frame, m."""
    columns = voxel_indices(points, cell)[:, :2]
    keys = columns // TILE_VOXELS
    records = np.empty(len(points), GROUND_POINT)
    records["column"] = (columns - keys * TILE_VOXELS) // ground_voxels(cell)
    records["height"] = points[:, 2]
    return keys, records


def level_surfaces(tile: VoxelTile, cell: float) -> NDArray[np.float32]:
    """Height of the lowest level surface in each cell of a tile, shape (n, n), m; NaN where there is none."""
    edge, n = ground_voxels(cell), TILE_VOXELS // ground_voxels(cell)
    is_level = np.abs(tile.normals[:, 2]) >= LEVEL
    columns, heights = tile.columns[is_level] // edge, tile.mean_points(cell)[is_level, 2]
    cells, medians, counts = levels_of_points(columns, heights, n, SURFACE_DEPTH)
    is_surface = counts >= LEAST_VOXELS
    lowest = np.full(n * n, np.nan, np.float32)
    lowest[cells[is_surface][::-1]] = medians[is_surface][::-1]  # the lowest of a cell comes first: it is written last
    return lowest.reshape(n, n)


def ground_among(surfaces: Mapping[TileKey, NDArray[np.float32]], key: TileKey, cell: float) -> GroundTile:
    """Ground of a tile among the level surfaces of it and of the tiles around: those not far above another nearby."""
    from scipy.ndimage import grey_erosion

    edge, n = ground_voxels(cell) * cell, TILE_VOXELS // ground_voxels(cell)
    reach = math.ceil(NEARBY / edge)
    distances = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * edge
    margin = min(reach, n)
    around = _around(surfaces.get, key, n, margin)
    around = np.where(np.isfinite(around), around, np.inf)
    lowest = grey_erosion(
        around, footprint=distances <= NEARBY, structure=-STEEPEST * distances, mode="constant", cval=np.inf
    )
    is_ground = np.isfinite(around) & (around <= lowest + SURFACE_DEPTH)
    inner = slice(margin, margin + n)
    return GroundTile(key, np.where(is_ground, around, np.nan)[inner, inner].astype(np.float32)[None])


def lowest_heights(moments: VoxelMoments, cell: float) -> NDArray[np.float64]:
    """Height of the lowest surface in each cell (y, x) of a tile's ground grid, m; NaN where there is none."""
    edge, n = ground_voxels(cell), TILE_VOXELS // ground_voxels(cell)
    places = (moments.indices[:, 1] // edge).astype(np.int64) * n + moments.indices[:, 0] // edge
    heights = moments.mean_heights(cell)
    order = np.lexsort((heights, places))
    places, heights = places[order], heights[order]
    least = min(LEAST_VOXELS, edge * edge)
    end = max(0, len(places) - least + 1)  # from there on a cell has too few voxels above
    is_surface = (places[least - 1 :] == places[:end]) & (heights[least - 1 :] - heights[:end] <= SURFACE_DEPTH)
    lowest = np.full(n * n, np.nan)
    lowest[places[:end][is_surface][::-1]] = heights[:end][is_surface][::-1]  # the lowest is written last
    return lowest.reshape(n, n)


def ground_heights(lowest: HeightsOf, key: TileKey, cell: float, margin: int) -> NDArray[np.float64]:
    """Height of the ground in the cells of a tile and `margin` cells around it, m; NaN where nothing is near."""
    from scipy.ndimage import maximum_filter, minimum_filter

    edge, n = ground_voxels(cell) * cell, TILE_VOXELS // ground_voxels(cell)
    reach = math.ceil(REACH / edge) + max(FILLS) + 1 + margin
    around = _around(lowest, key, n, reach)
    high = maximum_filter(np.nan_to_num(around, nan=-np.inf), size=3, mode="nearest")
    closed = minimum_filter(np.where(np.isfinite(high), high, np.inf), size=3, mode="nearest")
    around = np.where(closed - around > LOWEST_PIT, np.nan, around)
    inner = slice(reach - margin, reach + n + margin)
    return _filled(np.where(_is_object(around, edge), np.nan, around))[inner, inner]


def heights_at(ground: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate heights between the middles of cells at places (y, x), shape (k, 2), counted in cells."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(ground, rows.T - 0.5, order=1, mode="nearest"), np.float64)


def _around(heights_of: HeightsOf, key: TileKey, n: int, reach: int) -> NDArray[np.float64]:
    """Heights of a tile of (n, n) cells and `reach` cells around it."""
    tiles = math.ceil(reach / n)
    whole = np.full(((2 * tiles + 1) * n,) * 2, np.nan)
    for dy in range(-tiles, tiles + 1):
        for dx in range(-tiles, tiles + 1):
            heights = heights_of((key[0] + dx, key[1] + dy))
            if heights is not None:
                y, x = (dy + tiles) * n, (dx + tiles) * n
                whole[y : y + n, x : x + n] = heights
    inner = slice(tiles * n - reach, (tiles + 1) * n + reach)
    return whole[inner, inner]


def _is_object(heights: NDArray[np.float64], edge: float) -> NDArray[np.bool_]:
    """Which cells an opening with growing windows removes by more than a slope explains."""
    # Squares are openings of each other: each may be made of the heights themselves, none looks beyond its window.
    from scipy.ndimage import maximum_filter, minimum_filter

    is_known = np.isfinite(heights)
    high = np.where(is_known, heights, np.inf)
    before, is_object = high, np.zeros(heights.shape, bool)
    radius, largest = 0, max(1, math.ceil(LARGEST_WINDOW / edge))
    while radius < largest:  # one by one, then in steps of a third
        radius = min(largest, max(radius + 1, radius * 4 // 3))
        size = 2 * radius + 1
        low = minimum_filter(high, size=size, mode="constant", cval=np.inf)
        low[~maximum_filter(is_known, size=size, mode="constant", cval=False)] = -np.inf
        opened = maximum_filter(low, size=size, mode="constant", cval=-np.inf)
        with np.errstate(invalid="ignore"):
            is_object |= is_known & (before - opened > STEP + SLOPE * radius * edge)
        before = opened
    return is_object


def _filled(ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fill cells without ground with the mean of the nearest square that has some."""
    from scipy.ndimage import uniform_filter

    is_known = np.isfinite(ground)
    base = float(ground[is_known].min()) if is_known.any() else 0.0
    values, weights = np.where(is_known, ground - base, 0.0), is_known.astype(np.float64)
    filled = np.where(is_known, ground, np.nan)
    for half in FILLS:
        size = 2 * half + 1
        known, means = (uniform_filter(each, size=size, mode="constant") * size**2 for each in (weights, values))
        is_open = np.isnan(filled) & (known > 0.5)
        filled[is_open] = base + means[is_open] / known[is_open]
    return filled
