# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How far apart the points of a map lie, and the voxel edge that suits them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.map.layout import TILE_VOXELS, TileKey
from maxcon.mapping.build.options import LEAST_CELL
from maxcon.mapping.build.tile_points import TileBuckets

# Voxels of this many spacings (of those that 90 % of the points keep) have few holes; measured on the drives of
# docs/decisions/map-on-disk.md.
SPACINGS_PER_CELL = 1.2
# No larger voxels are chosen (m): where points lie farther apart surfaces cannot be told from single points.
LARGEST_CELL = 0.6

# Neighbours are looked for within squares of a tile, of the points that are MARGIN from their borders, m: a neighbour
# farther away than that counts as so far away.
SQUARE, MARGIN = 2.0, 0.5
# So many tiles, evenly over the map, are looked at; of each all squares, or while they have more points every second.
MOST_TILES, MOST_POINTS, MOST_SQUARES_APART = 64, 100_000, 64


@dataclass(frozen=True, slots=True)
class PointSpacing:
    """Distances of map points to the nearest other one."""

    median: float  # m
    at_90: float  # the distance that 90 % of the points keep, m; `MARGIN` stands for anything farther
    n_points: int  # of how many points
    is_of_scans: bool = False  # scans of a drive: between their rings points lie farther apart than these tell

    @property
    def cell(self) -> float:
        """The voxel edge that suits the points, m: whole multiples of `LEAST_CELL`, rounded down; of scans rounded."""
        n_steps = round(SPACINGS_PER_CELL * self.at_90 / LEAST_CELL, None if self.is_of_scans else 3)
        return min(round(max(1, int(n_steps)) * LEAST_CELL, 2), LARGEST_CELL)

    def describe(self) -> dict[str, object]:
        """Return its entry in the manifest (docs/map_format.md)."""
        spacing = {"median": round(self.median, 4), "at_90": round(self.at_90, 4)}
        return {**spacing, "n_points": self.n_points, "suits_cell": self.cell}


def point_spacing(points: TileBuckets, cell: float, *, are_scans: bool = False) -> PointSpacing | None:
    """Measure the spacing of points sorted into tiles of voxels of this edge (m); None if it cannot be told."""
    keys, distances, weights = points.keys, list[NDArray[np.float64]](), list[NDArray[np.int64]]()
    for number in np.unique(np.linspace(0, len(keys) - 1, MOST_TILES).astype(int)):
        sample, every = _sample_of_tile(points, keys[number], cell)
        distances.append(nearest_distances(sample, TILE_VOXELS * cell))
        weights.append(np.full(len(distances[-1]), every))
    near, n_stood_for = np.concatenate(distances), np.concatenate(weights)
    if not len(near):
        return None
    order = np.argsort(near)
    ranks = np.cumsum(n_stood_for[order])
    median, at_90 = near[order[np.searchsorted(ranks, [0.5 * ranks[-1], 0.9 * ranks[-1]])]].tolist()
    return PointSpacing(median, at_90, len(near), are_scans)


def _sample_of_tile(points: TileBuckets, key: TileKey, cell: float) -> tuple[NDArray[np.float64], int]:
    """Return all points, shape (n, 3), m from the tile's corner, in one of so many squares, and that number."""
    every, parts = 1, list[NDArray[np.float64]]()
    for records in points.records(key):
        places = np.column_stack([records["column"], records["layer"]]) * cell + records["inside"]
        parts.append(places[_is_in_sample(places, every)])
        while sum(map(len, parts)) > MOST_POINTS and every < MOST_SQUARES_APART:
            every *= 2
            parts = [part[_is_in_sample(part, every)] for part in parts]
    return np.concatenate(parts), every


def _is_in_sample(points: NDArray[np.float64], every: int) -> NDArray[np.bool_]:
    """Which points, shape (n, 3), lie in the squares of the sample: one of `every`."""
    x, y = np.floor(points[:, :2].T / SQUARE).astype(np.int64)
    return np.asarray((x + 3 * y) % every == 0)


def nearest_distances(points: NDArray[np.float64], edge: float) -> NDArray[np.float64]:
    """Distance to the nearest other one, at most `MARGIN`, of each point (n, 3), m, so far inside of its square."""
    from scipy.spatial import cKDTree

    inside = points[:, :2] % SQUARE
    is_inner = (inside >= MARGIN) & (inside < SQUARE - MARGIN) & (points[:, :2] < edge // SQUARE * SQUARE)
    if not is_inner.all(axis=1).any():
        return np.empty(0)
    asked = points[is_inner.all(axis=1)]
    distances, _ = cKDTree(points).query(asked, k=2, distance_upper_bound=MARGIN)
    return np.asarray(np.minimum(distances[:, 1], MARGIN))
