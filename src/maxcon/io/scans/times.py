# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The time of each scan: from a file with one time per line, or from the names of the scans."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.file_names import NUMBER
from maxcon.io.text import numbered_lines, parse_float

__all__ = ["times_from_file", "times_from_names"]

# Unix times since 2001: digits of an integer name, and how many of its units make a second.
UNITS_BY_DIGITS = {19: 1e9, 16: 1e6, 13: 1e3}
ADVICE = "Write a times.txt with one time in seconds per scan, in the order of the names."


def times_from_file(file: Path, n_scans: int) -> NDArray[np.float64]:
    """Return the times in `file`, shape (n_scans,), s: one per line, `#` begins a comment.

    Raises
    ------
    FileError
        If a line is not one number, times do not increase, or there is not one per scan.
    """
    times: list[float] = []
    for number, line in numbered_lines(file, "times of scans"):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        value = parse_float(text)
        if value is None:
            raise FileError(
                f"{file}, line {number}: Expected one time in seconds, got {text[:40]!r}. Correct this line."
            )
        if times and value <= times[-1]:
            raise FileError(
                f"{file}, line {number}: Expected times that increase, got {value:.9f} s after"
                f" {times[-1]:.9f} s."
                " Put scans and times in order."
            )
        times.append(value)
    if len(times) != n_scans:
        raise FileError(f"Expected {n_scans} times in {file}, one per scan, got {len(times)}. {ADVICE}")
    return np.array(times)


def times_from_names(paths: list[Path]) -> NDArray[np.float64]:
    """Return the times that the names say, shape (n,), s.

    A name with decimals is seconds; an integer of 19, 16 or 13 digits is Unix time in ns, us or ms; any
    other integer is seconds.

    Raises
    ------
    FileError
        If a name is not a number, names differ in unit, or two stand for the same time.
    """
    for path in paths:
        if not NUMBER.fullmatch(path.stem):
            raise FileError(
                f"Expected a time as the name of each scan, or a times.txt beside them, got {path.name} in"
                f" {path.parent}. {ADVICE}"
            )
    units = [1.0 if "." in path.stem else UNITS_BY_DIGITS.get(len(path.stem.lstrip("-")), 1.0) for path in paths]
    if len(set(units)) > 1:
        raise FileError(
            f"Expected names of the same unit in {paths[0].parent}, got {paths[0].name} and"
            f" {paths[units.index(next(u for u in units if u != units[0]))].name}. {ADVICE}"
        )
    times = np.array([float(path.stem) for path in paths]) / units[0]
    rows = np.flatnonzero(~(np.diff(times) > 0.0))
    if len(rows):
        first, second = paths[rows[0]], paths[rows[0] + 1]
        raise FileError(
            f"Expected names of increasing times in {first.parent}, got {first.name} and {second.name}. {ADVICE}"
        )
    return times
