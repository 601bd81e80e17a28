"""Map update: a new version of a map, in which surfaces that drives found gone or new have a class of their own.

Each voxel is classified by its own evidence and by its neighbourhood: single voxels that are missed are noise at an
edge. Then voxels that were not clearly hit and lie among those that are gone go with them: no ray crosses the underside
of a car, but the car is gone.
"""

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.version import __version__
from maxcon.errors import MapError, OptionError
from maxcon.map import TILE_VOXELS, PointMap, TileKey
from maxcon.map.layout import SurfaceClass
from maxcon.map.manifest import CLASSES, GROUND, TILES, Manifest, read_manifest
from maxcon.map.storage import MapStorage, open_storage
from maxcon.map.store import MapWriter, Section, classes_record, map_folder, tile_record
from maxcon.mapping.build.tile_points import sums_around
from maxcon.mapping.update.evidence import CANDIDATE, EVIDENCE, Evidence, SurfaceFiles, Surfaces, gather_evidence
from maxcon.mapping.update.observations import LocalizedDrive, Observation, UpdateOptions, observations_of

CACHE_BYTES = 2**29
CACHED_TILES = 12  # those around the classified one: of the nine, three are read anew for each
NEIGHBOURHOOD = 2  # voxels to either side along each axis: 30 cm at 6 cm
CUBE = 4  # voxels, 24 cm at 6 cm: a voxel goes with those that are gone in its cube and the 26 around
UNTOUCHED, HIT, MISSED, NEW = range(4)  # first classes of a voxel
AROUND = (-1, 0, 1)


