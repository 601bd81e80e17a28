"""Text of other programs: lines, numbers, numbered names, tables of poses; nothing is read without bounds."""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError, TrajectoryError

MAX_LINE = 10_000  # a pose is about 150 characters; a longer line is another kind of file
MAX_ROW = 100_000  # a row of a cloud may have hundreds of numbers
MAX_LINES = 250_000  # lines of text are heavier in memory than their numbers: these take about 100 MB

SCAN_SUFFIXES = (".bin", ".pcd", ".las", ".laz", ".ply", ".npz")
NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")
ANGLES = ("roll", "pitch", "heading", "azimuth", "sigma_heading")  # in rad, or in degrees as NAME_deg
OTHER_NAMES = {"time": "timestamp"}
UNCLEAR_HEADINGS = ("yaw", "yaw_deg", "azimuth", "bearing", "course", "theta")  # may count from north, or clockwise


def printable(text: str) -> str:
    """Return a text of a file as it may be shown: short, and on one line."""
    return "".join(sign if sign.isprintable() else "?" for sign in text[:100])


@contextmanager
def reading(file: Path, what: str) -> Iterator[None]:
    """Turn errors of the operating system into FileError; `what` there should be is for messages."""
    try:
        yield
    except OSError as error:
        got = str(error.strerror or error).lower()
        raise FileError(f"Expected {what} at {file}, got: {got}. Check its path and permissions.") from error


def numbered_lines(file: Path, what: str) -> Iterator[tuple[int, str]]:
    """Yield each line of UTF-8 text that is not empty with its number from 1, stripped; `what` is for messages."""
    number = 0
    try:
        with reading(file, what), io.TextIOWrapper(open_regular(file), encoding="utf-8-sig") as stream:
            while line := stream.readline(MAX_LINE):
                number += 1
                if len(line) == MAX_LINE and not line.endswith("\n"):
                    raise FileError(
                        f"{file}, line {number}: Expected {what} in lines of text, got one of over {MAX_LINE}"
                        " characters. Is it the right file?"
                    )
                if line := line.strip():
                    yield number, line
    except UnicodeDecodeError as error:
        raise FileError(
            f"{file}, after line {number}: Expected {what} as UTF-8 text, got other bytes. Is it the right file?"
        ) from error


