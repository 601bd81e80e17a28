# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Ground, vegetation and temporary objects, of each voxel, where clouds have no classes (decision 23)."""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.ground_filter import ground_heights, heights_at, lowest_heights
from maxcon.mapping.build.sightings import SightingSpill, block_voxels
from maxcon.mapping.build.surface_shapes import is_vegetation
from maxcon.mapping.build.temporary import HIGHEST, temporary_blocks
from maxcon.mapping.build.voxel_moments import VoxelMoments
from maxcon.mapping.build.voxel_normals import plane_normals
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import GroundTile, ground_of_points, ground_voxels
from maxcon._system.atomic import atomic_file

__all__ = ["FOUND", "LARGEST_CELL", "NEIGHBOUR_VOXELS", "ClassFinder", "FoundClasses", "FoundInTile"]

UNCLASSIFIED, GROUND, TEMPORARY = 1, 2, 22
LOW, MEDIUM, HIGH = 3, 4, 5
"""Codes of ASPRS LAS 1.4; vegetation up to 0.5 m, up to 2 m, and above."""
FOUND = frozenset({GROUND, LOW, MEDIUM, HIGH, TEMPORARY})
VEGETATION_HEIGHTS = (0.5, 2.0)

GROUND_DEPTH = 0.2
"""Above the ground a voxel may be that is of it, m."""
UPRIGHT = 0.5
"""|z| of the normal below which a surface is upright, and no ground: the foot of a wall."""
NEIGHBOUR_VOXELS = 14
"""How many voxels of the tiles around are looked at; fewer than rows are padded by."""
LARGEST_CELL = 0.25
"""Voxel edge up to which shapes can be told, m."""


@dataclass(frozen=True)
class FoundInTile:
    """What was found in one tile; the class of each voxel is kept by `ClassFinder`.

    Parameters
    ----------
    key : tuple of 2 int
        The tile.
    n_points : dict of int to int
        Points of each class.
    n_repeated : int
        Points that stand where several passes saw the ground.
    ground : GroundTile
        The ground that was found.
    keeps_any : bool
        Whether a voxel is of a class that is not left out of the map.
    """

    key: TileKey
    n_points: dict[int, int]
    n_repeated: int
    ground: GroundTile
    keeps_any: bool


class FoundClasses:
    """What was found in all tiles of a map.

    Parameters
    ----------
    has_times : bool
        Whether any point has a time to tell passes apart by.
    drop : frozenset of int
        Classes that are left out of the map.
    """

    def __init__(self, *, has_times: bool, drop: frozenset[int] = frozenset()) -> None:
        self._has_times = has_times
        self._drop = sorted(drop & FOUND)
        self._ground: list[GroundTile] = []
        self._n_points: Counter[int] = Counter()
        self._n_repeated = 0

    def add(self, found: FoundInTile) -> None:
        """Take what was found in a tile."""
        self._n_points.update(found.n_points)
        self._n_repeated += found.n_repeated
        if found.ground.n_heights:
            self._ground.append(found.ground)

    @property
    def ground(self) -> list[GroundTile]:
        """The ground of all tiles that have some, in the order they came in."""
        return self._ground

    def describe(self) -> dict[str, object]:
        """Return the entry `found` of the manifest's `build` (docs/map_format.md)."""
        return {
            "n_points": {str(number): self._n_points[number] for number in sorted(self._n_points)},
            "dropped": self._drop,
            "n_repeated": self._n_repeated,
            "temporary": self._how_temporary(),
        }

    def _how_temporary(self) -> str:
        """Why temporary objects could not be found, in words; empty if they could."""
        if not self._has_times:
            return "the clouds have no times to tell passes apart by"
        return "" if self._n_repeated else "one pass only"