def update_map(
    parent: str | os.PathLike[str], drives: Sequence[LocalizedDrive], out: str | os.PathLike[str],
    options: UpdateOptions | None = None, *, overwrite: bool = False, progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Write the next version of a map; the map itself is not touched, and nothing that was measured is deleted.

    Memory is bounded by the tiles in reach of a few observations. The manifest returned names the parent by checksum,
    and the drives, under `updates` of its `build`.
    """
    options, report = options or UpdateOptions(), progress or (lambda step, done, total: None)
    if not drives or Path(out).resolve() == Path(parent).resolve():
        raise OptionError(
            f"Expected at least one drive, and another folder than the map itself, got {len(drives)} drives and {out}."
        )
    if twice := [key for key, n in Counter((drive.name, drive.sha256) for drive in drives).items() if n > 1]:
        raise OptionError(f"Expected each drive once, got {twice[0][0]} more than once. Name it once.")
    files = open_storage(parent)
    manifest = read_manifest(files)
    point_map = PointMap.open(parent, cache_bytes=CACHE_BYTES, left_out=None)
    observations = observations_of(drives, point_map.frame, options)
    if not any(point_map.covers(each.pose.x, each.pose.y, options.reach) for each in observations):
        first = point_map.frame.pose_to_global(observations[0].pose)
        raise MapError(
            f"Expected drives through {parent}, but no pose comes near it; the first is at x {first.x:.7g}, y"
            f" {first.y:.7g} m. Was it localized in another map, or in another CRS?"
        )
    with map_folder(out, overwrite=overwrite) as folder:
        work = folder / "work"
        work.mkdir()
        evidence = gather_evidence(point_map, drives, observations, options, work, report)
        with MapWriter(folder) as writer:
            counts = _write_tiles(writer, files, manifest, evidence, classify(evidence, observations, options), report)
            rmtree(work)
            update = {
                "program": f"maxcon {__version__}", "parent": {"name": Path(parent).name, "sha256": manifest.sha256},
                "drives": _describe(drives, observations), "options": asdict(options), **counts,
            }  # fmt: skip
            updates = [*manifest.build.get("updates", []), update]
            return writer.finish(replace(manifest, build={**manifest.build, "updates": updates}))


def _write_tiles(
    writer: MapWriter, files: MapStorage, manifest: Manifest, evidence: SurfaceFiles,
    classified: Iterator[tuple[Surfaces, NDArray[np.uint8]]], report: Progress,
) -> dict[str, int]:  # fmt: skip
    """Write the tiles of the map, classified or as they are, and its ground; return how many voxels changed."""
    tiles, old_classes, ground = (Section(files, manifest, name) for name in (TILES, CLASSES, GROUND))
    names = ("n_judged", "n_now_gone", "n_now_new", "n_back", *(f"n_{each.name.lower()}" for each in SurfaceClass))
    counts, keys = dict.fromkeys(names, 0), sorted(tiles.keys | evidence.n_voxels.keys())
    for done, key in enumerate(keys, 1):
        if key in evidence.n_voxels:
            surfaces, found = next(classified)
            before = surfaces.tile.surface_classes
            is_kept = found != CANDIDATE  # candidates that are not new are left out
            classes, is_added, was_gone = found[is_kept], before[is_kept] == CANDIDATE, before == SurfaceClass.GONE
            tile = replace(surfaces.tile.rows(is_kept), classes=classes)
            if len(tile):
                writer.put(tile_record(tile) if is_added.any() else tiles.record(key))
            if classes.any():
                writer.put(classes_record(tile))
            is_seen = surfaces.evidence["n_hits"] + surfaces.evidence["n_misses"] > 0
            counts["n_judged"] += int((is_seen & (before != CANDIDATE)).sum())
            counts["n_now_gone"] += int(((found == SurfaceClass.GONE) & ~was_gone).sum())
            counts["n_now_new"] += int(is_added.sum())
            counts["n_back"] += int(((found == SurfaceClass.NEW) & was_gone).sum())
        else:
            record = tiles.record(key)
            writer.put(record)
            classes = np.full(record.n_rows, SurfaceClass.KNOWN, np.uint8)
            if key in old_classes.keys:
                writer.put(old_classes.record(key))
                (classes,) = old_classes.columns(key)
        for each in SurfaceClass:
            counts[f"n_{each.name.lower()}"] += int(np.count_nonzero(classes == each))
        report("writing tiles", done, len(keys))
    for key in sorted(ground.keys):
        writer.put(ground.record(key))
    return counts


def _describe(drives: Sequence[LocalizedDrive], observations: Sequence[Observation]) -> list[Mapping[str, Any]]:
    """Return the drives of an update, for the manifest."""
    n_observations = Counter(each.drive for each in observations)
    return [
        {
            "name": drive.name,
            "sha256": drive.sha256,
            "n_epochs": len(drive.scans),
            "n_localized": len(drive.rows),
            "n_looks": n_observations[number],
            "from_time": drive.rows[0][1].time,
            "to_time": drive.rows[-1][1].time,
        }
        for number, drive in enumerate(drives)
    ]


def classify(
    files: SurfaceFiles, observations: Sequence[Observation], options: UpdateOptions
) -> Iterator[tuple[Surfaces, NDArray[np.uint8]]]:
    """Yield each tile with the class of each voxel, `CANDIDATE` for a candidate that is not new."""
    keys = sorted(files.n_voxels)
    times, drives = (np.array([getattr(each, name) for each in observations]) for name in ("time", "drive"))
    load = lru_cache(CACHED_TILES)(files.load)
    load_found = lru_cache(CACHED_TILES)(lambda key: files.arrays.get(key, "found")["classes"])

    def within(key: TileKey) -> tuple[NDArray[np.int32], list[tuple[TileKey, NDArray[np.intp]]]]:
        """Indices of the voxels of a tile and of those around it, from its corner, and their rows in each tile."""
        near = {(key[0] + dx, key[1] + dy) for dx, dy in product(AROUND, AROUND)} & files.n_voxels.keys()
        indices, parts = list[NDArray[np.int32]](), list[tuple[TileKey, NDArray[np.intp]]]()
        for each in (key, *sorted(near - {key})):
            tile, shift = load(each).tile, (np.array(each) - key) * TILE_VOXELS
            low, high = -CUBE - shift, TILE_VOXELS + CUBE - shift
            x, y = tile.columns.T
            rows = np.flatnonzero((x >= low[0]) & (x < high[0]) & (y >= low[1]) & (y < high[1]))
            parts.append((each, rows))
            indices.append(np.column_stack([tile.columns[rows] + shift, tile.layers[rows]]).astype(np.int32))
        return np.concatenate(indices), parts

    for key in keys:
        indices, parts = within(key)
        classes = np.concatenate([load(each).tile.surface_classes[rows] for each, rows in parts])
        evidence = {
            name: np.concatenate([load(each).evidence[name][rows] for each, rows in parts]) for name in EVIDENCE
        }
        found = _first_classes(indices, classes, evidence, times, drives, options)
        files.arrays.put(key, "found", classes=found[: len(load(key).tile)])
    for key in keys:
        indices, parts = within(key)
        found = np.concatenate([load_found(each)[rows] for each, rows in parts])
        yield load(key), _final_classes(indices, load(key).tile.surface_classes, found, options)


def _first_classes(
    indices: NDArray[np.int32], classes: NDArray[np.uint8], evidence: Evidence, times: NDArray[np.float64],
    drives: NDArray[np.int64], options: UpdateOptions,
) -> NDArray[np.uint8]:  # fmt: skip
    """Class each voxel of a tile and its halo, from its own evidence and that of its neighbourhood."""
    log_odds, n_hits, n_misses = evidence["log_odds"], evidence["n_hits"], evidence["n_misses"]
    is_candidate = (classes == CANDIDATE) | (classes == SurfaceClass.GONE)
    is_missed = ~is_candidate & (log_odds <= options.gone_at) & (n_misses >= options.least_looks)
    is_new = is_candidate & (log_odds >= options.new_at) & (n_hits >= options.least_looks)
    first, last = evidence["hit_in"].T
    is_lasting = (np.abs(times[last] - times[first]) >= options.least_time) | (drives[last] != drives[first])
    is_new &= (first >= 0) & is_lasting
    is_hit = ~is_candidate & (log_odds > options.start)  # more often than it was missed
    of_map = ~is_candidate
    values = np.column_stack([is_missed, is_new, of_map * n_misses, of_map * n_hits])
    n_missed, n_new, misses, hits = sums_around(indices, values, NEIGHBOURHOOD).T
    ratio = misses / np.maximum(misses + hits, 1.0)
    found = np.where(is_hit, HIT, UNTOUCHED).astype(np.uint8)
    found[is_missed & (n_missed >= options.least_voxels) & (ratio >= options.least_share)] = MISSED
    found[is_new & (n_new >= options.least_voxels)] = NEW
    return found


def _final_classes(
    indices: NDArray[np.int32], before: NDArray[np.uint8], found: NDArray[np.uint8], options: UpdateOptions
) -> NDArray[np.uint8]:
    """Classes of the voxels of a tile, which come first; untouched ones go with those that are gone around them."""
    counted = sums_around(indices, np.column_stack([found == MISSED, found == HIT]), 1, edge=CUBE)
    n_gone, n_hit = counted[: len(before)].T
    own, classes = found[: len(before)], before.copy()
    goes_along = (n_gone >= options.least_voxels) & (n_gone >= n_hit) & (own == UNTOUCHED) & (before != CANDIDATE)
    classes[(own == MISSED) | goes_along] = SurfaceClass.GONE
    classes[own == NEW] = SurfaceClass.NEW
    return classes
