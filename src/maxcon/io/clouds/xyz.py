"""Points as text, a line each: columns by the names of a header, or x, y, z first."""

import io
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_file_error, cloud_chunk
from maxcon.io.text import MAX_LINES, parse_float, table_of, text_lines

KIND = "points as text, with x, y, z in each line"
NAMES = {
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "z": ("z", "height", "elevation"),
    "classes": ("classification", "class", "label", "scalar_classification"),
    "times": ("gps_time", "gpstime", "time", "scalar_gpstime"),
}
SEPARATORS = (",", ";", "\t")
COMMENTS = ("#", "//")
N_POSES = 100  # so many rows tell a trajectory from points


class _Layout(NamedTuple):
    """Line of the first row, what separates columns (None: blanks), how many there are, and which is which."""

    first_row: int
    separator: str | None
    n_columns: int
    columns: dict[str, int]


class XyzReader(CloudReader):
    """Points of a text file; with classes and times where a header names them; without one x, y, z come first."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        with _opened(file) as lines:
            self._layout = _read_layout(lines)
        with _opened(file) as lines:
            _refuse_poses(file, table_of([*islice(_rows(lines, self._layout), N_POSES)], *self._layout[2:0:-1]))
        with _opened(file) as lines:
            n_points = sum(1 for _ in _rows(lines, self._layout))
        columns = self._layout.columns
        self.header = CloudHeader(file, n_points, has_classes="classes" in columns, has_times="times" in columns)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        with _opened(self.header.path) as lines:
            rows, layout = _rows(lines, self._layout), self._layout
            while some := list(islice(rows, min(max_points, MAX_LINES))):
                values = table_of(some, layout.n_columns, layout.separator)
                named = {name: values[:, column] for name, column in layout.columns.items() if name not in "xyz"}
                yield cloud_chunk(points=values[:, [layout.columns[name] for name in "xyz"]], **named)


@contextmanager
def _opened(file: Path) -> Iterator[Iterator[tuple[int, str]]]:
    """Yield the lines of a file that are not empty, and their numbers among these; a byte order mark is left out."""
    how: Any = {"encoding": "utf-8-sig", "errors": "replace", "newline": "\n"}
    with as_file_error(file, KIND), io.TextIOWrapper(open_regular(file), **how) as stream:
        yield enumerate(map(str.strip, text_lines(stream)))


def _refuse_poses(file: Path, rows: NDArray[np.float64]) -> None:
    """Refuse a TUM trajectory, FileError: ascending times, positions and unit quaternions."""
    is_turned = rows.shape[1] == 8 and np.allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-3)
    if is_turned and len(rows) > 1 and (np.diff(rows[:, 0]) > 0.0).all():
        raise FileError(
            f"Expected points in {file}, got a trajectory: ascending times and unit quaternions in 8 columns. Give it"
            " as --trajectory, beside the clouds."
        )


def _rows(lines: Iterator[tuple[int, str]], layout: _Layout) -> Iterator[str]:
    return (text for number, text in lines if number >= layout.first_row and not text.startswith(COMMENTS))


def _read_layout(lines: Iterator[tuple[int, str]]) -> _Layout:
    """Where rows begin and what is in them."""
    names: list[str] | None = None
    for number, text in lines:
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