class ClassFinder:
    """Finds the class of every voxel. First `look_at` every tile, then `find` those of any of them.

    What it knows is in files, one of each kind for a tile: several, in processes of their own, can share the work.

    Parameters
    ----------
    folder : Path
        For the lowest heights and the classes of tiles; the caller removes it.
    cell : float
        Voxel edge, m.
    sightings : SightingSpill
        What was seen when; complete.
    drop : frozenset of int
        Classes that are left out of the map.
    """

    def __init__(
        self, folder: Path, cell: float, sightings: SightingSpill, drop: frozenset[int] = frozenset()
    ) -> None:
        self._folder = folder
        self._cell = cell
        self._sightings = sightings
        self._drop = sorted(drop & FOUND)

    def look_at(self, key: TileKey, moments: VoxelMoments) -> None:
        """Take note of the lowest surfaces of a tile; from any thread."""
        _save(self._lowest_path(key), lowest_heights(moments, self._cell))
        self._sightings.gather(key)

    def find(self, key: TileKey, own: VoxelMoments, halo: list[VoxelMoments]) -> FoundInTile:
        """Find and keep the class of each voxel of a tile, given those of the tiles around; from any thread.

        All tiles around have been looked at.

        Parameters
        ----------
        key : tuple of 2 int
            The tile.
        own : VoxelMoments
            Its voxels.
        halo : list of VoxelMoments
            Voxels within `NEIGHBOUR_VOXELS` of it, x and y from the tile's corner.
        """
        moments = VoxelMoments.concatenate([own, *halo])
        x, y = moments.indices[:, 0], moments.indices[:, 1]
        is_own = (x >= 0) & (x < TILE_VOXELS) & (y >= 0) & (y < TILE_VOXELS)
        margin = math.ceil((NEIGHBOUR_VOXELS + 1) / ground_voxels(self._cell)) + 1
        ground = ground_heights(self._lowest, key, self._cell, margin)
        above = self._above(moments, ground, margin)
        is_ground = self._is_ground(moments, above)
        classes = np.full(len(moments), UNCLASSIFIED, np.uint8)
        classes[is_ground] = GROUND
        rest = np.flatnonzero(~is_ground)
        green = rest[is_vegetation(moments.select(~is_ground), self._cell)]
        classes[green] = LOW + np.searchsorted(VEGETATION_HEIGHTS, np.nan_to_num(above[green], nan=np.inf))
        classes, moments, above = classes[is_own], moments.select(is_own), above[is_own]
        is_temporary, n_repeated = self._is_temporary(key, moments, above, ground, margin)
        classes[is_temporary & (classes != GROUND)] = TEMPORARY
        _save(self._path(key), classes)
        return self._summed_up(key, moments, classes, n_repeated)

    def load(self, key: TileKey) -> NDArray[np.uint8]:
        """Return what `find` found."""
        return np.asarray(np.load(self._path(key), allow_pickle=False))

    def is_kept(self, key: TileKey) -> NDArray[np.bool_]:
        """Which voxels of a tile are of a class that is not left out."""
        return ~np.isin(self.load(key), self._drop)

    def _above(self, moments: VoxelMoments, ground: NDArray[np.float64], margin: int) -> NDArray[np.float64]:
        """How far voxels' points lie above the ground, m; NaN where it is not known."""
        edge = ground_voxels(self._cell)
        places = (moments.indices[:, 1::-1] + 0.5) / edge + margin
        heights = moments.indices[:, 2] * self._cell + moments.sums[:, 2] / moments.counts
        above: NDArray[np.float64] = heights - heights_at(ground, places)
        return above

    def _is_ground(self, moments: VoxelMoments, above: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which voxels are near the ground and no part of something upright."""
        is_near = above <= GROUND_DEPTH
        normals = plane_normals(moments, self._cell, is_near)
        is_upright = normals.any(axis=1) & (np.abs(normals[:, 2]) < UPRIGHT)
        ground: NDArray[np.bool_] = is_near & ~is_upright
        return ground

    def _is_temporary(
        self,
        key: TileKey,
        moments: VoxelMoments,
        above: NDArray[np.float64],
        ground: NDArray[np.float64],
        margin: int,
    ) -> tuple[NDArray[np.bool_], int]:
        """Which voxels of a tile are temporary, and how many points stand where several passes saw the ground."""
        edge, n = block_voxels(self._cell), TILE_VOXELS // block_voxels(self._cell)
        rim = min(NEIGHBOUR_VOXELS // edge, n)
        seen = self._seen_around(key, n, rim)
        if not len(seen):
            return np.zeros(len(moments), bool), 0
        side = n + 2 * rim
        middles = (np.mgrid[0:side, 0:side].reshape(2, -1).T + 0.5 - rim) * edge / ground_voxels(
            self._cell
        ) + margin
        heights = heights_at(ground, middles).reshape(side, side)
        first = np.floor(
            (heights + GROUND_DEPTH) / (edge * self._cell)
        )  # of the layer that the ground ends in
        columns = seen["column"].astype(np.int64) + rim
        layers = _steps_above(seen["layer"], first[columns[:, 1], columns[:, 0]])
        n_layers = math.ceil(HIGHEST / (edge * self._cell))
        blocks = temporary_blocks(layers, columns, seen["time"], (n_layers, side, side))
        at = moments.indices.astype(np.int64) // edge
        x, y = at[:, 0] + rim, at[:, 1] + rim
        layer = _steps_above(at[:, 2], first[y, x])
        is_low = (layer >= -1) & (layer < n_layers)
        # What stands on the ground begins in the layer that the ground ends in, of which nothing can be said by itself.
        is_temporary = is_low & blocks.is_temporary[np.where(is_low, np.maximum(layer, 1), 0), y, x]
        is_repeated = is_low & (above > GROUND_DEPTH) & (blocks.n_passes[y, x] > 1)
        return is_temporary, int(moments.counts[is_repeated].sum())

    def _seen_around(self, key: TileKey, n: int, rim: int) -> NDArray[np.void]:
        """Sightings of a tile and of `rim` blocks around it; columns from the tile's corner."""
        parts = []
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                seen = self._sightings.load((key[0] + dx, key[1] + dy))
                x, y = seen["column"][:, 0] + dx * n, seen["column"][:, 1] + dy * n
                is_near = (x >= -rim) & (x < n + rim) & (y >= -rim) & (y < n + rim)
                near = seen[is_near].copy()
                near["column"] = np.column_stack([x[is_near], y[is_near]])
                parts.append(near)
        return np.concatenate(parts)

    def _summed_up(
        self, key: TileKey, moments: VoxelMoments, classes: NDArray[np.uint8], n_repeated: int
    ) -> FoundInTile:
        n_points = np.bincount(classes, moments.counts)
        is_ground = classes == GROUND
        n = TILE_VOXELS // ground_voxels(self._cell)
        columns = moments.indices[is_ground, :2] // ground_voxels(self._cell)
        heights = (
            moments.indices[is_ground, 2] * self._cell + (moments.sums[:, 2] / moments.counts)[is_ground]
        )
        return FoundInTile(
            key,
            {int(number): int(n_points[number]) for number in np.flatnonzero(n_points)},
            n_repeated,
            GroundTile(key, ground_of_points(columns, heights, n)),
            not np.isin(classes, self._drop).all(),
        )

    def _lowest(self, key: TileKey) -> NDArray[np.float64] | None:
        """Lowest heights of a tile that was looked at; None of any other."""
        path = self._lowest_path(key)
        return np.asarray(np.load(path, allow_pickle=False)) if path.exists() else None

    def _lowest_path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.lowest.npy"

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.classes.npy"


def _save(path: Path, values: NDArray[Any]) -> None:
    """Write an array as NPY file, in a step."""
    with atomic_file(path) as partial, partial.open("wb") as file:
        np.save(file, values, allow_pickle=False)


def _steps_above(layers: NDArray[np.integer], first: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many layers above that of the ground; -2 where it is not known."""
    steps: NDArray[np.int64] = np.where(np.isfinite(first), layers - np.nan_to_num(first), -2.0).astype(
        np.int64
    )
    return steps
