# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Copying a map from one place to another: checked on its way, and there only once it is whole."""

import os
from pathlib import Path

from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.progress import Progress
from maxcon.errors import FileError, OptionError
from maxcon.map.manifest import MANIFEST, MAP_NAMES, TILE_FILES_VERSION, Manifest, file_names, read_manifest
from maxcon.map.section import Section
from maxcon.map.storage import Folder, MapFiles, address_of, open_place
from maxcon.map.writer import MapWriter

__all__ = ["copy_map"]

AHEAD = 16
"""Records that are announced ahead of the one that is copied."""


def copy_map(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Manifest:
    """Copy a map to a folder, or from a folder to an address; every record is checked on its way.

    A map of an earlier format version is converted to the current one. At an address the manifest is written last, so
    that nobody sees half a map; files of a map that was there before stay, for those who are still reading it.

    Parameters
    ----------
    source, target : path or str
        A folder, or `s3://bucket/prefix`; a source may be `http://` or `https://` too. One of both is a folder.
    overwrite : bool
        Whether a map that is there is replaced.
    progress : callable, optional
        Called with (step, done, of how many).

    Returns
    -------
    Manifest
        Of the map that was copied.

    Raises
    ------
    FileError
        If a map is there, or it cannot be written.
    MapError
        If the source is no map, or one of its records is not what was written.
    """
    report = progress or (lambda step, done, total: None)
    address = address_of(target)
    if address is not None and not address.startswith("s3://"):
        raise OptionError(f"Expected a folder or s3:// to copy to, got {address}: a web server is only read.")
    files = open_place(source, uses_cache=False)
    manifest = read_manifest(files)
    if address is None:
        if overwrite:
            check_replaceable(target, "a map", MAP_NAMES)
        with atomic_folder(target, overwrite=overwrite) as folder:
            return _rewrite(files, manifest, folder, report)
    if not isinstance(files, Folder) or manifest.version == TILE_FILES_VERSION:
        what = "a map of this format version" if isinstance(files, Folder) else "a map in a folder"
        raise FileError(f"Expected {what}, to copy it to {address}, got {source}. Copy it to a folder first.")
    _check_records(files, manifest, report)
    _publish(files, address, overwrite, report)
    return manifest


def _rewrite(files: MapFiles, manifest: Manifest, folder: Path, report: Progress) -> Manifest:
    """Write all records of a map into a folder, in the order in which they lie in the shards."""
    sections = [Section(files, manifest, name) for name in manifest.sections]
    n_records, done = sum(len(section.keys) for section in sections), 0
    with MapWriter(folder) as writer:
        for section in sections:
            keys = section.keys_in_order()
            for number, key in enumerate(keys):
                section.announce(keys[number : number + AHEAD])
                writer.put(section.record(key))
                done += 1
                report("copying tiles", done, n_records)
        return writer.finish(
            cell=manifest.cell, origin=manifest.origin, crs=manifest.crs, is_signed=manifest.is_signed,
            sigma=manifest.sigma, build=manifest.build,
        )  # fmt: skip


def _check_records(files: MapFiles, manifest: Manifest, report: Progress) -> None:
    """Read every record, so that nothing damaged is published."""
    sections = [Section(files, manifest, name) for name in manifest.sections]
    n_records, done = sum(len(section.keys) for section in sections), 0
    for section in sections:
        for key in section.keys_in_order():
            section.record(key)
            done += 1
            report("checking tiles", done, n_records)


def _publish(files: Folder, address: str, overwrite: bool, report: Progress) -> None:
    """Write the files of a map to an address, without those that are there already, and the manifest last.

    Raises
    ------
    FileError
        If a map is there that shall not be replaced, or the server refuses.
    """
    from maxcon.map.storage.remote import Remote

    remote = Remote(address, None)
    paths = {name: Path(files.where(name)) for name in file_names(files)}
    try:
        sizes = {name: path.stat().st_size for name, path in paths.items()}
        if not overwrite and remote.size(MANIFEST) is not None:
            raise FileError(
                f"Expected no map at {address} yet, but there is one. Name another place, or allow"
                " replacing it (--overwrite)."
            )
        done = 0
        for name, path in paths.items():
            if remote.size(name) != sizes[name]:
                remote.write(name, path)
            done += sizes[name]
            report("copying bytes", done, sum(sizes.values()))
        remote.write(MANIFEST, Path(files.where(MANIFEST)).read_bytes())
    except OSError as error:
        raise FileError(
            f"Expected to be able to write to {address}, got: {error.strerror or error}. What was written is no map"
            " yet; the same command goes on with it."
        ) from None
