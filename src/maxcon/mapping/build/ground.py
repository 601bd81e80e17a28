# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The ground grid of a map: of points that are classified as ground, or else of surfaces that may be (decision 17)."""

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.found_classes import FoundClasses
from maxcon.mapping.build.spill import GroundSpill
from maxcon.map import TILE_VOXELS, TileKey, VoxelTile
from maxcon.map.ground import GroundTile, ground_of_points, ground_voxels

__all__ = ["GroundMaker", "ground_among", "level_surfaces"]

# A surface that may be ground is level to within this, and its voxels number at least so many in a cell.
LEVEL = math.cos(math.radians(20.0))
LEAST_VOXELS = 3
# Of these only the ground is not above a slope of so much from any other nearby, m: a car's roof is, a ramp is not.
NEARBY = 3.0
STEEPEST = 0.25
CLEARANCE = 0.3


class GroundMaker:
    """Makes the ground of tiles. First take the surfaces of every tile of voxels, then all `tiles` of ground.

    Parameters
    ----------
    spill : GroundSpill
        Points of ground classes; if there are none, the ground is made of level surfaces.
    cell : float
        Voxel edge, m.
    found : FoundClasses, optional
        Classes that were found: the ground is of these, and not of level surfaces.
    """

    def __init__(self, spill: GroundSpill, cell: float, found: FoundClasses | None = None) -> None:
        self._spill = spill
        self._found = found
        self._cell = cell
        self._surfaces: dict[TileKey, NDArray[np.float32]] = {}

    @property
    def origin(self) -> str:
        """What the ground is made of, in words."""
        if self._found is not None:
            return "found by a morphological filter"
        return "of its classes" if self._spill.n_tiles else "of level surfaces"

    @property
    def needs_surfaces(self) -> bool:
        """Whether the ground is made of level surfaces."""
        return not self._spill.n_tiles and self._found is None

    def take(self, key: TileKey, surfaces: NDArray[np.float32]) -> None:
        """Take the `level_surfaces` of a tile."""
        if np.isfinite(surfaces).any():
            self._surfaces[key] = surfaces

    def tiles(self) -> Iterator[GroundTile]:
        """Yield the ground of all tiles that have some; points are removed as they are read."""
        found = self._found.ground if self._found is not None else []
        made = (self._classified(key) for key in self._spill.keys)
        among = (ground_among(self._surfaces, key, self._cell) for key in sorted(self._surfaces))
        return (tile for tile in chain(found, made, among) if tile.n_heights)

    def _classified(self, key: TileKey) -> GroundTile:
        records = np.concatenate(list(self._spill.records(key)))
        self._spill.remove(key)
        n = TILE_VOXELS // ground_voxels(self._cell)
        return GroundTile(key, ground_of_points(records["column"], records["height"], n))


def level_surfaces(tile: VoxelTile, cell: float) -> NDArray[np.float32]:
    """Height of the lowest level surface in each cell of a tile, shape (n, n), m; NaN where there is none."""
    edge, n = ground_voxels(cell), TILE_VOXELS // ground_voxels(cell)
    is_level = np.abs(tile.normals[:, 2]) >= LEVEL
    if np.count_nonzero(is_level) < LEAST_VOXELS:
        return np.full((n, n), np.nan, np.float32)
    columns = tile.columns[is_level] // edge
    heights = tile.mean_points(cell)[is_level, 2]
    cells = columns[:, 1].astype(np.int64) * n + columns[:, 0]
    order = np.lexsort((heights, cells))
    cells, heights = cells[order], heights[order]
    is_first = (np.diff(cells, prepend=-1) != 0) | (np.diff(heights, prepend=0.0) > CLEARANCE)
    starts = np.flatnonzero(is_first)
    counts = np.diff(starts, append=len(cells))
    is_surface = counts >= LEAST_VOXELS
    places, medians = cells[starts[is_surface]], heights[(starts + (counts - 1) // 2)[is_surface]]
    lowest = np.full(n * n, np.nan, np.float32)
    lowest[places[::-1]] = medians[::-1]  # the lowest of a cell comes first: it is written last
    return lowest.reshape(n, n)


def ground_among(surfaces: Mapping[TileKey, NDArray[np.float32]], key: TileKey, cell: float) -> GroundTile:
    """Ground of a tile among the level surfaces of it and of the tiles around: what nothing nearby lies far below."""
    from scipy.ndimage import grey_erosion

    edge, n = ground_voxels(cell) * cell, TILE_VOXELS // ground_voxels(cell)
    reach = math.ceil(NEARBY / edge)
    distances = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * edge
    around = np.full((3 * n, 3 * n), np.inf)
    for dy, dx in _around():
        heights = surfaces.get((key[0] + dx, key[1] + dy))
        if heights is not None:
            place = (slice((dy + 1) * n, (dy + 2) * n), slice((dx + 1) * n, (dx + 2) * n))
            around[place] = np.where(np.isfinite(heights), heights, np.inf)
    rim = min(reach, n)
    around = around[n - rim : 2 * n + rim, n - rim : 2 * n + rim]
    lowest = grey_erosion(
        around, footprint=distances <= NEARBY, structure=-STEEPEST * distances, mode="constant", cval=np.inf
    )
    is_ground = np.isfinite(around) & (around <= lowest + CLEARANCE)
    heights = np.where(is_ground, around, np.nan)[rim : rim + n, rim : rim + n].astype(np.float32)
    return GroundTile(key, heights[None])


def _around() -> Iterable[tuple[int, int]]:
    """Steps (y, x) to a tile and to those around."""
    return ((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1))
