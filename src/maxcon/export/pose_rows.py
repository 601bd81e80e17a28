# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PoseRow: one row of POSES.csv, or of the Parquet file of a drive among many, as it was written."""

import csv
import math
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maxcon.drive.poses_table import COLUMNS, COVARIANCES, UNKNOWNS
from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.io.text import numbered_lines, parse_float

PARQUET = ".parquet"
WORDS = ("status", "reason")


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One epoch.

    time: s.
    pose: global coordinates; None unless localized.
    status, reason: in words.
    numbers: score, milliseconds, protection levels and covariances by the names of their columns, those that are there.
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
    angles: dict[str, float | None] = dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg", "bearing_deg"))
    if row.pose is not None:
        angles = {f"{name}_deg": math.degrees(getattr(row.pose, name)) for name in ("roll", "pitch", "heading")}
        angles["bearing_deg"] = bearing_deg(row.pose)
    names = ("score", "ms", "protection_along", "protection_across", *COVARIANCES)
    numbers = {name: row.numbers.get(name) for name in names}
    return {"time": row.time, "status": row.status, **angles, **numbers, "reason": row.reason}


def read_rows(path: str | os.PathLike[str]) -> list[PoseRow]:
    """Return all rows of POSES.csv, or of the Parquet file of a drive (`.parquet`); FileError if it is none."""
    file = Path(path)
    values = _parquet_values(file) if file.suffix.lower() == PARQUET else _csv_values(file)
    rows = [_row(file, number, cells) for number, cells in values]
    if not rows:
        raise FileError(f"Expected a row per epoch in {file}, got none. Was it written to its end?")
    return rows


def _csv_values(file: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the number of each line and its cells by the names of their columns."""
    is_header = True
    for number, line in numbered_lines(file, "a table of poses"):
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as error:
            raise _refused(file, number, str(error)) from None
        if len(cells) != len(COLUMNS) or (is_header and tuple(cells) != COLUMNS):
            raise _refused(file, number, f"{len(cells)} columns, {line[:40]!r}")
        if not is_header:
            yield number, dict(zip(COLUMNS, cells, strict=True))
        is_header = False


def _parquet_values(file: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the number of each row and its values by the names of their columns."""
    import pyarrow
    import pyarrow.parquet

    def refused(got: str) -> FileError:
        return FileError(
            f"Expected the poses of a drive in {file}, as maxcon localize --drives writes them, got: {got}. Name"
            " another."
        )

    try:
        if not stat.S_ISREG(file.stat().st_mode):  # a FIFO would wait for ever
            raise refused("no file")
        with pyarrow.parquet.ParquetFile(file) as opened:
            missing = [name for name in COLUMNS if name not in opened.schema_arrow.names]
            if missing:
                raise refused(f"no column {missing[0]}")
            yield from enumerate(opened.read(columns=list(COLUMNS)).to_pylist(), 1)
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise refused(getattr(error, "strerror", None) or " ".join(str(error).split())[:200]) from None


def _row(file: Path, number: int, cells: dict[str, Any]) -> PoseRow:
    """Return the row of cells, texts or numbers; None or an empty text where a value is not known."""
    known = {name: value for name, value in cells.items() if value not in (None, "")}
    status, reason = (known.pop(name, "") for name in WORDS)
    parsed = {name: parse_float(value) if isinstance(value, str) else value for name, value in known.items()}
    numbers = {name: value for name, value in parsed.items() if isinstance(value, float) and math.isfinite(value)}
    wrong = [value for name, value in known.items() if name not in numbers]
    wrong += [text for text in (status, reason) if not isinstance(text, str)]
    if wrong:
        raise _refused(file, number, repr(wrong[0])[:40])
    if "time" not in numbers:
        raise _refused(file, number, "no time")
    unknowns = [numbers.pop(name) for name in UNKNOWNS if name in numbers]
    if len(unknowns) not in (0, len(UNKNOWNS)):
        raise _refused(file, number, "a part of a pose")
    return PoseRow(numbers.pop("time"), Pose(*unknowns) if unknowns else None, status, reason, numbers)


def _refused(file: Path, number: int, got: str) -> FileError:
    return FileError(
        f"{file}, line {number}: Expected a row of POSES.csv, as maxcon localize writes it, got {got}. Localize anew."
    )
