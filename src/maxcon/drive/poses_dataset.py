# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The poses of many drives as a Parquet dataset, a folder for each drive, and the provenance of its rows."""

import hashlib
import inspect
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon._system.atomic import write_json
from maxcon._system.checked import checked, read_json
from maxcon._system.regular_file import sha256_of_file
from maxcon._system.resumable import ResumableTable, differences
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.poses_table import COLUMNS, pose_values
from maxcon.errors import FileError, OptionError
from maxcon.map.manifest import MANIFEST, MAX_MANIFEST_BYTES
from maxcon.map.storage import address_of, open_storage

if TYPE_CHECKING:
    import pyarrow

__all__ = ["OPTIONS", "PosesDataset", "describe", "poses_schema", "table_of_drive"]

TEXTS = ("status", "reason")
OPTIONS, SOURCES = "_options.json", "_drives.json"
LARGEST_HASHED = 2**26
"""Bytes; larger files (recordings) are known by path and size instead of their checksum."""


def poses_schema() -> "pyarrow.Schema":
    """Arrow schema of the poses: the columns of POSES.csv, and the number of the epoch before them."""
    import pyarrow

    columns = [pyarrow.field("epoch", pyarrow.int32())]
    columns += [pyarrow.field(name, pyarrow.string() if name in TEXTS else pyarrow.float64()) for name in COLUMNS]
    return pyarrow.schema(columns)


