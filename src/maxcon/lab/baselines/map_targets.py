# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MapTargets: what baselines made of a map, kept for the epochs that follow and for each other."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.frame import voxel_centers
from maxcon.lab.baselines.place import Place
from maxcon.lab.baselines.thinning import merge_planes
from maxcon.map import PointMap, TileKey

__all__ = ["MapTargets"]

N_TARGETS = 12
"""About 15 MB each in a city."""
N_TILES = 600
"""Of 30 m; about 0.25 MB each in a city."""

Made = TypeVar("Made")
_Planes = tuple[NDArray[np.float64], NDArray[np.float64]]


class MapTargets:
    """Thinned tiles of maps, and what methods made of the places around the last epochs.

    Give the same object to several methods, and they share what they can. It may be used by several threads:
    one that makes something holds up the others. A pickled or copied one is empty; answers do not depend on
    what it holds.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._kept: WeakKeyDictionary[PointMap, tuple[OrderedDict[Any, Any], OrderedDict[Any, Any]]]
        self._kept = WeakKeyDictionary()

    def planes(self, point_map: PointMap, place: Place, edge: float) -> _Planes:
        """Points and unit normals of the map within reach of a place, one per cube of edge `edge` of each tile.

        Returns
        -------
        points, normals : array, shape (n, 3)
            Local frame, m; zeros for a normal where there is none (`merge_planes`).
        """
        points, normals = [np.empty((0, 3))], [np.empty((0, 3))]
        for key in point_map.keys_within(*place.middle, place.half_width):
            merged = self._get(point_map, 1, N_TILES, (key, edge), partial(_merged, point_map, key, edge))
            is_near = place.reaches(merged[0])
            points.append(merged[0][is_near])
            normals.append(merged[1][is_near])
        return np.concatenate(points), np.concatenate(normals)

    def get(self, point_map: PointMap, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what was made of a map under a key, or make it."""
        made: Made = self._get(point_map, 0, N_TARGETS, key, make)
        return made

    def _get(self, point_map: PointMap, shelf: int, n_kept: int, key: Hashable, make: Callable[[], Any]) -> Any:
        with self._lock:
            kept = self._kept.setdefault(point_map, (OrderedDict(), OrderedDict()))[shelf]
            if key not in kept:
                kept[key] = make()
            kept.move_to_end(key)
            while len(kept) > n_kept:
                kept.popitem(last=False)
            return kept[key]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), ()


def _merged(point_map: PointMap, key: TileKey, edge: float) -> _Planes:
    """One point and normal per cube of a tile; cubes at its rim end there."""
    tile = point_map.tile(key)
    centers = voxel_centers(tile.voxels, point_map.cell)
    return merge_planes(centers, tile.normals, edge, is_signed=point_map.is_signed)
