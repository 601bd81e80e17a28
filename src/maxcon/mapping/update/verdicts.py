# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Verdicts: which surfaces are gone and which are new, from the evidence of each voxel and of those around it.

First, each voxel is judged by its own evidence and by its neighbourhood: single voxels that are seen through are noise
at an edge. Then voxels that were not clearly met and lie among those that are gone go with them: no ray crosses the
underside of a car, but the car is gone.
"""

from collections.abc import Container, Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from maxcon.map import TileKey
from maxcon.map.layout import SurfaceClass
from maxcon.mapping.update.surfaces import CANDIDATE, SurfaceFiles, Surfaces, SurfacesInReach
from maxcon.mapping.update.update_options import UpdateOptions

__all__ = ["LookTimes", "find_verdicts"]

NEIGHBOURHOOD = 2
"""Voxels to either side along each axis: 30 cm at 6 cm."""
CUBE = 4
"""Edge of cubes in voxels, 24 cm at 6 cm: a voxel goes with those that are gone in its cube and the 26 around."""
KEPT_TILES = 12
"""Tiles in memory, those around the judged one: of the nine, three are read anew for each."""
UNTOUCHED, MET, SEEN_THROUGH, NEW = range(4)
"""First verdicts on a voxel."""


class LookTimes:
    """When each look was, and on which drive.

    Parameters
    ----------
    times : array, shape (n,)
        s.
    drives : array, shape (n,), int
        Number of the drive.
    """

    def __init__(self, times: NDArray[np.float64], drives: NDArray[np.int64]) -> None:
        self._times = times
        self._drives = drives

    def are_lasting(self, met_in: NDArray[np.int32], least_time: float) -> NDArray[np.bool_]:
        """Whether first and last look, (n, 2), -1 for none, are `least_time` (s) apart, or of different drives."""
        first, last = met_in.T
        spans = np.abs(self._times[last] - self._times[first]) >= least_time
        return np.asarray((first >= 0) & (spans | (self._drives[last] != self._drives[first])))


def find_verdicts(
    files: SurfaceFiles, times: LookTimes, options: UpdateOptions
) -> Iterator[tuple[Surfaces, NDArray[np.uint8]]]:
    """Yield each tile under judgement with the class of each voxel, `CANDIDATE` for a candidate that is not new.

    Parameters
    ----------
    files : SurfaceFiles
        The tiles with all evidence.
    times : LookTimes
        Of the looks.
    options : UpdateOptions
        Thresholds of the evidence.
    """
    there = files.n_voxels
    keys = sorted(there)
    load = lru_cache(KEPT_TILES)(files.load)
    for key in keys:
        around = [load(each) for each in _neighbours(key, there)]
        files.save_verdicts(key, _first_verdicts(around, times, options))
    load_verdicts = lru_cache(KEPT_TILES)(files.load_verdicts)
    for key in keys:
        near = _neighbours(key, there)
        around, verdicts = [load(each) for each in near], [load_verdicts(each) for each in near]
        yield around[0], _final_classes(around, verdicts, options)


def _neighbours(key: TileKey, there: Container[TileKey]) -> list[TileKey]:
    """Return a tile's key and those of the tiles around it that there are."""
    steps = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) != (0, 0)]
    return [key, *(near for dx, dy in steps if (near := (key[0] + dx, key[1] + dy)) in there)]


