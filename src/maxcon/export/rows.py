# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PoseRow: one row of POSES.csv, or of the Parquet file of a drive, as it was written."""

import csv
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from maxcon.drive.poses_table import COLUMNS, COVARIANCES, UNKNOWNS
from maxcon.errors import FileError
from maxcon.export.parquet_rows import PARQUET, parquet_values
from maxcon.geometry import Pose
from maxcon.io.text import numbered_lines, parse_float

__all__ = ["PoseRow", "bearing_deg", "properties", "read_rows"]

WORDS = ("status", "reason")


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One epoch.

    Parameters
    ----------
    time : float
        s.
    pose : Pose or None
        Global coordinates; None unless localized.
    status, reason : str
        In words.
    numbers : dict of str to float
        Score, milliseconds, protection levels and covariances by the names of their columns, those that are there.
    """

    time: float
    pose: Pose | None
    status: str
    reason: str
    numbers: dict[str, float]


def bearing_deg(pose: Pose) -> float:
    """Heading as a compass has it: from the grid's north, clockwise, 0 to 360 degrees."""
    return (90.0 - math.degrees(pose.heading)) % 360.0


def properties(row: PoseRow) -> dict[str, float | str | None]:
    """Everything but the position of a row, by names that say the unit of angles; None where it is not known."""
    pose = row.pose
    angles: dict[str, float | None] = dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg", "bearing_deg"))
    if pose is not None:
        turns = {"roll_deg": pose.roll, "pitch_deg": pose.pitch, "heading_deg": pose.heading}
        angles = {name: math.degrees(turn) for name, turn in turns.items()}
        angles["bearing_deg"] = bearing_deg(pose)
    names = ("score", "ms", "protection_along", "protection_across", *COVARIANCES)
    numbers = {name: row.numbers.get(name) for name in names}
    return {"time": row.time, "status": row.status, **angles, **numbers, "reason": row.reason}


def read_rows(path: str | os.PathLike[str]) -> list[PoseRow]:
    """Return all rows of POSES.csv, or of the Parquet file of a drive (`.parquet`).

    Raises
    ------
    FileError
        If it cannot be read, or is no such table.
    """
    file = Path(path)
    rows = list(_parquet_rows(file) if file.suffix.lower() == PARQUET else _rows(file))
    if not rows:
        raise FileError(f"Expected a row per epoch in {file}, got none. Was it written to its end?")
    return rows


def _rows(file: Path) -> Iterator[PoseRow]:
    is_header = True
    for number, line in numbered_lines(file, "a table of poses"):
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as error:
            raise _refused(file, number, str(error)) from None
        if len(cells) != len(COLUMNS) or (is_header and tuple(cells) != COLUMNS):
            raise _refused(file, number, f"{len(cells)} columns, {line[:40]!r}")
        if not is_header:
            yield _row(file, number, dict(zip(COLUMNS, cells, strict=True)))
        is_header = False


def _parquet_rows(file: Path) -> Iterator[PoseRow]:
    for number, values in enumerate(parquet_values(file), 1):
        texts = {name: values.pop(name, "") for name in WORDS}
        wrong = [value for value in values.values() if not isinstance(value, float) or not math.isfinite(value)]
        wrong += [text for text in texts.values() if not isinstance(text, str)]
        if wrong:
            raise _refused(file, number, repr(wrong[0])[:40])
        yield _pose_row(file, number, values, texts)


def _row(file: Path, number: int, cells: dict[str, str]) -> PoseRow:
    texts = {name: text for name, text in cells.items() if text and name not in WORDS}
    values = {name: parse_float(text) for name, text in texts.items()}
    wrong = [texts[name] for name, value in values.items() if value is None]
    if wrong:
        raise _refused(file, number, repr(wrong[0][:40]))
    return _pose_row(file, number, {name: value for name, value in values.items() if value is not None}, cells)


def _pose_row(file: Path, number: int, numbers: dict[str, float], texts: Mapping[str, str]) -> PoseRow:
    if "time" not in numbers:
        raise _refused(file, number, "no time")
    place = [numbers.pop(name, None) for name in UNKNOWNS]
    known = [value for value in place if value is not None]
    if known and len(known) < len(place):
        raise _refused(file, number, "a part of a pose")
    pose = Pose(*known) if known else None
    return PoseRow(numbers.pop("time"), pose, texts["status"], texts["reason"], numbers)


def _refused(file: Path, number: int, got: str) -> FileError:
    return FileError(
        f"{file}, line {number}: Expected a row of POSES.csv, as maxcon localize writes it, got {got}. Localize anew."
    )
