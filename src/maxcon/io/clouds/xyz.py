# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points as text, a line each: columns by the names of a header, or x, y, z first."""

from collections.abc import Generator, Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError
from maxcon.io.clouds.base import CloudChunk, CloudHeader, CloudReader, as_classes, as_file_error
from maxcon.io.text import parse_float

KIND = "points as text"
NAMES = {
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "z": ("z", "height", "elevation"),
    "class": ("classification", "class", "label", "scalar_classification"),
    "time": ("gps_time", "gpstime", "time", "scalar_gpstime"),
}
SEPARATORS = (",", ";", "\t")
COMMENTS = ("#", "//")
# Lines of text are heavier in memory than their numbers: a quarter of a million take about 100 MB.
MAX_LINES, MAX_LINE = 250_000, 4096


class _Layout(NamedTuple):
    """Line of the first row, what separates columns (None: blanks), how many there are, and which is which."""

    first_row: int
    separator: str | None
    n_columns: int
    columns: dict[str, int]


class XyzReader(CloudReader):
    """Points of a text file; with classes and times where a header names such columns.

    Columns are apart by commas, semicolons, tabs or blanks. A header names them x, y, z (or easting, northing,
    height), classification, gps_time; without one the first three are x, y, z. A first line with the number of points
    is passed over, and so are lines that begin with # or //, unless they are the header. FileError if it is no such
    file, or holds no points.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND), open_regular(file) as stream:
            self._layout = _read_layout(file, stream)
            stream.seek(0)
            n_points = sum(1 for _ in _rows(file, stream, self._layout))
        columns = self._layout.columns
        self.header = CloudHeader(
            path=file, n_points=n_points, has_classes="class" in columns, has_times="time" in columns
        )

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        file = self.header.path
        with as_file_error(file, KIND), open_regular(file) as stream:
            rows = _rows(file, stream, self._layout)
            while lines := list(islice(rows, min(max_points, MAX_LINES))):
                yield self._chunk(lines)

    def _chunk(self, lines: list[str]) -> CloudChunk:
        file, layout = self.header.path, self._layout
        try:
            values = np.loadtxt(lines, dtype=np.float64, comments=None, delimiter=layout.separator, ndmin=2)
        except ValueError as error:
            words = str(error).partition(";")[0][:100]
            raise FileError(f"Expected rows of numbers in {file}, got: {words}. Correct or remove that row.") from error
        if values.shape[1] != layout.n_columns:
            raise FileError(
                f"Expected {layout.n_columns} numbers per point in {file}, got {values.shape[1]}. Correct that row."
            )
        classes: NDArray[np.uint8] | None = None
        if "class" in layout.columns:
            classes = as_classes(file, "classification", values[:, layout.columns["class"]])
        times = values[:, layout.columns["time"]] if "time" in layout.columns else None
        return CloudChunk(values[:, [layout.columns[name] for name in "xyz"]], classes=classes, times=times)


def _lines(file: Path, stream: BinaryIO) -> Iterator[tuple[int, str]]:
    """Yield lines with content, and their numbers; a byte order mark is left out."""
    number = 0
    while line := stream.readline(MAX_LINE):
        number += 1
        if len(line) == MAX_LINE and not line.endswith(b"\n"):
            raise FileError(
                f"Expected {KIND} in {file}, got a line of over {MAX_LINE} characters. Is it the right file?"
            )
        if text := line.decode("utf-8-sig" if number == 1 else "ascii", "replace").strip():
            yield number, text


def _rows(file: Path, stream: BinaryIO, layout: _Layout) -> Iterator[str]:
    return (
        text for number, text in _lines(file, stream) if number >= layout.first_row and not text.startswith(COMMENTS)
    )


def _read_layout(file: Path, stream: BinaryIO) -> _Layout:
    """Return where rows begin and what is in them."""
    names: list[str] | None = None
    for number, text in _lines(file, stream):
        separator = next((mark for mark in SEPARATORS if mark in text), None)
        cells = [cell.strip() for cell in text.lstrip("#/ ").split(separator)]
        is_comment = text.startswith(COMMENTS)
        if not is_comment and all(parse_float(cell) is not None or cell.lower() == "nan" for cell in cells):
            if len(cells) == 1 and cells[0].isdecimal():
                continue  # the number of points
            return _Layout(number, separator, len(cells), _columns(file, names, len(cells)))
        if not is_comment and names is not None:
            break
        found = [cell.lower().strip('"') for cell in cells]
        if not is_comment or {"x", "y", "z"} <= set(found):
            names = found
    raise FileError(f"Expected {KIND} in {file}, x, y, z in each line, got none. Is it the right file?")


def _columns(file: Path, names: list[str] | None, n_columns: int) -> dict[str, int]:
    """Which column is which, by the names of a header, or x, y, z first if there is none."""
    if names is None:
        if n_columns < 3:
            raise FileError(f"Expected x, y, z in each line of {file}, got {n_columns} numbers. Add what is missing.")
        return {"x": 0, "y": 1, "z": 2}
    if len(names) != n_columns:
        raise FileError(f"Expected {len(names)} numbers per point in {file}, as its header has, got {n_columns}.")
    columns = {}
    for wanted, possible in NAMES.items():
        found = [index for index, name in enumerate(names) if name in possible]
        if len(found) > 1 or (not found and wanted in "xyz"):
            got = "more than one" if found else "none"
            raise FileError(
                f"Expected one column {wanted!r} in the header of {file}, got {got} in '{','.join(names)[:80]}'. Name"
                " the columns x, y, z."
            )
        if found:
            columns[wanted] = found[0]
    return columns