def parse_float(text: str) -> float | None:
    """Return the finite number that `text` stands for, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def table_of(lines: Sequence[str], n_columns: int, separator: str | None = None) -> NDArray[np.float64]:
    """Return rows of numbers, shape (n, n_columns); ValueError if a row has others, or another count of them."""
    values = np.loadtxt(lines, dtype=np.float64, comments=None, delimiter=separator, ndmin=2)
    if values.shape[1] != n_columns:
        raise ValueError(f"{values.shape[1]} numbers in a row, not {n_columns}")
    return values


def text_lines(text: TextIO) -> Iterator[str]:
    """Yield the lines that are not empty."""
    while line := text.readline(MAX_ROW):
        if len(line) == MAX_ROW:
            raise ValueError(f"a line of over {MAX_ROW} characters")
        if not line.isspace():
            yield line


def in_natural_order(paths: list[Path]) -> list[Path]:
    """Sort by name, numbers by value: 2 before 10, and 1.25 before 1.5 where all names are numbers."""
    if all(NUMBER.fullmatch(path.stem) for path in paths):
        return sorted(paths, key=lambda path: (float(path.stem), path.name))

    def key(path: Path) -> tuple[list[str | int], str]:
        parts = re.split(r"([0-9]+)", path.name)
        return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name

    return sorted(paths, key=key)


@dataclass(slots=True, eq=False)
class PoseTable:
    """Rows of a table, as texts."""

    file: Path
    names: list[str]  # of the columns, in small letters; empty if the file holds no line
    header_line: int = 0  # counted from 1
    lines: list[int] = field(default_factory=list)  # of each row
    rows: list[list[str]] = field(default_factory=list)  # cells, as many as there are names
    faults: dict[int, str] = field(default_factory=dict)  # what is wrong with lines that are no rows, by their numbers

    def refuse(self, words: str, line: int | None = None) -> NoReturn:
        """Raise TrajectoryError because of a line, that of the header if none is given."""
        raise TrajectoryError(f"{self.file}, line {self.header_line if line is None else line}: {words}")

    def add_fault(self, row: int, words: str) -> None:
        """Tell what is wrong with a row; the first fault of a line counts."""
        self.faults.setdefault(self.lines[row], f"{words} Correct or remove this line.")

    def good(self, arrays: Sequence[NDArray[np.float64]], *, may_leave_out: bool) -> list[NDArray[np.float64]]:
        """Leave out rows with faults, also in arrays of a row each, which come back; TrajectoryError if most are."""
        good = self.keep([line not in self.faults for line in self.lines])
        if self.faults and (not may_leave_out or len(self.faults) > len(self.rows)):
            raise TrajectoryError(self.told_faults()[0])
        if not self.rows:
            raise TrajectoryError(f"{self.file}: Expected at least one pose, got none. Was it written to its end?")
        return [array[good] for array in arrays]

    def told_faults(self) -> tuple[str, ...]:
        """Faults in order of their lines, with file and line."""
        return tuple(f"{self.file}, line {line}: {words}" for line, words in sorted(self.faults.items()))

    def keep(self, is_kept: Iterable[object]) -> list[int]:
        """Leave out the rows for which the value is not true; return which are kept."""
        kept = [row for row, is_in in enumerate(is_kept) if is_in]
        self.lines, self.rows = [self.lines[row] for row in kept], [self.rows[row] for row in kept]
        return kept

    def texts(self, name: str) -> list[str]:
        """Cells of the column of a name."""
        index = self.names.index(name)
        return [cells[index] for cells in self.rows]

    def name_of(self, quantity: str) -> str | None:
        """Return the name of the column of a quantity, None if there is none; TrajectoryError if there are several."""
        possible = (quantity, f"{quantity}_deg") if quantity in ANGLES else (quantity,)
        found = [name for name in self.names if name in possible] or [
            name for name in self.names if name == OTHER_NAMES.get(quantity)
        ]
        if len(found) > 1:
            self.refuse(
                f"Expected one column of each name, got more than one {quantity!r} in {','.join(self.names)[:80]!r}."
                " Rename or remove one."
            )
        return found[0] if found else None

    def numbers(self, quantities: Sequence[str], *, may_be_empty: bool = False) -> NDArray[np.float64]:
        """Return quantities in s, m and rad, (n, k), and note faults of cells; NaN where empty, or no such column."""
        found = np.full((len(self.rows), len(quantities)), np.nan)
        for k, quantity in enumerate(quantities):
            name = self.name_of(quantity)
            if name is None:
                continue
            scale = math.pi / 180.0 if name.endswith("_deg") else 1.0
            is_sigma = quantity.startswith("sigma")
            largest = 2.0 * math.pi + 1e-6 if quantity in ANGLES and not is_sigma else math.inf
            for row, text in enumerate(self.texts(name)):
                value = parse_float(text)
                if value is None:
                    if text or not may_be_empty:
                        self.add_fault(row, f"Expected finite numbers as {name!r}, got {text[:40]!r}.")
                    continue
                found[row, k] = value * scale
                if abs(found[row, k]) > largest:
                    advice = "" if name != quantity else f" Is it in degrees? Then name the column {name}_deg."
                    self.add_fault(row, f"Expected {name!r} within one turn, got {value:g}.{advice}")
                if is_sigma and value < 0.0:
                    self.add_fault(row, f"Expected {name!r} >= 0, got {value:g}.")
        return found


def read_pose_table(file: Path, what: str = "a trajectory", names: Sequence[str] = ()) -> PoseTable:
    """Return a CSV table with a header, or one of given `names` with blanks between columns; `#` begins a comment."""
    table = PoseTable(file, list(names))
    for number, line in numbered_lines(file, what):
        if line.startswith("#"):
            continue
        try:
            texts = line.partition("#")[0].split() if names else next(csv.reader([line], strict=True))
        except csv.Error as error:
            table.faults[number] = f"Expected comma-separated values, got: {error}. Correct or remove this line."
            continue
        cells = [text.strip() for text in texts]
        if not table.names:
            table.names, table.header_line = [name.lower() for name in cells], number
        elif len(cells) == len(table.names):
            table.lines.append(number)
            table.rows.append(cells)
        else:
            table.faults[number] = (
                f"Expected {len(table.names)} columns '{','.join(table.names)[:80]}', got {len(cells)}. Correct this"
                f" line{'' if not names else ', or name the file .csv if it is CSV'}."
            )
    return table
