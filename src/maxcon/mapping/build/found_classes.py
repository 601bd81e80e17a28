# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Classes found by the build where clouds have none: ground, vegetation and temporary objects of each voxel.

A pass of the mapping vehicle that saw the ground under a block of space looked through the block, from wherever it was:
what another pass saw in it was temporary. Nothing is said of places that were seen in one pass only.
"""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import GroundTile, ground_of_points, ground_voxels
from maxcon.mapping.build.bucketing import TileArrays, TileBuckets
from maxcon.mapping.build.classes import FOUND
from maxcon.mapping.build.ground import ground_heights, heights_at, lowest_heights
from maxcon.mapping.build.map_sigma import LEAST_PAUSE
from maxcon.mapping.build.voxel_moments import VoxelMoments, is_vegetation, plane_normals

UNCLASSIFIED, GROUND, LOW_VEGETATION, TEMPORARY = 1, 2, 3, 22
"""Codes of ASPRS LAS 1.4; behind low vegetation come medium and high."""
VEGETATION_HEIGHTS = (0.5, 2.0)
"""Up to these heights above the ground vegetation is low and medium, m."""
GROUND_DEPTH = 0.2
"""Largest height of a voxel of the ground above it, m."""
UPRIGHT = 0.5
"""|z| of the normal below which a surface is upright, and no ground: the foot of a wall."""
NEIGHBOUR_VOXELS = 14
"""Margin of voxels of the tiles around that is looked at; less than the padding of rows."""

BLOCK_EDGE = 0.25
"""The edge of a block is a power of two of voxels, the nearest to this, m."""
STRETCH = 5.0
"""s; within it a block is noted once. A fraction of the pause between two passes."""
OBSERVATION = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("time", "<f8")])
"""A stretch of time in which points lay in a block: its column in the tile, its layer, and when it began (s)."""

HIGHEST = 4.0
"""Above the ground, m: higher up is no car, and the ground is seen past what hangs over it."""
LEAST_SEEN = 5
"""Of nine columns around a block, fewest in which a pass saw the ground where it looked through."""
LEAST_GONE = 3
"""Fewest blocks within cubes of `AROUND` in which a pass saw nothing where others did."""
GONE_RATIO = 0.8
"""Smallest ratio of these to all blocks there that the pass looked through or saw."""
AROUND = 5
"""Blocks: 1.2 m."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundInTile:
    """Classes found in one tile: points of each class, points where several passes saw the ground, and the ground."""

    key: TileKey
    n_points: dict[int, int]
    n_repeated: int
    ground: GroundTile
    keeps_any: bool


class FoundClasses:
    """Sum of the classes found in all tiles of a map.

    `has_times`: whether any point has a time to tell passes apart by; `drop`: classes that are left out of the map.
    """

    def __init__(self, *, has_times: bool, drop: frozenset[int] = frozenset()) -> None:
        self._has_times = has_times
        self._drop = sorted(drop & FOUND)
        self._n_points: Counter[int] = Counter()
        self._n_repeated = 0
        self.ground: list[GroundTile] = []

    def add(self, found: FoundInTile) -> None:
        """Add the classes found in a tile."""
        self._n_points.update(found.n_points)
        self._n_repeated += found.n_repeated
        self.ground.append(found.ground)

    def describe(self) -> dict[str, object]:
        """Return the entry `found` of the manifest's `build` (docs/map_format.md)."""
        reason = "" if self._n_repeated else "one pass only"
        return {
            "n_points": {str(number): self._n_points[number] for number in sorted(self._n_points)},
            "dropped": self._drop,
            "n_repeated": self._n_repeated,
            "temporary": reason if self._has_times else "the clouds have no times to tell passes apart by",
        }


