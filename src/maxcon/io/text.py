# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Text that people or other programs wrote: lines, numbers, tables, numbered names; nothing is read without bounds."""

import io
import math
import re
from collections.abc import Iterator
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

SCAN_SUFFIXES = (".bin", ".pcd", ".las", ".laz", ".ply", ".npz")
NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


def printable(text: str) -> str:
    """Return a text of a file as it may be shown: short, and on one line."""
    return "".join(sign if sign.isprintable() else "?" for sign in text[:100])


def numbered_lines(file: Path, what: str) -> Iterator[tuple[int, str]]:
    """Yield each line of UTF-8 text with its number from 1, without blanks around it; empty lines are left out.

    `what` the file should hold is for messages, e.g. "a trajectory". FileError if it is missing, a folder, not
    readable, or not text.
    """
    number = 0
    try:
        with io.TextIOWrapper(open_regular(file), encoding="utf-8-sig") as stream:
            while line := stream.readline(MAX_LINE):
                number += 1
                if len(line) == MAX_LINE and not line.endswith("\n"):
                    raise FileError(
                        f"{file}, line {number}: Expected {what} in lines of text, got one of over {MAX_LINE}"
                        " characters. Is it the right file?"
                    )
                if line := line.strip():
                    yield number, line
    except FileNotFoundError as error:
        raise FileError(f"Expected {what} at {file}, got no such file. Check the path.") from error
    except IsADirectoryError as error:
        raise FileError(f"Expected {what} in a file, got the folder {file}. Name a file in it.") from error
    except UnicodeDecodeError as error:
        raise FileError(
            f"{file}, after line {number}: Expected {what} as UTF-8 text, got other bytes. Is it the right file?"
        ) from error
    except OSError as error:
        raise FileError(
            f"Expected to be able to read {file}, got: {error.strerror}. Check its path and permissions."
        ) from error


def parse_float(text: str) -> float | None:
    """Return the finite number that `text` stands for, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def read_table(file: Path, text: TextIO, n_rows: int, n_columns: int) -> NDArray[np.float64]:
    """Return the next rows of numbers, shape (n, n_columns); n is less than `n_rows` at the end of the file.

    One row per line, numbers apart by blanks; empty lines are passed over. FileError if a row has another count of
    numbers, or something that is none.
    """
    lines = read_lines(file, text, n_rows)
    if not lines:
        return np.empty((0, n_columns))
    try:
        values = np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2)
    except ValueError as error:
        raise _not_numbers(file, n_columns, str(error).partition(";")[0]) from error
    if values.shape[1] != n_columns:
        raise _not_numbers(file, n_columns, f"{values.shape[1]} in a row")
    return values


def read_lines(file: Path, text: TextIO, n_lines: int, *, keep: bool = True) -> list[str]:
    """Return the next lines that are not empty, or pass over them; fewer at the end of the file."""
    lines: list[str] = []
    n_found = 0
    while n_found < n_lines and (line := text.readline(MAX_ROW)):
        if len(line) == MAX_ROW:
            raise _not_numbers(file, None, f"one of over {MAX_ROW} characters")
        if line.isspace():
            continue
        n_found += 1
        if keep:
            lines.append(line)
    return lines


def _not_numbers(file: Path, n_columns: int | None, got: str) -> FileError:
    wanted = "rows of numbers" if n_columns is None else f"{n_columns} numbers per point"
    return FileError(f"Expected {wanted} in {file}, got: {got[:100]}. Write it anew with the program it comes from.")


def in_natural_order(paths: list[Path]) -> list[Path]:
    """Sort by name, numbers by value: 2 before 10, and 1.25 before 1.5 where all names are numbers."""
    if all(NUMBER.fullmatch(path.stem) for path in paths):
        return sorted(paths, key=lambda path: (float(path.stem), path.name))

    def key(path: Path) -> tuple[list[str | int], str]:
        parts = re.split(r"([0-9]+)", path.name)
        return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name

    return sorted(paths, key=key)