class PosesDataset:
    """The dataset in a folder. A drive is published once all its epochs are done; until then its rows are in _parts.

    folder: `drive=NAME/poses.parquet` for each drive.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._parts = folder / "_parts"

    def table(self, name: str) -> ResumableTable:
        """Return the table of a drive, done or not."""
        path, parts = self.folder / f"drive={name}" / "poses.parquet", self._parts / name
        return ResumableTable(path, parts, poses_schema(), ("epoch",), "poses of a drive")

    def is_done(self, name: str) -> bool:
        """Whether a drive is done."""
        return self.table(name).path.exists()

    def has_rows(self, name: str) -> bool:
        """Whether a drive has rows, done or not."""
        return self.is_done(name) or bool(self.table(name).part_paths())

    def has_any_rows(self) -> bool:
        """Whether any drive has rows, done or not."""
        return any(self._parts.glob("*/[!.]*.parquet")) or any(self.folder.glob("drive=*/poses.parquet"))

    def add(self, name: str, epochs: Sequence[EpochEstimate]) -> None:
        """Write rows of a drive that is not done yet; FileError if they cannot be written."""
        self.table(name).add([{"epoch": epoch.epoch, **pose_values(epoch)} for epoch in epochs])

    def rows(self, name: str) -> "pyarrow.Table":
        """Return the rows of a drive that have been written, done or not, by epoch; FileError if a file is broken."""
        return self.table(name).read()

    def statuses(self, name: str) -> list[str]:
        """Return the status of each epoch of a drive that is done; no other column is read."""
        table = self.table(name)
        found: list[str] = table.read_file(table.path, ["status"]).column("status").to_pylist()
        return found

    def publish(self, name: str) -> None:
        """Publish a drive whose rows are complete, in one step; FileError if it cannot be written."""
        self.table(name).merge()
        self.clear(name)

    def clear(self, name: str) -> None:
        """Remove the parts of a drive that is done."""
        self.table(name).clear()
        if self._parts.exists() and not any(self._parts.iterdir()):
            self._parts.rmdir()

    def check_options(self, wanted: dict[str, Any]) -> None:
        """Write down the options; OptionError if there are rows that were made with others: they cannot be compared."""
        path = self.folder / OPTIONS
        if not (path.exists() and self.has_any_rows()):
            write_json(path, wanted)
            return
        found = _read(path, dict[str, Any], "the options of a dataset")
        wanted = json.loads(json.dumps(wanted))
        if found != wanted:
            raise OptionError(
                f"Expected to go on with the poses in {self.folder} by the same maxcon with the same options, as"
                f" {path.name} there has them, {differences(found, wanted)}. Give the same, or name another folder."
            )

    def check_sources(self, drives: Mapping[str, Mapping[str, Path | str | None]]) -> None:
        """Write down the map, scans, prior, ... of drives; OptionError if one has rows that were made from others."""
        path = self.folder / SOURCES
        known = _read(path, dict[str, dict[str, Any]], "the sources of drives") if path.exists() else {}
        map_of = cache(_map_identity)  # many drives share one
        for name, sources in drives.items():
            wanted = {
                what: map_of(place) if what == "map" and place is not None else _file_identity(place)
                for what, place in sources.items()
            }
            found = known.get(name, wanted)
            if found != wanted and self.has_rows(name):
                different = sorted(key for key in wanted if wanted[key] != found.get(key))
                raise OptionError(
                    f"Expected to go on with drive {name} in {self.folder} as it was begun, but its"
                    f" {' and '.join(different)} {'are others' if len(different) > 1 else 'is another'}. Name another"
                    f" folder, or remove drive={name} (and _parts/{name}) there to localize it anew."
                )
            known[name] = wanted
        write_json(path, known)


def table_of_drive(folder: Path, name: str | None) -> Path:
    """Return the file with the poses of a drive in a dataset; of the only one there, if none is named.

    FileError if the folder is no such dataset; OptionError if the drive is not in it, or not done, or none is named of
    several.
    """
    names = sorted(path.parent.name.removeprefix("drive=") for path in folder.glob("drive=*/poses.parquet"))
    few = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    if not names:
        raise FileError(
            f"Expected POSES.csv, or a folder of maxcon localize --drives with a drive in it that is done, got {folder}"
            " with none. Name another."
        )
    if name is None and len(names) > 1:
        raise OptionError(f"Expected --drive NAME with one of the drives in {folder}, {few}, got none. Name it.")
    if name is not None and name not in names:
        is_begun = name in {path.name for path in folder.glob("_parts/*")}
        raise OptionError(
            f"Expected --drive to be one of the drives in {folder} that are done, {few}, got {name!r}."
            f" {'Go on with it by the same localize command' if is_begun else 'Name one of them'}."
        )
    return PosesDataset(folder).table(name or names[0]).path


def _read(path: Path, kind: Any, what: str) -> Any:
    return checked(read_json(path, what, "Name another folder"), kind, path, what, "Name another folder")


def _map_identity(place: Path | str) -> str:
    """Identity of a map: the checksum of its manifest, or where it should be if that cannot be read."""
    where = address_of(place) or str(Path(place).absolute())
    try:
        content = open_storage(place).read(MANIFEST, MAX_MANIFEST_BYTES)
    except OSError:
        return where  # opening the drive will say that there is no map
    return hashlib.sha256(content).hexdigest()


def _file_identity(place: Path | str | None) -> str | None:
    """Identity of a file: its checksum; the path of a folder; path and size of a large file."""
    if place is None:
        return None
    path = Path(place).absolute()
    try:
        if not path.is_file():
            return str(path)
        size = path.stat().st_size
        return sha256_of_file(path) if size <= LARGEST_HASHED else f"{path}, {size} bytes"
    except OSError:
        return str(path)  # that it cannot be read is said where the drive is opened


# --- descriptions -----------------------------------------------------------------------------------------------


def describe(value: Any) -> Any:
    """Describe an object as JSON can hold it: the name of its class and the values of its public fields, recursively.

    Two methods of equal fields have the same description. OptionError if something in it has none: a function, say.
    """
    if isinstance(value, Enum):
        return describe(value.value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return describe(value.item())
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return {"class": "array", "type": str(value.dtype), "shape": list(value.shape), "sha256": digest}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, tuple | list):
        return [describe(item) for item in value]
    if isinstance(value, dict):
        return {str(key): describe(item) for key, item in value.items()}
    kind = type(value)
    is_ours = kind.__module__.startswith("maxcon.")
    own = {"class": kind.__qualname__} if is_ours else {
        "class": f"{kind.__module__}.{kind.__qualname__}", "source": _source(kind)
    }  # fmt: skip
    return own | {key: describe(item) for key, item in _fields(value).items()}


def _source(kind: type) -> str:
    """First 16 digits of the hash of the source of a user's class: it changes when the class is edited."""
    try:
        return hashlib.sha256(inspect.getsource(kind).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return "unknown"


def _fields(value: Any) -> dict[str, Any]:
    """Public values of an object by their names."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.repr}
    if not hasattr(value, "__dict__") or isinstance(value, type) or callable(value):
        raise OptionError(
            f"Expected a method made of numbers, words and objects of such, got {value!r} in it, which cannot be"
            " written down. Make it a dataclass, or hide it behind an underscore."
        )
    return {key: item for key, item in sorted(vars(value).items()) if not key.startswith("_")}
