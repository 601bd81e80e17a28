# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The options and inputs of a dataset of poses, written down: it is continued only with the same ones."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from maxcon._system.atomic import write_json
from maxcon._system.regular_file import read_regular
from maxcon._system.resumable import differences
from maxcon.drive.many.poses_dataset import PosesDataset
from maxcon.drive.many.table import DriveEntry
from maxcon.errors import FileError, OptionError
from maxcon.map.manifest import MANIFEST, MAX_MANIFEST_BYTES
from maxcon.map.storage import address_of, open_storage

__all__ = ["OPTIONS", "check_options", "check_sources"]

OPTIONS, SOURCES = "_options.json", "_drives.json"
LARGEST_OPTIONS, LARGEST_SOURCES = 2**20, 2**30
LARGEST_HASHED = 2**26
"""Bytes; larger files (recordings) are known by path and size instead of their checksum."""


def check_options(dataset: PosesDataset, wanted: dict[str, Any]) -> None:
    """Write down the options of a dataset; refuse to continue it with others: its rows would not be comparable.

    Raises
    ------
    OptionError
        If it has rows that were made with other options.
    FileError
        If what was written down cannot be read, or not be written.
    """
    path = dataset.folder / OPTIONS
    if not (path.exists() and dataset.has_any_rows()):
        write_json(path, wanted)
        return
    found = _read(path, LARGEST_OPTIONS, "the options of a dataset")
    wanted = json.loads(json.dumps(wanted))
    if found != wanted:
        raise OptionError(
            f"Expected to go on with the poses in {dataset.folder} by the same maxcon with the same options, as"
            f" {path.name} there has them, {differences(found, wanted)}. Give the same, or name another folder."
        )


def check_sources(dataset: PosesDataset, entries: Sequence[DriveEntry]) -> None:
    """Write down the inputs of drives; refuse to continue a drive with another map, scans or prior.

    Raises
    ------
    OptionError
        If a drive has rows that were made from other inputs.
    FileError
        If what was written down cannot be read, or not be written.
    """
    path = dataset.folder / SOURCES
    known = _read(path, LARGEST_SOURCES, "the sources of drives") if path.exists() else {}
    if not all(isinstance(each, dict) for each in known.values()):
        raise FileError(f"Expected the sources of drives in {path}, got something else. Name another folder.")
    map_of = cache(_map)  # many drives share one
    for entry in entries:
        parts = {name: _file(getattr(entry, name)) for name in ("scans", "prior", "times", "odometry")}
        wanted = {"map": map_of(entry.map), **parts}
        found = known.get(entry.name, wanted)
        if found != wanted and dataset.has_rows(entry.name):
            different = sorted(key for key in wanted if wanted[key] != found.get(key))
            raise OptionError(
                f"Expected to go on with drive {entry.name} in {dataset.folder} as it was begun, but its"
                f" {' and '.join(different)} {'are others' if len(different) > 1 else 'is another'}. Name another"
                f" folder, or remove drive={entry.name} (and _parts/{entry.name}) there to localize it anew."
            )
        known[entry.name] = wanted
    write_json(path, known)


def _read(path: Path, most_bytes: int, what: str) -> dict[str, Any]:
    try:
        found = json.loads(read_regular(path, most_bytes).decode("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FileError(f"Expected {what} in {path}, got: {error}. Name another folder.") from error
    if not isinstance(found, dict):
        raise FileError(f"Expected {what} in {path}, got something else. Name another folder.")
    return found


def _map(place: Path | str) -> str:
    """Identity of a map: the checksum of its manifest, or where it should be if that cannot be read."""
    where = address_of(place) or str(Path(place).absolute())
    try:
        content = open_storage(place).read(MANIFEST, MAX_MANIFEST_BYTES)
    except OSError:
        return where  # opening the drive will say that there is no map
    return hashlib.sha256(content).hexdigest()


def _file(path: Path | None) -> str | None:
    """Identity of a file: its checksum; the path of a folder; path and size of a large file."""
    if path is None:
        return None
    try:
        if not path.is_file():
            return str(path.absolute())
        size = path.stat().st_size
        if size > LARGEST_HASHED:
            return f"{path.absolute()}, {size} bytes"
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return str(path.absolute())  # that it cannot be read is said where the drive is opened