def _first_verdicts(around: Sequence[Surfaces], times: LookTimes, options: UpdateOptions) -> NDArray[np.uint8]:
    """The first verdict on each voxel of the first tile, from its own evidence and that of its neighbourhood."""
    within = SurfacesInReach.of(around)
    evidence, classes = within.evidence, np.concatenate([each.classes for each in around])
    is_candidate = (classes == CANDIDATE) | (classes == SurfaceClass.GONE)
    is_through = ~is_candidate & (evidence.log_odds <= options.gone_at) & (evidence.n_through >= options.least_looks)
    is_new = is_candidate & (evidence.log_odds >= options.new_at) & (evidence.n_met >= options.least_looks)
    is_new &= times.are_lasting(evidence.met_in, options.least_time)
    own = slice(0, len(around[0].tile))
    is_met = ~is_candidate & (evidence.log_odds > options.start)  # more often than it was seen through
    verdicts = np.where(is_met, MET, UNTOUCHED).astype(np.uint8)[own]
    rows = np.flatnonzero((is_through | is_new)[own])
    of_map = np.where(is_candidate, 0, 1)
    values = np.column_stack([is_through, is_new, of_map * evidence.n_through, of_map * evidence.n_met]).astype(
        np.float32
    )
    n_through, n_new, looks_through, looks_met = _sums(around[0], rows, NEIGHBOURHOOD, within, values).T
    share = looks_through / np.maximum(looks_through + looks_met, 1.0)
    is_gone = is_through[rows] & (n_through >= options.least_voxels) & (share >= options.least_share)
    verdicts[rows[is_gone]] = SEEN_THROUGH
    verdicts[rows[is_new[rows] & (n_new >= options.least_voxels)]] = NEW
    return verdicts


def _final_classes(
    around: Sequence[Surfaces], verdicts: Sequence[NDArray[np.uint8]], options: UpdateOptions
) -> NDArray[np.uint8]:
    """Classes of the voxels of the first tile; untouched ones go with those that are gone around them."""
    own, classes = verdicts[0], around[0].classes.copy()
    rows = np.flatnonzero((own == UNTOUCHED) & (classes != CANDIDATE) & (classes != SurfaceClass.GONE))
    n_gone, n_met = (
        _counts_around(around, verdicts, what, around[0].tile.voxels[rows]) for what in (SEEN_THROUGH, MET)
    )
    is_taken_along = (n_gone >= options.least_voxels) & (n_gone >= n_met)
    is_gone = own == SEEN_THROUGH
    is_gone[rows[is_taken_along]] = True
    classes[is_gone] = SurfaceClass.GONE
    classes[own == NEW] = SurfaceClass.NEW
    return classes


def _counts_around(
    around: Sequence[Surfaces], verdicts: Sequence[NDArray[np.uint8]], what: int, voxels: NDArray[np.int32]
) -> NDArray[np.int64]:
    """How many voxels of one verdict lie in the cube of each of some voxels and in the 26 around it."""
    chosen = np.concatenate([each.tile.voxels[verdict == what] for each, verdict in zip(around, verdicts, strict=True)])
    cubes, counts = np.unique(_numbers(chosen // CUBE), return_counts=True)
    own, cube_of_voxel = np.unique(voxels // CUBE, axis=0, return_inverse=True)
    total = np.zeros(len(own), np.int64)
    steps = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    for step in steps if len(cubes) else ():
        wanted = _numbers(own + np.array(step, np.int32))
        place = np.minimum(np.searchsorted(cubes, wanted), len(cubes) - 1)
        total += np.where(cubes[place] == wanted, counts[place], 0)
    return total[cube_of_voxel.reshape(-1)]


def _sums(
    surfaces: Surfaces, rows: NDArray[np.int64], reach: int, within: SurfacesInReach, values: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Sums of the values of the voxels around some voxels of a tile."""
    from maxcon.mapping.update.ray_kernels import sum_around

    sums, lookup = np.zeros((len(rows), values.shape[1])), within.lookup
    sum_around(
        np.ascontiguousarray(surfaces.tile.voxels[rows]), reach, lookup.rows, lookup.grid, np.array(lookup.corner),
        within.offsets, np.ascontiguousarray(values), sums,
    )  # fmt: skip
    return sums


def _numbers(cubes: NDArray[np.integer]) -> NDArray[np.int64]:
    """One number for each cube."""
    x, y, z = cubes.astype(np.int64).T
    return np.asarray(((x & 0x1FFFFF) << 42) | ((y & 0x1FFFFF) << 21) | (z & 0x1FFFFF))
