# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Classification: which surfaces are gone and which are new, from the evidence of each voxel and of those around it.

First, each voxel is classified by its own evidence and by its neighbourhood: single voxels that are missed are noise
at an edge. Then voxels that were not clearly hit and lie among those that are gone go with them: no ray crosses the
underside of a car, but the car is gone.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maxcon.map import TileKey
from maxcon.map.layout import SurfaceClass
from maxcon.mapping.update.evidence import CANDIDATE, SurfaceFiles, Surfaces, SurfacesInReach
from maxcon.mapping.update.observations import Observation
from maxcon.mapping.update.options import UpdateOptions

NEIGHBOURHOOD = 2
"""Voxels to either side along each axis: 30 cm at 6 cm."""
CUBE = 4
"""Edge of cubes in voxels, 24 cm at 6 cm: a voxel goes with those that are gone in its cube and the 26 around."""
CACHED_TILES = 12
"""Tiles in memory, those around the classified one: of the nine, three are read anew for each."""
UNTOUCHED, HIT, MISSED, NEW = range(4)
"""First classes of a voxel."""
AROUND = (-1, 0, 1)


def classify(
    files: SurfaceFiles, observations: Sequence[Observation], options: UpdateOptions
) -> Iterator[tuple[Surfaces, NDArray[np.uint8]]]:
    """Yield each tile with the class of each voxel, `CANDIDATE` for a candidate that is not new.

    `files`: the tiles with all evidence.
    """
    keys = sorted(files.n_voxels)
    times, drives = (np.array([getattr(each, name) for each in observations]) for name in ("time", "drive"))

    def around(key: TileKey) -> list[TileKey]:
        """Keys of a tile and of those around it that there are."""
        near = [(key[0] + dx, key[1] + dy) for dx, dy in product(AROUND, AROUND) if (dx, dy) != (0, 0)]
        return [key, *(each for each in near if each in files.n_voxels)]

    load = lru_cache(CACHED_TILES)(files.load)
    for key in keys:
        within = [load(each) for each in around(key)]
        files.arrays.put(key, "classes", classes=_first_classes(within, times, drives, options))
    load_classes = lru_cache(CACHED_TILES)(lambda key: files.arrays.get(key, "classes")["classes"])
    for key in keys:
        within = [load(each) for each in around(key)]
        yield within[0], _final_classes(within, [load_classes(each) for each in around(key)], options)


def _first_classes(
    around: Sequence[Surfaces], times: NDArray[np.float64], drives: NDArray[np.int64], options: UpdateOptions
) -> NDArray[np.uint8]:
    """Class each voxel of the first tile, from its own evidence and that of its neighbourhood."""
    within = SurfacesInReach.of(around)
    evidence, classes = within.evidence, np.concatenate([each.classes for each in around])
    is_candidate = (classes == CANDIDATE) | (classes == SurfaceClass.GONE)
    is_missed = ~is_candidate & (evidence.log_odds <= options.gone_at) & (evidence.n_misses >= options.least_looks)
    is_new = is_candidate & (evidence.log_odds >= options.new_at) & (evidence.n_hits >= options.least_looks)
    first, last = evidence.hit_in.T
    is_lasting = (np.abs(times[last] - times[first]) >= options.least_time) | (drives[last] != drives[first])
    is_new &= (first >= 0) & is_lasting
    is_hit = ~is_candidate & (evidence.log_odds > options.start)  # more often than it was missed
    own = slice(0, len(around[0].tile))
    found = np.where(is_hit, HIT, UNTOUCHED).astype(np.uint8)[own]
    rows = np.flatnonzero((is_missed | is_new)[own])
    of_map = np.where(is_candidate, 0, 1)
    values = np.column_stack([is_missed, is_new, of_map * evidence.n_misses, of_map * evidence.n_hits])
    n_missed, n_new, misses, hits = _sums(around[0], rows, within, values.astype(np.float32)).T
    ratio = misses / np.maximum(misses + hits, 1.0)
    is_gone = is_missed[rows] & (n_missed >= options.least_voxels) & (ratio >= options.least_share)
    found[rows[is_gone]] = MISSED
    found[rows[is_new[rows] & (n_new >= options.least_voxels)]] = NEW
    return found


def _sums(
    surfaces: Surfaces, rows: NDArray[np.int64], within: SurfacesInReach, values: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Sums of the values in the neighbourhoods of some voxels of a tile."""
    from maxcon.mapping.update.ray_kernels import sum_around

    sums, voxels = np.zeros((len(rows), values.shape[1])), np.ascontiguousarray(surfaces.tile.voxels[rows])
    sum_around(voxels, NEIGHBOURHOOD, *within.table, np.ascontiguousarray(values), sums)
    return sums


def _final_classes(
    around: Sequence[Surfaces], found: Sequence[NDArray[np.uint8]], options: UpdateOptions
) -> NDArray[np.uint8]:
    """Classes of the voxels of the first tile; untouched ones go with those that are gone around them."""
    own, classes = found[0], around[0].classes.copy()
    rows = np.flatnonzero((own == UNTOUCHED) & (classes != CANDIDATE) & (classes != SurfaceClass.GONE))
    voxels = around[0].tile.voxels[rows]
    n_gone, n_hit = (_n_in_cubes(around, found, which, voxels) for which in (MISSED, HIT))
    is_gone = own == MISSED
    is_gone[rows[(n_gone >= options.least_voxels) & (n_gone >= n_hit)]] = True
    classes[is_gone] = SurfaceClass.GONE
    classes[own == NEW] = SurfaceClass.NEW
    return classes


def _n_in_cubes(
    around: Sequence[Surfaces], found: Sequence[NDArray[np.uint8]], which: int, voxels: NDArray[np.int32]
) -> NDArray[np.int64]:
    """How many voxels of one first class lie in the cube of each of some voxels and in the 26 around it."""
    chosen = np.concatenate([each.tile.voxels[one == which] for each, one in zip(around, found, strict=True)])
    cubes, counts = np.unique(_numbers(chosen // CUBE), return_counts=True)
    own, cube_of_voxel = np.unique(voxels // CUBE, axis=0, return_inverse=True)
    total = np.zeros(len(own), np.int64)
    for step in product(AROUND, repeat=3) if len(cubes) else ():
        wanted = _numbers(own + np.array(step, np.int32))
        place = np.minimum(np.searchsorted(cubes, wanted), len(cubes) - 1)
        total += np.where(cubes[place] == wanted, counts[place], 0)
    return total[cube_of_voxel.reshape(-1)]


def _numbers(cubes: NDArray[np.integer]) -> NDArray[np.int64]:
    """One number for each cube."""
    x, y, z = cubes.astype(np.int64).T
    return np.asarray(((x & 0x1FFFFF) << 42) | ((y & 0x1FFFFF) << 21) | (z & 0x1FFFFF))
