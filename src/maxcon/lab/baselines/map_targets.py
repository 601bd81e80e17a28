"""MapTargets: thinned points of the map around a place, kept for the epochs that follow."""

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, voxel_centers
from maxcon.map import PointMap, TileKey
from maxcon.map.voxelize import turn_alike

SQUARE = 20.0  # edge of the squares of the ground whose sensors share a place, m
REACH_STEP = 20.0
"""Reaches are rounded up to multiples of this, so that scans of nearly the same range share a place, m."""
DRIFT = 5.0  # how far an iteration may carry the sensor before the scan's farthest points leave the place, m


@dataclass(frozen=True, slots=True)
class Place:
    """A square of the ground, of index floor(coordinate / 20 m), and all in `reach` (m): of start and scan alone."""

    column: int
    row: int
    reach: float

    @classmethod
    def of_scan(cls, points_sensor: NDArray[np.float64], around: Pose, gate: float, spread: float) -> "Place":
        """Return the place of a scan around a pose, with a correspondence gate and a spread of starts, m."""
        largest_range = float(np.linalg.norm(points_sensor, axis=1).max(initial=0.0))
        reach = REACH_STEP * math.ceil((largest_range + gate + spread + DRIFT) / REACH_STEP)
        return cls(math.floor(around.x / SQUARE), math.floor(around.y / SQUARE), reach)

    @property
    def middle(self) -> tuple[float, float]:
        """Where the middle of the square lies in x and y, local frame, m."""
        return (self.column + 0.5) * SQUARE, (self.row + 0.5) * SQUARE

    @property
    def half_width(self) -> float:
        """Half the side of the square that holds all within reach, m."""
        return 0.5 * SQUARE + self.reach

    def reaches(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a sensor in the square reaches each point, shape (n, 3), local frame, m."""
        beyond = np.maximum(np.abs(points[:, :2] - self.middle) - 0.5 * SQUARE, 0.0)
        return np.asarray(np.hypot(beyond[:, 0], beyond[:, 1]) <= self.reach)


LEAST_AGREEMENT = 0.8
"""Length of the mean normal of a cube's points (0 for one without) from which they are called a plane."""


def thin(points: NDArray[np.float64], edge: float) -> NDArray[np.float64]:
    """Return the mean of the points in each cube of edge `edge` (m), ordered by (z, y, x); all points for 0."""
    if edge == 0.0:
        return points
    cube, n_cubes = _cubes(points, edge)
    return _sums(points, cube, n_cubes) / np.bincount(cube, minlength=n_cubes)[:, None]


def merge_planes(
    points: NDArray[np.float64], normals: NDArray[np.floating], edge: float, *, is_signed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean point and unit normal (zero where they disagree) of each cube of `edge` (m), ordered by (z, y, x)."""
    cube, n_cubes = _cubes(points, edge)
    if not is_signed:
        normals = turn_alike(normals.astype(np.float64), cube, n_cubes)
    counts = np.bincount(cube, minlength=n_cubes)[:, None]
    mean_points, mean_normals = _sums(points, cube, n_cubes) / counts, _sums(normals, cube, n_cubes) / counts
    lengths = np.linalg.norm(mean_normals, axis=1, keepdims=True)
    is_plane = lengths >= LEAST_AGREEMENT
    return mean_points, np.divide(mean_normals, lengths, out=np.zeros_like(mean_normals), where=is_plane)


def _cubes(points: NDArray[np.float64], edge: float) -> tuple[NDArray[np.int64], int]:
    """Return the number of the cube of each point, 0, 1, ... in the order (z, y, x), and how many there are."""
    if not len(points):
        return np.empty(0, np.int64), 0
    # Within 1.5e6 cubes of each other along each axis their numbers fit into int64.
    x, y, z = (np.floor(points / edge) - np.floor(points / edge).min(axis=0)).astype(np.int64).T
    n_x, n_y = int(x.max()) + 1, int(y.max()) + 1
    found, cube = np.unique((z * n_y + y) * n_x + x, return_inverse=True)
    return cube, len(found)


def _sums(values: NDArray[np.floating], cube: NDArray[np.int64], n_cubes: int) -> NDArray[np.float64]:
    return np.column_stack([np.bincount(cube, weights=column, minlength=n_cubes) for column in values.T])


N_TARGETS = 12  # about 15 MB each in a city
N_TILES = 600  # of 30 m; about 0.25 MB each in a city

Made = TypeVar("Made")
_Planes = tuple[NDArray[np.float64], NDArray[np.float64]]


class MapTargets:
    """Cache (LRU) of thinned tiles and places that methods share, also in threads; empty when pickled or copied."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._kept: WeakKeyDictionary[PointMap, dict[int, OrderedDict[Hashable, Any]]] = WeakKeyDictionary()

    def planes(self, point_map: PointMap, place: Place, edge: float) -> _Planes:
        """Points and unit normals, (n, 3), of the map in reach of a place, one per cube of `edge` (m) of each tile."""
        points, normals = [np.empty((0, 3))], [np.empty((0, 3))]
        for key in point_map.keys_within(*place.middle, place.half_width):
            merged = self.get(point_map, (key, edge), partial(_merged, point_map, key, edge), N_TILES)
            is_near = place.reaches(merged[0])
            points.append(merged[0][is_near])
            normals.append(merged[1][is_near])
        return np.concatenate(points), np.concatenate(normals)

    def get(self, point_map: PointMap, key: Hashable, make: Callable[[], Made], n_kept: int = N_TARGETS) -> Made:
        """Return what was made of a map under a key, or make it; the last `n_kept` of that number are kept."""
        with self._lock:
            kept = self._kept.setdefault(point_map, {}).setdefault(n_kept, OrderedDict())
            made: Made = kept.pop(key) if key in kept else make()
            kept[key] = made
            while len(kept) > n_kept:
                kept.popitem(last=False)
            return made

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), ()


def _merged(point_map: PointMap, key: TileKey, edge: float) -> _Planes:
    """One point and normal per cube of a tile; cubes at its rim end there."""
    tile = point_map.tile(key)
    centers = voxel_centers(tile.voxels, point_map.cell)
    return merge_planes(centers, tile.normals, edge, is_signed=point_map.is_signed)
