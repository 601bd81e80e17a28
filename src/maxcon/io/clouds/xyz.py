# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points as text, a line each: columns by the names of a header, or x, y, z first."""

from collections.abc import Generator, Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

from maxcon._system.regular_file import open_regular
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_classes, as_file_error
from maxcon.io.text import MAX_LINES, parse_float, table_of

KIND = "points as text, with x, y, z in each line"
NAMES = {
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "z": ("z", "height", "elevation"),
    "class": ("classification", "class", "label", "scalar_classification"),
    "time": ("gps_time", "gpstime", "time", "scalar_gpstime"),
}
SEPARATORS = (",", ";", "\t")
COMMENTS = ("#", "//")
MAX_LINE = 4096


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
            self._layout = _read_layout(stream)
            stream.seek(0)
            n_points = sum(1 for _ in _rows(stream, self._layout))
        columns = self._layout.columns
        self.header = CloudHeader(file, n_points, has_classes="class" in columns, has_times="time" in columns)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        with as_file_error(self.header.path, KIND), open_regular(self.header.path) as stream:
            rows, layout = _rows(stream, self._layout), self._layout
            while lines := list(islice(rows, min(max_points, MAX_LINES))):
                values = table_of(lines, layout.n_columns, layout.separator)
                named = {name: values[:, column] for name, column in layout.columns.items()}
                classes = as_classes(named["class"]) if "class" in named else None
                points = values[:, [layout.columns[name] for name in "xyz"]]
                yield CloudChunk(points, classes=classes, times=named.get("time"))


def _lines(stream: BinaryIO) -> Iterator[tuple[int, str]]:
    """Yield lines with content, and their numbers; a byte order mark is left out."""
    number = 0
    while line := stream.readline(MAX_LINE):
        number += 1
        if len(line) == MAX_LINE and not line.endswith(b"\n"):
            raise ValueError(f"a line of over {MAX_LINE} characters")
        if text := line.decode("utf-8-sig" if number == 1 else "ascii", "replace").strip():
            yield number, text


def _rows(stream: BinaryIO, layout: _Layout) -> Iterator[str]:
    return (text for number, text in _lines(stream) if number >= layout.first_row and not text.startswith(COMMENTS))


def _read_layout(stream: BinaryIO) -> _Layout:
    """Where rows begin and what is in them."""
    names: list[str] | None = None
    for number, text in _lines(stream):
        separator = next((mark for mark in SEPARATORS if mark in text), None)
        cells = [cell.strip() for cell in text.lstrip("#/ ").split(separator)]
        is_comment = text.startswith(COMMENTS)
        if not is_comment and all(parse_float(cell) is not None or cell.lower() == "nan" for cell in cells):
            if len(cells) == 1 and cells[0].isdecimal():
                continue  # the number of points
            return _Layout(number, separator, len(cells), _columns(names or list("xyz"), len(cells), names is None))
        if not is_comment and names is not None:
            break
        found = [cell.lower().strip('"') for cell in cells]
        if not is_comment or {"x", "y", "z"} <= set(found):
            names = found
    raise ValueError("no such line")


def _columns(names: list[str], n_columns: int, may_have_more: bool) -> dict[str, int]:
    """Which column is which, by the names of a header, or of those that come first if there is none."""
    if len(names) > n_columns or (len(names) < n_columns and not may_have_more):
        raise ValueError(f"{n_columns} numbers per point, not {len(names)} ({', '.join(names)[:80]})")
    columns = {}
    for wanted, possible in NAMES.items():
        found = [index for index, name in enumerate(names) if name in possible]
        if len(found) > 1 or (not found and wanted in "xyz"):
            raise ValueError(f"{'more than' if found else 'not'} one column {wanted!r} in '{','.join(names)[:80]}'")
        if found:
            columns[wanted] = found[0]
    return columns
