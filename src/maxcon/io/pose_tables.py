# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tables of poses as text: cells by the names of their columns, numbers in SI units, and faults by line."""

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import TrajectoryError
from maxcon.io.text import numbered_lines, parse_float

CSV_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "heading")
COVARIANCE_COLUMNS = (
    "cov_x_x", "cov_x_y", "cov_x_heading", "cov_y_y", "cov_y_heading", "cov_heading_heading",
)  # fmt: skip
ANGLES = ("roll", "pitch", "heading", "azimuth", "sigma_heading")
"""In rad, or in degrees as NAME_deg."""
OTHER_NAMES = {"time": ("timestamp",)}
UNCLEAR_HEADINGS = ("yaw", "yaw_deg", "azimuth", "bearing", "course", "theta")
"""Headings of other programs: some count from the north, or clockwise."""


class TableColumn(NamedTuple):
    """Where a quantity stands in a row, and the factor to s, m, rad."""

    place: int
    scale: float = 1.0


@dataclass(slots=True, eq=False)
class PoseTable:
    """Rows of a table, as texts.

    file: for messages.
    names: of the columns, in small letters; empty if the file holds no line.
    header_line: counted from 1.
    lines: of each row.
    rows: cells, as many as there are names.
    faults: what is wrong with lines that are no rows.
    """

    file: Path
    names: list[str]
    header_line: int
    lines: list[int] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    faults: dict[int, str] = field(default_factory=dict)

    def refuse(self, words: str, line: int | None = None) -> NoReturn:
        """Raise TrajectoryError because of a line, that of the header if none is given."""
        raise TrajectoryError(f"{self.file}, line {self.header_line if line is None else line}: {words}")

    def add_faults(self, is_wrong: NDArray[np.bool_], words: str | Callable[[int], str]) -> None:
        """Tell of rows that are wrong; the first fault of a line counts."""
        for row in np.flatnonzero(is_wrong).tolist():
            self.faults.setdefault(self.lines[row], words if isinstance(words, str) else words(row))

    def good(self, *arrays: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Leave out rows with faults, also in arrays of a row each, which are returned."""
        is_good = np.array([line not in self.faults for line in self.lines], dtype=bool)
        self.keep(is_good)
        return [array[is_good] for array in arrays]

    def told_faults(self) -> list[str]:
        """Faults in order of their lines, with file and line."""
        return [f"{self.file}, line {line}: {words}" for line, words in sorted(self.faults.items())]

    def keep(self, is_kept: Iterable[object]) -> None:
        """Leave out the rows for which the value is not true."""
        kept = [row for row, is_in in enumerate(is_kept) if is_in]
        self.lines, self.rows = [self.lines[row] for row in kept], [self.rows[row] for row in kept]

    def texts(self, name: str) -> list[str]:
        """Cells of the column of a name."""
        index = self.names.index(name)
        return [cells[index] for cells in self.rows]

    def find(self, quantity: str) -> TableColumn | None:
        """Return the column of a quantity, None if there is none; TrajectoryError if there are several."""
        scales = {quantity: 1.0, **({f"{quantity}_deg": math.pi / 180.0} if quantity in ANGLES else {})}
        for names in (scales, dict.fromkeys(OTHER_NAMES.get(quantity, ()), 1.0)):
            found = [TableColumn(index, names[name]) for index, name in enumerate(self.names) if name in names]
            if len(found) > 1:
                self.refuse(
                    f"Expected one column of each name, got more than one {quantity!r} in"
                    f" {','.join(self.names)[:80]!r}. Rename or remove one."
                )
            if found:
                return found[0]
        return None

    def numbers(
        self, columns: Sequence[TableColumn | None], label: str, *, may_be_empty: bool = False
    ) -> NDArray[np.float64]:
        """Numbers of columns, shape (n, k), s, m, rad; 0 for a column that is not there.

        A cell that is no finite number is a fault, and NaN; an empty one is NaN if it `may_be_empty`.
        """
        found = np.zeros((len(self.rows), len(columns)))
        for k, column in enumerate(columns):
            if column is None:
                continue
            for row, cells in enumerate(self.rows):
                text = cells[column.place]
                value = parse_float(text)
                if value is None and (text or not may_be_empty):
                    words = f"Expected finite numbers for '{label}', got {text[:40]!r}. Correct or remove this line."
                    self.faults.setdefault(self.lines[row], words)
                found[row, k] = math.nan if value is None else value * column.scale
        return found


def read_pose_table(file: Path, what: str = "a trajectory") -> PoseTable:
    """Return a CSV table with a header; `#` begins a comment line. `what` it should hold is for messages."""
    lines = ((number, line) for number, line in numbered_lines(file, what) if not line.startswith("#"))
    first = next(lines, None)
    if first is None:
        return PoseTable(file, [], 0)
    table = PoseTable(file, [], first[0])
    try:
        table.names = [name.lower() for name in _cells(first[1])]
    except csv.Error as error:
        table.refuse(_not_csv(error))
    n_columns = len(table.names)

    def of_count(cells: list[str]) -> str:
        return f"Expected {n_columns} columns as in the header, got {len(cells)}. Correct this line."

    rows_of_lines(table, lines, _cells, of_count)
    return table


def rows_of_lines(
    table: PoseTable,
    lines: Iterable[tuple[int, str]],
    split: Callable[[str], list[str]],
    of_count: Callable[[list[str]], str],
) -> None:
    """Add the rows in numbered lines to a table; lines with another count of cells are faults, in words `of_count`."""
    for number, line in lines:
        try:
            cells = split(line)
        except csv.Error as error:
            table.faults[number] = _not_csv(error)
            continue
        if len(cells) == len(table.names):
            table.lines.append(number)
            table.rows.append(cells)
        elif cells:
            table.faults[number] = of_count(cells)


def _cells(line: str) -> list[str]:
    return [text.strip() for text in next(csv.reader([line], strict=True))]


def _not_csv(error: csv.Error) -> str:
    return f"Expected comma-separated values, got: {error}. Correct or remove this line."
