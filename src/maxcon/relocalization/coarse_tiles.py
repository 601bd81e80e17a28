# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map in large voxels, each at its height above the ground: scans need no height to be compared with it."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.map import PointMap, TileKey
from maxcon.map.tile import TileCache
from maxcon.relocalization.facings import facings_of_voxels
from maxcon.search.coarse_to_fine import Level

if TYPE_CHECKING:
    from maxcon.map.ground import GroundPatch

__all__ = ["CoarseTile", "CoarseTiles"]

HIGHEST = 30.0
"""Voxels, and points, higher above the ground do not take part, m."""
# A scanner may stand up to so far from known ground, m: a parked truck hides some.
BESIDE_GROUND = 2.0
# Ground up to so far outside a tile is read, m: where there is none, the height of the nearest cell is taken.
GROUND_MARGIN = 16.0
KEPT_BYTES = 2**27
"""Tiles are kept up to this size in all; the ones used longest ago go first."""


@dataclass(frozen=True, slots=True)
class CoarseTile:
    """One tile of the map, flattened: heights are those above the ground.

    Parameters
    ----------
    columns : array, shape (n, 2), int32
        (x, y) index of each voxel, local frame.
    layers : array, shape (n,), int16
        Its height above the ground in voxels.
    facings : array, shape (n,), uint8
        See `facings_of_voxels`.
    is_allowed : array, shape (edge, edge), bool
        Whether a scanner may stand at the middle of cell (y, x) of the tile.
    """

    columns: NDArray[np.int32]
    layers: NDArray[np.int16]
    facings: NDArray[np.uint8]
    is_allowed: NDArray[np.bool_]

    @property
    def n_bytes(self) -> int:
        """Memory it holds."""
        arrays = (self.columns, self.layers, self.facings, self.is_allowed)
        return sum(array.nbytes for array in arrays)


class CoarseTiles:
    """The tiles of a level of a map, flattened when asked for; those used last are kept.

    Parameters
    ----------
    point_map : PointMap
        With ground.
    level : Level
        The voxels to use.

    Raises
    ------
    MapError
        If the map has no ground.
    """

    def __init__(self, point_map: PointMap, level: Level) -> None:
        if not point_map.has_ground:
            raise MapError(
                "Expected a map that knows the height of the ground, to be searched without a prior, got one without."
                " Build it anew of clouds whose ground is classified, or localize with a prior."
            )
        self.map = point_map
        self.level = level.of(point_map)
        self.edge = self.level.tile_voxels
        """Cells along an edge of a tile."""
        self.cell = self.level.cell
        """Edge of a voxel, and of a cell, m."""
        self.n_layers = int(np.ceil(HIGHEST / self.cell))
        self._kept: TileCache[CoarseTile] = TileCache(KEPT_BYTES)

    @cached_property
    def keys(self) -> frozenset[TileKey]:
        """Keys of all tiles and of their neighbours: where there is nothing but ground the map has no tile."""
        around = {(x + i, y + j) for x, y in self.map.tile_keys for i in (-1, 0, 1) for j in (-1, 0, 1)}
        return frozenset(around)

    def load(self, key: TileKey) -> CoarseTile:
        """Return the tile of a key."""
        return self._kept.load(key, lambda: self._flattened(key))

    def _flattened(self, key: TileKey) -> CoarseTile:
        half = 0.5 * self.edge * self.cell
        middle = (2 * key[0] + 1) * half, (2 * key[1] + 1) * half
        patch = self.map.ground_around(*middle, half + GROUND_MARGIN)
        heights, distances = _filled(patch)
        cells = np.arange(self.edge) + 0.5
        x, y = (key[0] * self.edge + cells) * self.cell, (key[1] * self.edge + cells) * self.cell
        rows, columns = _places(patch, x[None, :], y[:, None])
        is_allowed = distances[rows, columns] <= BESIDE_GROUND
        if key not in self.map.tile_keys:
            nothing = np.empty(0, np.uint8)
            return CoarseTile(np.empty((0, 2), np.int32), nothing.astype(np.int16), nothing, is_allowed)
        tile = self.level.tile(key)
        points = tile.mean_points(self.cell)
        above = points[:, 2] - heights[_places(patch, points[:, 0], points[:, 1])]
        layers = np.floor(above / self.cell)
        takes_part = (layers >= 0) & (layers < self.n_layers)
        return CoarseTile(
            tile.voxels[takes_part, :2],
            layers[takes_part].astype(np.int16),
            facings_of_voxels(tile.normals, is_signed=self.map.is_signed)[takes_part],
            is_allowed,
        )


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


def _places(
    patch: "GroundPatch", x: NDArray[np.floating], y: NDArray[np.floating]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of a patch of ground that places lie in, or the nearest."""
    _, ny, nx = patch.heights.shape
    rows = np.clip(np.floor(y / patch.edge).astype(np.int64) - patch.first[1], 0, ny - 1)
    columns = np.clip(np.floor(x / patch.edge).astype(np.int64) - patch.first[0], 0, nx - 1)
    return rows, columns
