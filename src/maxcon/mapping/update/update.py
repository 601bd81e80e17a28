# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Updating a map: a new version of it, in which what drives found gone or new has a class of its own (decision 31)."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon._system.version import __version__
from maxcon.errors import MapError, OptionError
from maxcon.map import PointMap, TileKey
from maxcon.map.layout import SurfaceClass
from maxcon.map.manifest import CLASSES, GROUND, MAP_NAMES, TILES, Manifest, read_manifest
from maxcon.map.storage import MapStorage, open_storage
from maxcon.map.store import Section, classes_of_batch, classes_record, tile_record
from maxcon.map.writer import MapWriter
from maxcon.mapping.update.drives import LocalizedDrive, Look, looks_of
from maxcon.mapping.update.gathering import gather_evidence
from maxcon.mapping.update.surfaces import CANDIDATE, Surfaces
from maxcon.mapping.update.update_options import UpdateOptions
from maxcon.mapping.update.verdicts import LookTimes, find_verdicts

__all__ = ["update_map"]

CACHE_BYTES = 2**29


def update_map(
    parent: str | os.PathLike[str],
    drives: Sequence[LocalizedDrive],
    out: str | os.PathLike[str],
    options: UpdateOptions | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Manifest:
    """Write the next version of a map; the map itself is not touched, and nothing that was measured is deleted.

    Parameters
    ----------
    parent : path
        The map.
    drives : sequence of LocalizedDrive
        Scans that were localized in it, or in an earlier version of it.
    out : path
        Folder of the new version; it appears when all is done.
    options : UpdateOptions, optional
        What counts as evidence, and when a surface is gone or new; the defaults if None.
    overwrite : bool
        Whether a map that stands at `out` is replaced; anything else there is an error, and so is the map itself.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Manifest
        Of the new version. Under `updates` of its `build` it names its parent by checksum, and the drives.

    Raises
    ------
    OptionError
        If `out` is the map itself, or there is no drive.
    MapError
        If the map cannot be read, or no drive comes near it.
    FileError
        If a scan cannot be read, or `out` cannot be written.

    Notes
    -----
    Memory is bounded by the tiles in reach of a few looks, not by the drives.
    """
    options, report = options or UpdateOptions(), progress or (lambda step, done, total: None)
    if not drives:
        raise OptionError("Expected at least one drive to update a map with, got none. Name one.")
    twice = [name for name, number in Counter((drive.name, drive.sha256) for drive in drives).items() if number > 1]
    if twice:
        raise OptionError(
            f"Expected each drive once, got {twice[0][0]} more than once: its looks count once. Name it once."
        )
    if Path(out).resolve() == Path(parent).resolve():
        raise OptionError(f"Expected another folder than the map itself, got {out} for both. Name a new one.")
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
    files = open_storage(parent)
    manifest = read_manifest(files)
    point_map = PointMap.open(parent, cache_bytes=CACHE_BYTES, left_out=None)
    looks = looks_of(drives, point_map.frame, options)
    _check_inside(point_map, looks, options, parent)
    with atomic_folder(out, overwrite=overwrite) as folder:
        work = folder / "work"
        work.mkdir()
        judged = gather_evidence(point_map, drives, looks, options, work, report)
        times = LookTimes(np.array([look.time for look in looks]), np.array([look.drive for look in looks]))
        changes = Counter[str]()
        with MapWriter(folder) as writer:
            copier = _Copier(files, manifest, writer, changes)
            done, keys = 0, sorted(point_map.tile_keys | judged.n_voxels.keys())
            verdicts = find_verdicts(judged, times, options)
            for done, key in enumerate(keys, 1):
                if key in judged.n_voxels:
                    copier.put_judged(*next(verdicts))
                else:
                    copier.put_unchanged(key)
                report("writing tiles", done, len(keys))
            copier.put_ground()
            for path in work.iterdir():
                path.unlink()
            work.rmdir()
            update = {
                **_history(parent, manifest, drives, looks, options),
                **{name: changes[name] for name in ("n_judged", "n_now_gone", "n_now_new", "n_back")},
                **{f"n_{each.name.lower()}": changes[each.name] for each in SurfaceClass},
            }
            return writer.finish(
                cell=manifest.cell,
                origin=manifest.origin,
                crs=manifest.crs,
                is_signed=manifest.is_signed,
                sigma=manifest.sigma,
                build={**manifest.build, "updates": [*manifest.build.get("updates", []), update]},
            )


class _Copier:
    """Writes the tiles of the map into its new version, changed or as they are, and counts what changed."""

    def __init__(self, files: MapStorage, manifest: Manifest, writer: MapWriter, changes: "Counter[str]") -> None:
        self._tiles = Section(files, manifest, TILES)
        self._ground = Section(files, manifest, GROUND)
        self._classes = Section(files, manifest, CLASSES)
        self._writer = writer
        self._changes = changes

    def put_unchanged(self, key: TileKey) -> None:
        """Write a tile that no look reaches."""
        record = self._tiles.record(key)
        self._writer.put(record)
        classes = np.full(record.n_rows, SurfaceClass.KNOWN, np.uint8)
        if key in self._classes.keys:
            self._writer.put(self._classes.record(key))
            classes = classes_of_batch(self._classes.batch(key))
        self._count(classes)

    def put_judged(self, surfaces: Surfaces, classes: NDArray[np.uint8]) -> None:
        """Write a tile with the classes that were found; candidates that are not new are left out."""
        before, is_kept = surfaces.classes, classes != CANDIDATE
        tile = replace(surfaces.tile.rows(is_kept), classes=classes[is_kept])
        if not len(tile):
            return
        is_added = before[is_kept] == CANDIDATE
        self._writer.put(tile_record(tile) if is_added.any() else self._tiles.record(tile.key))
        if classes[is_kept].any():
            self._writer.put(classes_record(tile))
        self._count(classes[is_kept])
        evidence = surfaces.evidence
        self._changes["n_judged"] += int(((evidence.n_met + evidence.n_through > 0) & (before != CANDIDATE)).sum())
        self._changes["n_now_gone"] += int(((classes == SurfaceClass.GONE) & (before != SurfaceClass.GONE)).sum())
        self._changes["n_now_new"] += int(is_added.sum())
        self._changes["n_back"] += int(((classes == SurfaceClass.NEW) & (before == SurfaceClass.GONE)).sum())

    def put_ground(self) -> None:
        """Write the ground as it is."""
        for key in sorted(self._ground.keys):
            self._writer.put(self._ground.record(key))

    def _count(self, classes: NDArray[np.uint8]) -> None:
        for each in SurfaceClass:
            self._changes[each.name] += int(np.count_nonzero(classes == each))


def _check_inside(
    point_map: PointMap, looks: Sequence[Look], options: UpdateOptions, parent: str | os.PathLike[str]
) -> None:
    if not any(point_map.covers(look.pose.x, look.pose.y, options.reach) for look in looks):
        first = point_map.frame.pose_to_global(looks[0].pose)
        raise MapError(
            f"Expected drives through {parent}, but no pose comes near it; the first is at x {first.x:.7g}, y"
            f" {first.y:.7g} m. Was it localized in another map, or in another CRS?"
        )


def _history(
    parent: str | os.PathLike[str],
    manifest: Manifest,
    drives: Sequence[LocalizedDrive],
    looks: Sequence[Look],
    options: UpdateOptions,
) -> Mapping[str, Any]:
    """The entry of an update in the manifest: its parent, the drives, and the options."""
    n_looks = Counter(look.drive for look in looks)
    return {
        "program": f"maxcon {__version__}",
        "parent": {"name": Path(parent).name, "sha256": manifest.sha256},
        "drives": [
            {
                "name": drive.name,
                "sha256": drive.sha256,
                "n_epochs": drive.n_epochs,
                "n_localized": len(drive.rows),
                "n_looks": n_looks[number],
                "from_time": drive.rows[0][1].time,
                "to_time": drive.rows[-1][1].time,
            }
            for number, drive in enumerate(drives)
        ],
        "options": asdict(options),
    }
