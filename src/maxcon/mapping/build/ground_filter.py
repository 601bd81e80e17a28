# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Ground among unclassified surfaces: a simple morphological filter (SMRF) on the lowest heights (decision 23).

The filter of Pingel, Clarke and McBride (ISPRS Journal 77, 2013): what an opening with growing windows takes off the
lowest surface by more than a slope explains is an object; the ground is laid through what is left. Everything looks at
most `REACH` far, so that tiles can be made one by one.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.voxel_moments import VoxelMoments
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import ground_voxels

__all__ = ["ground_heights", "heights_at", "lowest_heights"]

LEAST_VOXELS = 3
"""A cell's lowest surface has so many voxels within `SURFACE_DEPTH`: a stray point is none."""
SURFACE_DEPTH = 0.3
"""m."""
LOWEST_PIT = 1.0
"""What lies so far below all around it is no ground: a reflection in a puddle, m."""
WIDEST_WINDOW = 14.0
"""Half width of the widest window, m: buildings up to twice as wide are taken off."""
SLOPE = 0.2
"""Of the ground at most, unless it is as wide as the windows."""
STEP = 0.15
"""m; kerbs are no objects, and noise is not."""
FILLS = (1, 2, 4, 8, 12)
"""Half widths, in cells, of the squares whose mean fills a hole in the ground, the first that has any."""
REACH = 2.0 * WIDEST_WINDOW
"""How far the filter looks; filling looks no farther than the rest of a tile's edge."""

LowestOf = Callable[[TileKey], NDArray[np.float64] | None]
"""Gives the `lowest_heights` of a tile; None where there is no tile."""


def lowest_heights(moments: VoxelMoments, cell: float) -> NDArray[np.float64]:
    """Height of the lowest surface in each cell (y, x) of a tile's ground grid, m; NaN where there is none."""
    edge, n = ground_voxels(cell), TILE_VOXELS // ground_voxels(cell)
    places = (moments.indices[:, 1] // edge).astype(np.int64) * n + moments.indices[:, 0] // edge
    heights = moments.indices[:, 2] * cell + moments.sums[:, 2] / moments.counts
    order = np.lexsort((heights, places))
    places, heights = places[order], heights[order]
    least = min(LEAST_VOXELS, edge * edge)
    is_surface = np.zeros(len(places), bool)
    last = len(places) - least + 1
    if last > 0:
        is_surface[:last] = (places[least - 1 :] == places[:last]) & (
            heights[least - 1 :] - heights[:last] <= SURFACE_DEPTH
        )
    lowest = np.full(n * n, np.nan)
    lowest[places[is_surface][::-1]] = heights[is_surface][
        ::-1
    ]  # a cell's lowest comes first: it is written last
    return lowest.reshape(n, n)


def ground_heights(lowest: LowestOf, key: TileKey, cell: float, margin: int) -> NDArray[np.float64]:
    """Height of the ground in the cells of a tile and `margin` cells around it, m; NaN where nothing is near.

    Parameters
    ----------
    lowest : callable
        `lowest_heights` of the tile and of all those within `REACH`, local frame.
    key : tuple of 2 int
        The tile.
    cell : float
        Voxel edge, m.
    margin : int
        Cells.
    """
    edge, n = ground_voxels(cell) * cell, TILE_VOXELS // ground_voxels(cell)
    reach = math.ceil(REACH / edge) + max(FILLS) + 1 + margin
    around = _around(lowest, key, n, reach)
    around = np.where(_is_pit(around), np.nan, around)
    ground = _filled(np.where(_is_object(around, edge), np.nan, around))
    inner = slice(reach - margin, reach + n + margin)
    return ground[inner, inner]


def heights_at(ground: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate heights between the middles of cells at places (y, x), shape (k, 2), counted in cells."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(ground, rows.T - 0.5, order=1, mode="nearest"), np.float64)


def _around(lowest: LowestOf, key: TileKey, n: int, reach: int) -> NDArray[np.float64]:
    """Lowest heights of a tile and `reach` cells around it."""
    tiles = math.ceil(reach / n)
    whole = np.full(((2 * tiles + 1) * n,) * 2, np.nan)
    for dy in range(-tiles, tiles + 1):
        for dx in range(-tiles, tiles + 1):
            heights = lowest((key[0] + dx, key[1] + dy))
            if heights is not None:
                y, x = (dy + tiles) * n, (dx + tiles) * n
                whole[y : y + n, x : x + n] = heights
    inner = slice(tiles * n - reach, (tiles + 1) * n + reach)
    return whole[inner, inner]


def _is_pit(heights: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which cells lie far below all those around them."""
    from scipy.ndimage import maximum_filter, minimum_filter

    high = maximum_filter(np.nan_to_num(heights, nan=-np.inf), size=3, mode="nearest")
    closed = minimum_filter(np.where(np.isfinite(high), high, np.inf), size=3, mode="nearest")
    pit: NDArray[np.bool_] = closed - heights > LOWEST_PIT
    return pit


def _is_object(heights: NDArray[np.float64], edge: float) -> NDArray[np.bool_]:
    """Which cells an opening with growing windows takes off by more than a slope explains.

    Squares are openings of each other: each may be made of the heights themselves, and none looks farther than its
    own window. Cells without a height count nowhere.
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    is_known = np.isfinite(heights)
    high = np.where(is_known, heights, np.inf)
    before, is_object = high, np.zeros(heights.shape, bool)
    for radius in _radii(math.ceil(WIDEST_WINDOW / edge)):
        low = minimum_filter(high, size=2 * radius + 1, mode="constant", cval=np.inf)
        low[~_is_near(is_known, radius)] = -np.inf
        opened = maximum_filter(low, size=2 * radius + 1, mode="constant", cval=-np.inf)
        with np.errstate(invalid="ignore"):
            is_object |= is_known & (before - opened > STEP + SLOPE * radius * edge)
        before = opened
    return is_object


def _is_near(is_known: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """Which cells have a known one within a window."""
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(is_known, size=2 * radius + 1, mode="constant", cval=False), bool)


def _radii(largest: int) -> list[int]:
    """Half widths of the windows, in cells: one by one, then in steps of a third."""
    radii = [1]
    while radii[-1] < largest:
        radii.append(min(largest, max(radii[-1] + 1, radii[-1] * 4 // 3)))
    return radii


def _filled(ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fill cells without ground with the mean of the nearest square that has some."""
    from scipy.ndimage import uniform_filter

    is_known = np.isfinite(ground)
    base = float(ground[is_known].min()) if is_known.any() else 0.0
    values, weights = np.where(is_known, ground - base, 0.0), is_known.astype(np.float64)
    filled = np.where(is_known, ground, np.nan)
    for half in FILLS:
        size = 2 * half + 1
        shares = uniform_filter(weights, size=size, mode="constant") * size**2
        means = uniform_filter(values, size=size, mode="constant") * size**2
        is_open = np.isnan(filled) & (shares > 0.5)
        filled[is_open] = base + means[is_open] / shares[is_open]
    return filled
