"""Classes found by the build where clouds have none: ground, vegetation and temporary objects of each voxel.

A pass of the mapping vehicle that saw the ground under a block of space looked through the block, from wherever it was:
what another pass saw in it was temporary. Nothing is said of places that were seen in one pass only.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import GroundTile, ground_of_points, ground_voxels
from maxcon.map.voxelize import first_of_each
from maxcon.mapping.build.ground import HeightsOf, ground_heights, heights_at
from maxcon.mapping.build.point_statistics import LEAST_PAUSE
from maxcon.mapping.build.tile_points import VoxelMoments, is_vegetation, plane_normals

UNCLASSIFIED, GROUND, LOW_VEGETATION, TEMPORARY = 1, 2, 3, 22  # behind low vegetation come medium and high
VEGETATION_HEIGHTS = (0.5, 2.0)  # m above the ground: up to these vegetation is low and medium
GROUND_DEPTH = 0.2  # m, largest height of a voxel of the ground above it
UPRIGHT = 0.5  # |z| of the normal below which a surface is upright, and no ground: the foot of a wall
NEIGHBOUR_VOXELS = 14  # margin of the tiles around that is looked at; less than the padding of rows

BLOCK_EDGE = 0.25  # m; the edge of a block is a power of two of voxels, the nearest to this
STRETCH = 5.0  # s; within it a block is noted once. A fraction of the pause between two passes
# A stretch of time in which points lay in a block: its column in the tile, its layer, and when it began (s).
OBSERVATION = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("time", "<f8")])

HIGHEST = 4.0  # m above the ground: higher up is no car, and the ground is seen past what hangs over it
LEAST_SEEN = 5  # of nine columns around a block, fewest in which a pass saw the ground where it looked through
LEAST_GONE = 3  # fewest blocks within cubes of `AROUND` in which a pass saw nothing where others did
GONE_RATIO = 0.8  # smallest ratio of these to all blocks there that the pass looked through or saw
AROUND = 5  # blocks: 1.2 m

# Gives the observations (`OBSERVATION`) in a tile; None where there is no tile.
ObservedIn = Callable[[TileKey], NDArray[np.void] | None]


class FoundInTile(NamedTuple):
    """Classes found in one tile."""

    n_points: dict[int, int]  # Points of each class
    n_repeated: int  # Points where several passes saw the ground
    ground: GroundTile
    keeps_any: bool  # Whether any voxel is for the map


def describe_found(found: Sequence[FoundInTile], drop: frozenset[int], *, has_times: bool) -> dict[str, object]:
    """Return the entry `found` of the manifest's `build` (docs/map_format.md)."""
    n_points = sum((Counter(each.n_points) for each in found), Counter[int]())
    n_repeated = sum(each.n_repeated for each in found)
    reason = "" if n_repeated else "one pass only"
    return {
        "n_points": {str(number): n_points[number] for number in sorted(n_points)},
        "dropped": sorted(drop),
        "n_repeated": n_repeated,
        "temporary": reason if has_times else "the clouds have no times to tell passes apart by",
    }


