# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PoseRow: one row of POSES.csv, or of the Parquet file of a drive among many, as it was written."""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import check_regular
from maxcon.drive.poses_table import COLUMNS, COVARIANCES, FORMATS, UNKNOWNS
from maxcon.geometry import Pose
from maxcon.io.clouds.base import as_file_error
from maxcon.io.text import parse_float, read_pose_table

PARQUET = ".parquet"
WORDS = ("status", "reason", "scan", "crs")


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One epoch."""

    time: float  # s
    pose: Pose | None  # global coordinates; None unless localized
    # status, reason: in words
    status: str
    reason: str
    # All other numbers by the names of their columns, those that are there
    numbers: dict[str, float]
    scan: str = ""  # its name
    crs: str = ""  # of the pose

    @property
    def words(self) -> str:
        """Status and reason in a line."""
        return ": ".join(filter(None, [self.status, self.reason]))


def bearing_deg(pose: Pose) -> float:
    """Heading as a compass has it: from the grid's north, clockwise, 0 to 360 degrees."""
    return (90.0 - math.degrees(pose.heading)) % 360.0


def properties(row: PoseRow) -> dict[str, float | str | None]:
    """Everything in a row, by names that say the unit of angles; None where it is not known."""
    position, angles = dict.fromkeys("xyz"), dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg", "bearing_deg"))
    if row.pose is not None:
        position = dict(zip("xyz", row.pose.position.tolist(), strict=True))
        turns = (*np.degrees(row.pose.values[3:]).tolist(), bearing_deg(row.pose))
        angles = dict(zip(angles, turns, strict=True))
    numbers = {name: row.numbers.get(name) for name in FORMATS if FORMATS[name] and name not in ("time", *UNKNOWNS)}
    first = {"time": row.time, "scan": row.scan, **position, "status": row.status}
    return {**first, **angles, **numbers, "reason": row.reason}


def covariance_of(row: PoseRow) -> NDArray[np.float64]:
    """Of x, y, z and the turns about the three axes, (6, 6); zeros where it is not known."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = [row.numbers.get(name, 0.0) for name in COVARIANCES]
    return matrix + np.triu(matrix, 1).T


def read_rows(path: str | os.PathLike[str]) -> list[PoseRow]:
    """Return all rows of POSES.csv, or of the Parquet file of a drive (`.parquet`); FileError if it is none."""
    file = Path(path)
    with as_file_error(file, "a table such as POSES.csv of maxcon localize"):
        values = _parquet_values(file) if file.suffix.lower() == PARQUET else _csv_values(file)
        rows = [_row(label, cells) for label, cells in values]
        if not rows:
            raise ValueError("not a row per epoch, but none")
    return rows


def _csv_values(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the number of each line and its cells by the names of their columns."""
    table = read_pose_table(file, "a table of poses")
    if table.names and tuple(table.names) != COLUMNS:
        raise ValueError(f"{len(table.names)} other columns, {','.join(table.names)[:40]!r}")
    if table.faults:
        raise ValueError(f"in line {min(table.faults)}: {table.faults[min(table.faults)]}")
    for number, cells in zip(table.lines, table.rows, strict=True):
        yield f"line {number}", dict(zip(COLUMNS, cells, strict=True))


def _parquet_values(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the number of each row and its values by the names of their columns."""
    import pyarrow.parquet

    check_regular(file)
    with pyarrow.parquet.ParquetFile(file) as opened:
        missing = [name for name in COLUMNS if name not in opened.schema_arrow.names]
        if missing:
            raise ValueError(f"no column {missing[0]}")
        for number, row in enumerate(opened.read(columns=list(COLUMNS)).to_pylist(), 1):
            yield f"row {number}", row


def _row(label: str, cells: dict[str, Any]) -> PoseRow:
    """The row of cells, texts or numbers; None or an empty text where a value is not known."""
    known = {name: value for name, value in cells.items() if value not in (None, "")}
    words = [known.pop(name, "") for name in WORDS]
    parsed = {name: parse_float(value) if isinstance(value, str) else value for name, value in known.items()}
    values = {name: value for name, value in parsed.items() if isinstance(value, int | float)}
    numbers = {name: float(value) for name, value in values.items() if math.isfinite(value)}
    wrong = [value for name, value in known.items() if name not in numbers]
    wrong += [text for text in words if not isinstance(text, str)]
    if wrong or "time" not in numbers:
        raise ValueError(f"in {label}: {repr(wrong[0])[:40] if wrong else 'no time'}")
    unknowns = [numbers.pop(name) for name in UNKNOWNS if name in numbers]
    if len(unknowns) not in (0, len(UNKNOWNS)):
        raise ValueError(f"in {label}: a part of a pose")
    status, reason, *names = words
    return PoseRow(numbers.pop("time"), Pose(*unknowns) if unknowns else None, status, reason, numbers, *names)