class ClassFinder:
    """Finds the class of every voxel: first `prepare` every tile, then `find` in any of them, from any thread.

    `arrays`: keeps the lowest heights and the classes of tiles; `cell`: voxel edge, m; `drop`: classes that are left
    out of the map.
    """

    def __init__(
        self, arrays: TileArrays, cell: float, observations: TileBuckets, drop: frozenset[int] = frozenset()
    ) -> None:
        self._arrays = arrays
        self._cell = cell
        self._observations = observations
        self._drop = sorted(drop & FOUND)

    def prepare(self, key: TileKey, moments: VoxelMoments) -> None:
        """Keep the lowest surfaces of a tile, and each of its observations once."""
        self._arrays.put(key, "lowest", heights=lowest_heights(moments, self._cell))
        if self._observations.has(key):
            records = self._observations.load(key)
            blocks = np.column_stack([records["column"], records["layer"]])
            self._observations.replace(key, records[_first_of_each(blocks, records["time"])])

    def find(self, key: TileKey, own: VoxelMoments, halo: list[VoxelMoments]) -> FoundInTile:
        """Find and keep the class of each voxel of a tile; all tiles around have been prepared.

        `key`: the tile; `own`: its voxels; `halo`: voxels within `NEIGHBOUR_VOXELS` of it, x and y from the tile's
        corner.
        """
        moments = VoxelMoments.concatenate([own, *halo])
        margin = math.ceil((NEIGHBOUR_VOXELS + 1) / ground_voxels(self._cell)) + 1
        ground = ground_heights(self._lowest, key, self._cell, margin)
        places = (moments.indices[:, 1::-1] + 0.5) / ground_voxels(self._cell) + margin
        above = moments.mean_heights(self._cell) - heights_at(ground, places)  # NaN where the ground is not known
        is_ground = self._is_ground(moments, above)
        classes = np.full(len(moments), UNCLASSIFIED, np.uint8)
        classes[is_ground] = GROUND
        rest = np.flatnonzero(~is_ground)
        green = rest[is_vegetation(moments.select(~is_ground), self._cell)]
        height = np.nan_to_num(above[green], nan=np.inf)
        classes[green] = LOW_VEGETATION + np.searchsorted(VEGETATION_HEIGHTS, height)
        is_own = moments.is_own
        classes, moments, above = classes[is_own], moments.select(is_own), above[is_own]
        is_temporary, n_repeated = self._is_temporary(key, moments, above, ground, margin)
        classes[is_temporary & (classes != GROUND)] = TEMPORARY
        self._arrays.put(key, "classes", classes=classes)
        return self._summed_up(key, moments, classes, n_repeated)

    def classes(self, key: TileKey) -> NDArray[np.uint8]:
        """Return the class of each voxel of a tile, as `find` found it."""
        return self._arrays.get(key, "classes")["classes"]

    def is_kept(self, key: TileKey) -> NDArray[np.bool_]:
        """Which voxels of a tile are of a class that is not left out."""
        return ~np.isin(self.classes(key), self._drop)

    def _lowest(self, key: TileKey) -> NDArray[np.float64] | None:
        return self._arrays.get(key, "lowest")["heights"] if self._arrays.has(key, "lowest") else None

    def _is_ground(self, moments: VoxelMoments, above: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which voxels are near the ground and no part of something upright."""
        is_near = above <= GROUND_DEPTH
        normals = plane_normals(moments, self._cell, is_near)
        is_upright = normals.any(axis=1) & (np.abs(normals[:, 2]) < UPRIGHT)
        return is_near & ~is_upright

    def _is_temporary(
        self, key: TileKey, moments: VoxelMoments, above: NDArray[np.float64], ground: NDArray[np.float64], margin: int
    ) -> tuple[NDArray[np.bool_], int]:
        """Which voxels of a tile are temporary, and how many points lie where several passes saw the ground."""
        edge = block_voxels(self._cell)
        n = TILE_VOXELS // edge
        halo = min(NEIGHBOUR_VOXELS // edge, n)
        seen = self._observations_around(key, n, halo)
        if not len(seen):
            return np.zeros(len(moments), bool), 0
        side = n + 2 * halo
        middles = (np.mgrid[0:side, 0:side].reshape(2, -1).T + 0.5 - halo) * edge / ground_voxels(self._cell) + margin
        heights = heights_at(ground, middles).reshape(side, side)
        first = np.floor((heights + GROUND_DEPTH) / (edge * self._cell))  # layer in which the ground ends
        columns = seen["column"].astype(np.int64) + halo
        layers = _steps_above(seen["layer"], first[columns[:, 1], columns[:, 0]])
        n_layers = math.ceil(HIGHEST / (edge * self._cell))
        is_block_temporary, n_passes = temporary_blocks(layers, columns, seen["time"], (n_layers, side, side))
        blocks = moments.indices.astype(np.int64) // edge
        x, y = blocks[:, 0] + halo, blocks[:, 1] + halo
        layer = _steps_above(blocks[:, 2], first[y, x])
        is_low = (layer >= -1) & (layer < n_layers)
        # An object on the ground begins in the layer in which the ground ends, of which nothing is known by itself.
        is_temporary = is_low & is_block_temporary[np.where(is_low, np.maximum(layer, 1), 0), y, x]
        is_repeated = is_low & (above > GROUND_DEPTH) & (n_passes[y, x] > 1)
        return is_temporary, int(moments.counts[is_repeated].sum())

    def _observations_around(self, key: TileKey, n: int, halo: int) -> NDArray[np.void]:
        """Observations of a tile and of `halo` blocks around it; columns from the tile's corner."""
        parts = []
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                seen = self._observations.load((key[0] + dx, key[1] + dy))
                columns = seen["column"] + np.array([dx * n, dy * n], np.int16)
                is_near = ((columns >= -halo) & (columns < n + halo)).all(axis=1)
                near = seen[is_near]
                near["column"] = columns[is_near]
                parts.append(near)
        return np.concatenate(parts)

    def _summed_up(
        self, key: TileKey, moments: VoxelMoments, classes: NDArray[np.uint8], n_repeated: int
    ) -> FoundInTile:
        n_points = np.bincount(classes, moments.counts)
        is_ground = classes == GROUND
        edge = ground_voxels(self._cell)
        columns, heights = moments.indices[is_ground, :2] // edge, moments.mean_heights(self._cell)[is_ground]
        return FoundInTile(
            key,
            {int(number): int(n_points[number]) for number in np.flatnonzero(n_points)},
            n_repeated,
            GroundTile(key, ground_of_points(columns, heights, TILE_VOXELS // edge)),
            not np.isin(classes, self._drop).all(),
        )


def _steps_above(layers: NDArray[np.integer], first: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many layers above that of the ground; -2 where it is not known."""
    return np.where(np.isfinite(first), layers - np.nan_to_num(first), -2.0).astype(np.int64)


def block_voxels(cell: float) -> int:
    """How many voxels of edge `cell` (m) make the edge of a block; 4 at 6 cm."""
    power = round(math.log2(BLOCK_EDGE / cell))
    return int(2 ** min(max(power, 0), TILE_VOXELS.bit_length() - 1))


def observation_records(
    points: NDArray[np.float64], times: NDArray[np.float64], cell: float
) -> tuple[NDArray[np.int32], NDArray[np.void]]:
    """Tiles, shape (k, 2), and records (`OBSERVATION`) of the blocks that points lay in, each once.

    `points` (n, 3): local frame, m; `times` (n,): s; points without a finite one are left out.
    """
    is_timed = np.isfinite(times)
    edge = block_voxels(cell)
    n = TILE_VOXELS // edge
    blocks, stretches = voxel_indices(points[is_timed], cell) // edge, np.floor(times[is_timed] / STRETCH)
    first = _first_of_each(blocks, stretches)
    blocks = blocks[first]
    keys = blocks[:, :2] // n
    records = np.empty(len(blocks), OBSERVATION)
    records["column"] = blocks[:, :2] - keys * n
    records["layer"] = blocks[:, 2]
    records["time"] = stretches[first] * STRETCH
    return keys, records


def _first_of_each(blocks: NDArray[np.integer], times: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rows of different (x, y, z) of blocks, shape (n, 3), and times: the first of each."""
    columns = (*blocks.T, times)
    order = np.lexsort(columns)
    is_new = np.ones(len(order), bool)
    is_new[1:] = np.logical_or.reduce([np.diff(values[order]) != 0 for values in columns])
    return order[is_new]


def pass_of(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the passes that stretches of time belong to, from 0 on; times (s) in any order."""
    ticks, tick_of = np.unique(times, return_inverse=True)
    numbers = np.cumsum(np.diff(ticks, prepend=ticks[:1]) > LEAST_PAUSE + STRETCH)
    return np.asarray(numbers[tick_of], np.int64)


def temporary_blocks(
    layers: NDArray[np.int64], columns: NDArray[np.int64], times: NDArray[np.float64], shape: tuple[int, int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Find what is temporary among blocks that were observed.

    `layers` (n,): of each observation, from that in which the ground ends on: -1 (also ground), 0, 1, ...;
    `columns` (n, 2): (x, y) of each; `times` (n,): s; `shape`: how many layers, and columns along y and x. Observations
    elsewhere are left out.

    Returns is_temporary: shape (layers, ny, nx), bool; whether what is in a block is temporary; nothing is said of
        layer 0, in which the ground ends.
    Returns n_passes: shape (ny, nx), int64; passes that saw the ground of a column.
    """
    from scipy.ndimage import maximum_filter, uniform_filter

    def count(flags: NDArray[np.bool_], size: int) -> NDArray[np.float64]:
        return np.asarray(uniform_filter(flags.astype(np.float64), size=size, mode="constant") * size**flags.ndim)

    n_layers, ny, nx = shape
    passes = pass_of(times)
    x, y = columns.T
    is_inside = (layers >= -1) & (layers < n_layers) & (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    layers, x, y, passes = np.maximum(layers[is_inside], 0), x[is_inside], y[is_inside], passes[is_inside]
    is_seen = np.zeros((int(passes.max(initial=-1)) + 1, n_layers, ny, nx), bool)
    is_seen[passes, layers, y, x] = True
    sees_ground = is_seen[:, 0].copy()
    is_seen[:, 0] = False
    is_occupied = is_seen.any(axis=0)
    is_gone = np.zeros(is_occupied.shape, bool)
    for seen, ground in zip(is_seen, sees_ground, strict=True):
        if not ground.any() or not (is_occupied & ~seen).any():
            continue
        looks_through = ground & (count(ground, 3) > LEAST_SEEN - 0.5)
        is_there = maximum_filter(seen, size=3, mode="constant", cval=False)
        n_gone = count(is_occupied & looks_through & ~is_there, AROUND)
        n_there = count(is_occupied & is_there, AROUND)
        is_gone |= (n_gone > LEAST_GONE - 0.5) & (n_gone >= GONE_RATIO * (n_gone + n_there) - 1e-6)
    return is_gone & is_occupied, sees_ground.sum(axis=0)
