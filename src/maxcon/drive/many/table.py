# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The table of drives: name, scans, prior and map of each, CSV or TOML."""

import csv
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from maxcon._system.checked import read_toml
from maxcon._system.regular_file import read_regular
from maxcon.errors import FileError

__all__ = ["DriveEntry", "read_drives"]

LARGEST_TABLE = 2**28
"""Bytes: a million drives."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,99}")
NEEDED, OPTIONAL = ("name", "scans"), ("prior", "map", "times", "odometry")


@dataclass(frozen=True, slots=True)
class DriveEntry:
    """Where the parts of a drive are.

    Parameters
    ----------
    name : str
        Different from that of all other drives.
    scans : Path
        A folder, or a recording.
    map : Path or str
        The map it is localized in: a folder, or a URL.
    prior, times, odometry : Path or None
        As `maxcon localize` takes them.
    """

    name: str
    scans: Path
    map: Path | str
    prior: Path | None = None
    times: Path | None = None
    odometry: Path | None = None


def read_drives(path: str | os.PathLike[str], map_folder: Path | str | None = None) -> list[DriveEntry]:
    """Return the drives of a table; paths in it are relative to its folder.

    Parameters
    ----------
    path : path
        CSV with a header, of `name`, `scans` and, as far as needed, `prior`, `map`, `times`, `odometry`; or TOML with a
        table `[[drive]]` of the same keys for each.
    map_folder : Path, optional
        The map of drives that name none.

    Raises
    ------
    FileError
        If it is no such table, or names a drive twice, none, or one without scans or map.
    """
    file = Path(path)
    rows = _toml_rows(file) if file.suffix.lower() == ".toml" else _csv_rows(file)
    if not rows:
        raise FileError(f"Expected drives in {file}, got none. Add a row for each.")
    entries = [_entry(file, number, row, map_folder) for number, row in enumerate(rows, 1)]
    seen: set[str] = set()
    for entry in entries:
        folded = entry.name.casefold()  # some file systems do not tell case apart
        if folded in seen:
            raise FileError(
                f"Expected a name of its own for each drive in {file}, got {entry.name!r} twice. Rename one."
            )
        seen.add(folded)
    return entries


def _csv_rows(file: Path) -> list[dict[str, str]]:
    try:
        content = read_regular(file, LARGEST_TABLE + 1)
        if len(content) > LARGEST_TABLE:
            raise ValueError(f"it has more than {LARGEST_TABLE:,} bytes")
        lines = content.decode("utf-8-sig").splitlines()
        lines = [line for line in lines if line.strip() and not line.startswith("#")]
        header, *rows = list(csv.reader(lines, strict=True)) or [[]]
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise FileError(f"Expected a table of drives in {file}, got: {reason}. Write a CSV or TOML file.") from error
    names = [name.strip() for name in header]
    _check_keys(file, names)
    if len(set(names)) < len(names):
        raise FileError(f"Expected each column once in {file}, got {', '.join(names)}. Remove one.")
    for number, row in enumerate(rows, 1):
        if len(row) != len(names):
            raise FileError(
                f"Expected {len(names)} columns in row {number} of {file}, got {len(row)}. Correct it; a comma in a"
                " path stands in quotation marks."
            )
    return [dict(zip(names, (cell.strip() for cell in row), strict=True)) for row in rows]


def _toml_rows(file: Path) -> list[dict[str, str]]:
    named = read_toml(file, "a table of drives", "Write a CSV or TOML file")
    rows = named.get("drive")
    if set(named) != {"drive"} or not isinstance(rows, list):
        raise FileError(
            f"Expected a table [[drive]] for each drive in {file}, and nothing else, got"
            f" {', '.join(named) or 'nothing'}. Correct it."
        )
    for row in rows:
        values = row.values() if isinstance(row, dict) else [None]
        if not all(isinstance(value, str) for value in values):
            raise FileError(f"Expected words as values of [[drive]] in {file}, got {row!r}. Put them in quotes.")
        _check_keys(file, list(row))
    return rows


def _check_keys(file: Path, names: Sequence[str]) -> None:
    unknown = [name for name in names if name not in NEEDED + OPTIONAL]
    missing = [name for name in NEEDED if name not in names]
    if unknown or missing:
        got = f"none of {', '.join(missing)}" if missing else f"{unknown[0][:40]!r}"
        raise FileError(
            f"Expected {', '.join(NEEDED)} and, where needed, {', '.join(OPTIONAL)} for each drive in {file}, got"
            f" {got}. Correct it."
        )


def _entry(file: Path, number: int, row: Mapping[str, str], map_folder: Path | str | None) -> DriveEntry:
    def path(key: str) -> Path | None:
        return file.parent.absolute() / row[key] if row.get(key) else None

    name, scans, own_map = row["name"], path("scans"), path("map") or map_folder
    if "://" in row.get("map", ""):
        own_map = row["map"]
    if not NAME.fullmatch(name):
        raise FileError(
            f"Expected a name of up to 100 letters, digits and . _ + - for drive {number} of {file}, got {name[:40]!r}:"
            " a folder is named by it. Rename it."
        )
    if scans is None or own_map is None:
        what = "scans" if scans is None else "a map"
        raise FileError(
            f"Expected {what} for drive {name} in {file}, got none. Name"
            f" {'them' if scans is None else 'it there, or one MAP for all'}."
        )
    return DriveEntry(name, scans, own_map, path("prior"), path("times"), path("odometry"))