def found_in_tile(
    own: VoxelMoments, halo: Sequence[VoxelMoments], lowest: HeightsOf, observed: ObservedIn, key: TileKey,
    cell: float, drop: frozenset[int],
) -> tuple[NDArray[np.uint8], FoundInTile]:  # fmt: skip
    """Find the class of each voxel of a tile, given those within `NEIGHBOUR_VOXELS` of it, x and y from its corner."""
    moments, edge = VoxelMoments.concatenate([own, *halo]), ground_voxels(cell)
    margin = math.ceil((NEIGHBOUR_VOXELS + 1) / edge) + 1
    ground = ground_heights(lowest, key, cell, margin)
    above = moments.mean_heights(cell) - heights_at(ground, (moments.indices[:, 1::-1] + 0.5) / edge + margin)
    is_near = above <= GROUND_DEPTH  # above is NaN where the ground is not known
    normals = plane_normals(moments, cell, is_near)
    is_ground = is_near & ~(normals.any(axis=1) & (np.abs(normals[:, 2]) < UPRIGHT))
    classes = np.where(is_ground, GROUND, UNCLASSIFIED).astype(np.uint8)
    green = np.flatnonzero(~is_ground)[is_vegetation(moments.select(~is_ground), cell)]
    classes[green] = LOW_VEGETATION + np.searchsorted(VEGETATION_HEIGHTS, np.nan_to_num(above[green], nan=np.inf))
    is_own = moments.is_own
    classes, moments, above = classes[is_own], moments.select(is_own), above[is_own]
    is_temporary, n_repeated = _are_temporary(moments, above, ground, margin, observed, key, cell)
    classes[is_temporary & (classes != GROUND)] = TEMPORARY
    n_points, is_ground = np.bincount(classes, moments.counts), classes == GROUND
    columns, heights = moments.indices[is_ground, :2] // edge, moments.mean_heights(cell)[is_ground]
    return classes, FoundInTile(
        {int(number): int(n_points[number]) for number in np.flatnonzero(n_points)},
        n_repeated,
        GroundTile(key, ground_of_points(columns, heights, TILE_VOXELS // edge)),
        not np.isin(classes, sorted(drop)).all(),
    )


def _are_temporary(
    moments: VoxelMoments, above: NDArray[np.float64], ground: NDArray[np.float64], margin: int, observed: ObservedIn,
    key: TileKey, cell: float,
) -> tuple[NDArray[np.bool_], int]:  # fmt: skip
    """Which voxels of a tile are temporary, and how many points lie where several passes saw the ground."""
    edge = ground_voxels(cell, BLOCK_EDGE)
    n = TILE_VOXELS // edge
    halo = min(NEIGHBOUR_VOXELS // edge, n)
    seen = _observed_around(observed, key, n, halo)
    if not len(seen):
        return np.zeros(len(moments), bool), 0
    side, n_layers = n + 2 * halo, math.ceil(HIGHEST / (edge * cell))
    middles = (np.mgrid[0:side, 0:side].reshape(2, -1).T + 0.5 - halo) * edge / ground_voxels(cell) + margin
    heights = heights_at(ground, middles).reshape(side, side)
    first = np.floor((heights + GROUND_DEPTH) / (edge * cell))  # layer in which the ground ends
    columns = seen["column"].astype(np.int64) + halo
    layers = _steps_above(seen["layer"], first[columns[:, 1], columns[:, 0]])
    is_block_temporary, n_passes = temporary_blocks(layers, columns, seen["time"], (n_layers, side, side))
    blocks = moments.indices.astype(np.int64) // edge
    x, y = blocks[:, 0] + halo, blocks[:, 1] + halo
    layer = _steps_above(blocks[:, 2], first[y, x])
    is_low = (layer >= -1) & (layer < n_layers)
    # An object on the ground begins in the layer in which the ground ends, of which nothing is known by itself.
    is_temporary = is_low & is_block_temporary[np.where(is_low, np.maximum(layer, 1), 0), y, x]
    is_repeated = is_low & (above > GROUND_DEPTH) & (n_passes[y, x] > 1)
    return is_temporary, int(moments.counts[is_repeated].sum())


def _observed_around(observed: ObservedIn, key: TileKey, n: int, halo: int) -> NDArray[np.void]:
    """Observations of a tile of n blocks and of `halo` blocks around it; columns from the tile's corner."""
    parts = [np.empty(0, OBSERVATION)]
    for dx, dy in product((-1, 0, 1), repeat=2):
        seen = observed((key[0] + dx, key[1] + dy))
        if seen is None:
            continue
        columns = seen["column"] + np.array([dx * n, dy * n], np.int16)
        is_near = ((columns >= -halo) & (columns < n + halo)).all(axis=1)
        near = seen[is_near]
        near["column"] = columns[is_near]
        parts.append(near)
    return np.concatenate(parts)


def _steps_above(layers: NDArray[np.integer], first: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many layers above that of the ground; -2 where it is not known."""
    return np.where(np.isfinite(first), layers - np.nan_to_num(first), -2.0).astype(np.int64)


def observation_records(
    points: NDArray[np.float64], times: NDArray[np.float64], cell: float
) -> tuple[NDArray[np.int32], NDArray[np.void]]:
    """Tiles (k, 2) and records (`OBSERVATION`) of the blocks that points (n, 3), m, lay in at times (n,), s."""
    is_timed = np.isfinite(times)
    edge = ground_voxels(cell, BLOCK_EDGE)
    n = TILE_VOXELS // edge
    blocks, stretches = voxel_indices(points[is_timed], cell) // edge, np.floor(times[is_timed] / STRETCH)
    first, _ = first_of_each(*blocks.T, stretches)
    blocks = blocks[first]
    keys = blocks[:, :2] // n
    records = np.empty(len(blocks), OBSERVATION)
    records["column"] = blocks[:, :2] - keys * n
    records["layer"] = blocks[:, 2]
    records["time"] = stretches[first] * STRETCH
    return keys, records


def each_once(seen: NDArray[np.void]) -> NDArray[np.void]:
    """Observations (`OBSERVATION`) without those that occur again."""
    first, _ = first_of_each(*seen["column"].T, seen["layer"], seen["time"])
    return seen[first]


def pass_of(times: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the passes that stretches of time belong to, from 0 on; times (s) in any order."""
    ticks, tick_of = np.unique(times, return_inverse=True)
    numbers = np.cumsum(np.diff(ticks, prepend=ticks[:1]) > LEAST_PAUSE + STRETCH)
    return np.asarray(numbers[tick_of], np.int64)


def temporary_blocks(
    layers: NDArray[np.int64], columns: NDArray[np.int64], times: NDArray[np.float64], shape: tuple[int, int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether what is in each block (layers, ny, nx) is temporary, and how many passes saw the ground of each column.

    Layers (n,) of observations count from that in which the ground ends, of which nothing is said; -1 is ground too.
    """
    from scipy.ndimage import maximum_filter, uniform_filter

    def count(flags: NDArray[np.bool_], size: int) -> NDArray[np.float64]:
        return np.asarray(uniform_filter(flags.astype(np.float64), size=size, mode="constant") * size**flags.ndim)

    n_layers, ny, nx = shape
    passes = pass_of(times)
    x, y = columns.T
    is_inside = (layers >= -1) & (layers < n_layers)
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
