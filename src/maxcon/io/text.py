# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Text of other programs: lines, numbers, tables, numbered names; nothing is read without bounds."""

import io
import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError

# A pose is about 150 characters; a longer line is another kind of file.
MAX_LINE = 10_000
# A row of a cloud may have hundreds of numbers.
MAX_ROW = 100_000
# Lines of text are heavier in memory than their numbers: a quarter of a million take about 100 MB.
MAX_LINES = 250_000

SCAN_SUFFIXES = (".bin", ".pcd", ".las", ".laz", ".ply", ".npz")
NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


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
    """Yield each line of UTF-8 text with its number from 1, without blanks around it; empty lines are left out.

    `what` the file should hold is for messages, e.g. "a trajectory". FileError if it cannot be read, or is not text.
    """
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


def read_table(text: TextIO, n_rows: int, n_columns: int) -> NDArray[np.float64]:
    """Return the next rows of numbers between blanks, shape (n_rows, n_columns); ValueError if they are none."""
    lines = list(islice(_lines(text), n_rows))
    if len(lines) < n_rows:
        raise ValueError(f"{n_rows - len(lines)} rows of numbers fewer: truncated")
    return table_of(lines, n_columns)


def pass_over_rows(text: TextIO, n_rows: int) -> None:
    """Read on behind the next lines that are not empty."""
    deque(islice(_lines(text), n_rows), maxlen=0)


def table_of(lines: Sequence[str], n_columns: int, separator: str | None = None) -> NDArray[np.float64]:
    """Return rows of numbers, shape (n, n_columns); ValueError if a row has others, or another count of them."""
    if not lines:
        return np.empty((0, n_columns))
    values = np.loadtxt(lines, dtype=np.float64, comments=None, delimiter=separator, ndmin=2)
    if values.shape[1] != n_columns:
        raise ValueError(f"{values.shape[1]} numbers in a row, not {n_columns}")
    return values


def _lines(text: TextIO) -> Iterator[str]:
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
