# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Gathering evidence: what the rays of all drives say of the voxels of the map, and of candidates for new ones.

The scans are read twice. First, points where the map has nothing are sorted into tiles and become candidates. Then
every ray is walked through the voxels of map and candidates alike. Only the tiles in reach of a few looks are in memory
at a time: an update of a whole city takes no more memory than one of a street.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.progress import Progress
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.voxelize import tile_of_voxels
from maxcon.mapping.build.spill import TileSpill
from maxcon.mapping.update.candidates import candidates_of_tile, spill_unknown_points
from maxcon.mapping.update.drives import LocalizedDrive, Look, read_look
from maxcon.mapping.update.surfaces import CANDIDATE, Evidence, SurfaceFiles, Surfaces, SurfacesInReach, classes_of
from maxcon.mapping.update.update_options import UpdateOptions

__all__ = ["gather_evidence"]

MOST_VOXELS = 6_000_000
"""Voxels in memory at a time, some 70 bytes each with evidence, unless a single look reaches more."""


def gather_evidence(
    point_map: PointMap,
    drives: Sequence[LocalizedDrive],
    looks: Sequence[Look],
    options: UpdateOptions,
    folder: Path,
    report: Progress,
) -> SurfaceFiles:
    """Return all tiles that any look reaches, with candidates and evidence, on disk.

    Parameters
    ----------
    point_map : PointMap
        The map with all its voxels.
    drives : sequence of LocalizedDrive
        Their scans.
    looks : sequence of Look
        Of the drives, in order.
    options : UpdateOptions
        Weights and ranges of a look.
    folder : Path
        For files in between; the caller removes it.
    report : callable
        Called with (step, done, of how many).

    Raises
    ------
    FileError
        If a scan cannot be read.
    MapError
        If a tile cannot be read.
    """
    spill = TileSpill(folder, point_map.cell)
    for done, look in enumerate(looks, 1):
        spill_unknown_points(read_look(look, drives, options), look.pose, point_map, options, spill)
        report("finding new surfaces", done, len(looks))
    spill.complete()
    files = SurfaceFiles(folder)
    known, found = point_map.tile_keys, frozenset(spill.keys)
    for key in sorted(_keys_in_reach(looks, point_map, options) & (known | found)):
        candidates = None
        if key in found:
            candidates = candidates_of_tile(spill, key, point_map.cell, options, is_signed=point_map.is_signed)
            spill.remove(key)
        tile = _with_candidates(point_map.tile(key) if key in known else None, candidates)
        if len(tile):
            files.add(Surfaces(tile, Evidence.before_any_look(classes_of(tile), options)))
    _weigh_all(point_map, drives, looks, options, files, report)
    return files


def _weigh_all(
    point_map: PointMap,
    drives: Sequence[LocalizedDrive],
    looks: Sequence[Look],
    options: UpdateOptions,
    files: SurfaceFiles,
    report: Progress,
) -> None:
    """Walk the rays of all looks, a few tiles at a time."""
    first = 0
    for part, keys in _stretches(looks, files, lambda look: _keys_around(look, point_map, options)):
        if keys:
            within = SurfacesInReach.of([files.load(key) for key in keys])
            for number, look in enumerate(part, first):
                _weigh(number, look, read_look(look, drives, options), within, point_map, options)
                report("weighing looks", number + 1, len(looks))
            for number, key in enumerate(keys):
                files.save(key, within.of_tile(number))
        first += len(part)


def _weigh(
    number: int,
    look: Look,
    ends: NDArray[np.float64],
    within: SurfacesInReach,
    point_map: PointMap,
    options: UpdateOptions,
) -> None:
    from maxcon.mapping.update.ray_kernels import weigh_look

    origin = look.pose.position
    distances = np.linalg.norm(ends - origin, axis=1)
    margins = options.margins(look.sigma_position, look.sigma_angle, point_map.sigma, distances)
    lookup, evidence = within.lookup, within.evidence
    weights = options.hit, options.miss, options.lowest, options.highest
    weigh_look(
        origin, ends, number, point_map.cell, margins, options.least_cosine, options.reach, weights, lookup.rows,
        lookup.grid, np.array(lookup.corner), within.offsets, evidence.log_odds, evidence.n_met, evidence.n_through,
        evidence.met_in, within.judged_in,
    )  # fmt: skip


def _keys_around(look: Look, point_map: PointMap, options: UpdateOptions) -> set[TileKey]:
    """Keys of the tiles in reach of a look, whether the map has them or not."""
    edge, place = point_map.tile_voxels * point_map.cell, look.pose.position[:2]
    low = np.floor((place - options.reach) / edge).astype(int)
    high = np.floor((place + options.reach) / edge).astype(int)
    return {(x, y) for x in range(low[0], high[0] + 1) for y in range(low[1], high[1] + 1)}


def _keys_in_reach(looks: Sequence[Look], point_map: PointMap, options: UpdateOptions) -> set[TileKey]:
    return set[TileKey]().union(*(_keys_around(look, point_map, options) for look in looks))


def _stretches(
    looks: Sequence[Look], files: SurfaceFiles, keys_around: Callable[[Look], set[TileKey]]
) -> Iterator[tuple[list[Look], list[TileKey]]]:
    """Cut the looks into parts whose tiles fit into memory together; yield each with the keys of its tiles."""
    part, keys = list[Look](), set[TileKey]()
    for look in looks:
        more = keys | (keys_around(look) & files.n_voxels.keys())
        if part and sum(files.n_voxels[key] for key in more) > MOST_VOXELS:
            yield part, sorted(keys)
            part, more = [], keys_around(look) & files.n_voxels.keys()
        part.append(look)
        keys = more
    if part:
        yield part, sorted(keys)


def _with_candidates(tile: VoxelTile | None, candidates: VoxelTile | None) -> VoxelTile:
    """Return the voxels of a tile of the map and the candidates in one tile."""
    parts = list[tuple[VoxelTile, NDArray[np.uint8]]]()
    if tile is not None:
        parts.append((tile, classes_of(tile)))
    if candidates is not None:
        parts.append((candidates, np.full(len(candidates), CANDIDATE, np.uint8)))

    def together(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part, _ in parts])

    return tile_of_voxels(
        parts[0][0].key, together("columns"), together("layers"), together("counts"), together("normals"),
        together("means"), np.concatenate([classes for _, classes in parts]),
    )  # fmt: skip
