# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""CSV with angles in degrees, and the heading as a compass has it, too."""

import csv
import os
from collections.abc import Sequence

from maxcon._system.atomic import atomic_file
from maxcon.export.rows import PoseRow, properties

__all__ = ["write_degrees"]


def write_degrees(path: str | os.PathLike[str], rows: Sequence[PoseRow]) -> None:
    """Write time (s), position (m), angles (degrees) and all else of every epoch; `read_trajectory` reads it, too."""
    with atomic_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for number, row in enumerate(rows):
            known = properties(row)
            place = dict.fromkeys("xyz") if row.pose is None else dict(zip("xyz", row.pose.position, strict=True))
            cells = {"time": known.pop("time"), **place, **known}
            if number == 0:
                writer.writerow(cells)
            writer.writerow("" if value is None else _text(name, value) for name, value in cells.items())


def _text(name: str, value: float | str) -> str:
    if isinstance(value, str):
        return value
    decimals = {"time": 9, "x": 4, "y": 4, "z": 4}.get(name, 7 if name.endswith("_deg") else None)
    return f"{value:.6g}" if decimals is None else f"{value:.{decimals}f}"
