"""From points with normals to tiles of voxels with a count, a mean unit normal and a mean point (D4)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.geometry import voxel_indices
from maxcon.map.layout import CANCELLED_LENGTH, MEAN_STEPS, TILE_VOXELS, TileKey
from maxcon.map.tile import VoxelTile, search_order

MOST_LAYERS = 16_384


def voxelize(
    points: NDArray[np.float64], normals: NDArray[np.float64], cell: float, *, is_signed: bool
) -> dict[TileKey, VoxelTile]:
    """Gather points (n, 3), m, into voxels of edge `cell` (m) with count, mean unit normal and mean point (D4)."""
    of_points = voxel_indices(points, cell)
    first, voxel = first_of_each(*of_points.T)
    indices, counts = of_points[first], np.bincount(voxel)
    if not is_signed:
        normals = turn_alike(normals, voxel, len(indices))

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        summed = np.zeros((len(indices), 3))
        for axis in range(3):
            summed[:, axis] = np.bincount(voxel, weights=values[:, axis], minlength=len(indices))
        return summed

    means = mean_steps(sums(points - of_points * cell), counts, cell)
    unit, counts_32 = mean_normals(sums(normals), counts), counts.astype(np.int32)
    keys = indices[:, :2] // TILE_VOXELS
    first, tile = first_of_each(*keys.T)
    order = np.argsort(tile, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(tile[order])) + 1) if len(order) else []
    tiles = {}
    for (x, y), members in zip(keys[first].tolist(), groups, strict=True):
        columns = (indices[members, :2] - np.array([x, y]) * TILE_VOXELS).astype(np.int16)
        tiles[(x, y)] = tile_of_voxels(
            (x, y), columns, indices[members, 2], counts_32[members], unit[members], means[members]
        )
    return tiles


def first_of_each(*columns: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """First row of each different value in columns, and the value's number for every row; numpy.unique is slower."""
    order = np.lexsort(columns[::-1])
    is_first = np.ones(len(order), bool)
    is_first[1:] = np.logical_or.reduce([np.diff(values[order]) != 0 for values in columns])
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(is_first) - 1
    return order[is_first], number


def turn_alike(normals: NDArray[np.float64], group: NDArray[np.integer], n_groups: int) -> NDArray[np.float64]:
    """Turn normals, shape (n, 3), to the side of the first normal of their group: n and -n mean the same."""
    rows = np.flatnonzero(normals.any(axis=1))[::-1]
    first = np.zeros(n_groups, np.int64)
    first[group[rows]] = rows  # the last to be written is the first that has a normal
    along = (normals * normals[first[group]]).sum(axis=1)
    return np.where(along[:, None] < 0.0, -normals, normals)


def mean_normals(sums: NDArray[np.float64], counts: NDArray[np.integer] | NDArray[np.float64]) -> NDArray[np.float32]:
    """Unit vectors along sums of `counts` unit normals, shape (n, 3); zeros where they cancel."""
    lengths = np.linalg.norm(sums, axis=1)
    has_direction = lengths > CANCELLED_LENGTH * np.maximum(counts, 1)
    unit = np.divide(sums, lengths[:, None], out=np.zeros_like(sums), where=has_direction[:, None])
    return np.asarray(unit, dtype=np.float32)


def mean_steps(
    sums: NDArray[np.float64], counts: NDArray[np.integer] | NDArray[np.float64], cell: float
) -> NDArray[np.uint8]:
    """Means of points in voxels, in 256ths of the edge `cell` (m), from sums of positions from corners, (n, 3), m."""
    steps = np.floor(sums / (np.asarray(counts)[:, None] * (cell / MEAN_STEPS)))
    return np.clip(steps, 0, MEAN_STEPS - 1).astype(np.uint8)


def tile_of_voxels(
    key: TileKey, columns: NDArray[np.int16], layers: NDArray[np.int32], counts: NDArray[np.int32],
    normals: NDArray[np.float32], means: NDArray[np.uint8], classes: NDArray[np.uint8] | None = None,
) -> VoxelTile:  # fmt: skip
    """Make a tile from voxels in any order; a MapError if they lie in over 16,384 layers, which take 8 KiB each."""
    n_layers = len(np.unique(layers))
    if n_layers > MOST_LAYERS:
        raise MapError(
            f"Expected voxels in at most {MOST_LAYERS:,} height layers of tile {key}, got {n_layers:,}."
            " Remove stray points far above and below (class them as noise)."
        )
    order = search_order(columns, layers)
    return VoxelTile(key, columns, layers, counts, normals, means, classes=classes).rows(order)
