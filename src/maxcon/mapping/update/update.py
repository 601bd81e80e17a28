# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Map update: a new version of a map, in which surfaces that drives found gone or new have a class of their own."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from shutil import rmtree
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
from maxcon.map.store import MapWriter, Section, classes_record, tile_record
from maxcon.mapping.update.classification import classify
from maxcon.mapping.update.evidence import CANDIDATE, Surfaces, gather_evidence
from maxcon.mapping.update.observations import LocalizedDrive, Observation, observations_of
from maxcon.mapping.update.options import UpdateOptions

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

    Memory is bounded by the tiles in reach of a few observations, not by the drives.

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
        Whether a map that is at `out` is replaced; anything else there is an error, and so is the map itself.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Manifest
        Of the new version. Under `updates` of its `build` it names its parent by checksum, and the drives.

    Raises
    ------
    OptionError
        If `out` is the map itself, or there is no drive, or one is named twice.
    MapError
        If the map cannot be read, or no drive comes near it.
    FileError
        If a scan cannot be read, or `out` cannot be written.
    """
    options, report = options or UpdateOptions(), progress or (lambda step, done, total: None)
    _check(parent, drives, out)
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
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
    with atomic_folder(out, overwrite=overwrite) as folder:
        work = folder / "work"
        work.mkdir()
        evidence = gather_evidence(point_map, drives, observations, options, work, report)
        with MapWriter(folder) as writer:
            copier = _Copier(files, manifest, writer)
            keys = sorted(point_map.tile_keys | evidence.n_voxels.keys())
            classified = classify(evidence, observations, options)
            for done, key in enumerate(keys, 1):
                if key in evidence.n_voxels:
                    copier.put_classified(*next(classified))
                else:
                    copier.put_unchanged(key)
                report("writing tiles", done, len(keys))
            copier.put_ground()
            rmtree(work)
            update = {
                "program": f"maxcon {__version__}",
                "parent": {"name": Path(parent).name, "sha256": manifest.sha256},
                "drives": _describe(drives, observations),
                "options": asdict(options),
                **copier.counts,
            }
            return writer.finish(
                cell=manifest.cell,
                origin=manifest.origin,
                crs=manifest.crs,
                is_signed=manifest.is_signed,
                sigma=manifest.sigma,
                build={**manifest.build, "updates": [*manifest.build.get("updates", []), update]},
            )


def _check(parent: str | os.PathLike[str], drives: Sequence[LocalizedDrive], out: str | os.PathLike[str]) -> None:
    """Refuse no drives, a drive twice, and to write over the map itself."""
    if not drives:
        raise OptionError("Expected at least one drive to update a map with, got none. Name one.")
    twice = [name for (name, _), n in Counter((drive.name, drive.sha256) for drive in drives).items() if n > 1]
    if twice:
        raise OptionError(
            f"Expected each drive once, got {twice[0]} more than once: its observations count once. Name it once."
        )
    if Path(out).resolve() == Path(parent).resolve():
        raise OptionError(f"Expected another folder than the map itself, got {out} for both. Name a new one.")


class _Copier:
    """Writes the tiles of the map into its new version, changed or as they are, and counts what changed."""

    def __init__(self, files: MapStorage, manifest: Manifest, writer: MapWriter) -> None:
        self._tiles = Section(files, manifest, TILES)
        self._ground = Section(files, manifest, GROUND)
        self._classes = Section(files, manifest, CLASSES)
        self._writer = writer
        changes = ("n_judged", "n_now_gone", "n_now_new", "n_back")
        self.counts: dict[str, int] = dict.fromkeys([*changes, *(f"n_{each.name.lower()}" for each in SurfaceClass)], 0)

    def put_unchanged(self, key: TileKey) -> None:
        """Write a tile that no observation reaches."""
        record = self._tiles.record(key)
        self._writer.put(record)
        classes = np.full(record.n_rows, SurfaceClass.KNOWN, np.uint8)
        if key in self._classes.keys:
            self._writer.put(self._classes.record(key))
            (classes,) = self._classes.columns(key)
        self._count(classes)

    def put_classified(self, surfaces: Surfaces, classes: NDArray[np.uint8]) -> None:
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
        is_seen = surfaces.evidence.n_hits + surfaces.evidence.n_misses > 0
        was_gone = before == SurfaceClass.GONE
        for name, is_changed in (
            ("n_judged", is_seen & (before != CANDIDATE)),
            ("n_now_gone", (classes == SurfaceClass.GONE) & ~was_gone),
            ("n_now_new", is_added),
            ("n_back", (classes == SurfaceClass.NEW) & was_gone),
        ):
            self.counts[name] += int(is_changed.sum())

    def put_ground(self) -> None:
        """Write the ground as it is."""
        for key in sorted(self._ground.keys):
            self._writer.put(self._ground.record(key))

    def _count(self, classes: NDArray[np.uint8]) -> None:
        for each in SurfaceClass:
            self.counts[f"n_{each.name.lower()}"] += int(np.count_nonzero(classes == each))


def _describe(drives: Sequence[LocalizedDrive], observations: Sequence[Observation]) -> list[Mapping[str, Any]]:
    """Return the drives of an update, for the manifest."""
    n_observations = Counter(each.drive for each in observations)
    return [
        {
            "name": drive.name,
            "sha256": drive.sha256,
            "n_epochs": drive.n_epochs,
            "n_localized": len(drive.rows),
            "n_looks": n_observations[number],
            "from_time": drive.rows[0][1].time,
            "to_time": drive.rows[-1][1].time,
        }
        for number, drive in enumerate(drives)
    ]
