# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PLY: ascii and binary of either byte order, any scalar types of properties."""

import io
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds.base import (
    CloudChunk,
    CloudHeader,
    CloudReader,
    as_classes,
    as_file_error,
    as_float64,
    rows_at_a_time,
)
from maxcon.io.text import read_lines, read_table

POINT_NAMES = ("x", "y", "z")
NORMAL_NAMES = ("nx", "ny", "nz")
CLASS_NAMES = ("classification", "class", "label", "scalar_classification", "scalar_class", "scalar_label")
TIME_NAMES = ("gps_time", "gpstime", "time", "scalar_gpstime", "scalar_gps_time")
# Lines of text are heavier in memory than their numbers: a quarter of a million take about 100 MB.
MAX_LINES = 250_000
# Real headers have some hundred bytes, with long comments some thousand.
MAX_HEADER_BYTES = 2**18
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
LIST = "list"

Columns = list[NDArray[Any]]


class PlyReader(CloudReader):
    """Points of a PLY file; with normals, classes and times where it has such properties.

    Normals are nx, ny, nz; classes `classification`, `class` or `label`; times `gps_time` or `time`; of these, whatever
    their case, also as scalar fields of CloudCompare: `scalar_Classification`. Elements other than `vertex` are passed
    over. FileError if it is not PLY, has no x, y, z, has lists in its vertices or before them, or is too short.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, "a PLY file"), file.open("rb") as stream:
            self._layout = _read_layout(file, stream)
        names = self._layout.names
        lowered = [name.lower() for name in names]
        self._points = self._columns(file, POINT_NAMES)
        self._normals = self._columns(file, NORMAL_NAMES) if set(NORMAL_NAMES) <= set(names) else None
        self._classes = next((lowered.index(name) for name in CLASS_NAMES if name in lowered), None)
        self._times = next((lowered.index(name) for name in TIME_NAMES if name in lowered), None)
        self.header = CloudHeader(
            path=file,
            n_points=self._layout.n_points,
            has_normals=self._normals is not None,
            has_classes=self._classes is not None,
            has_times=self._times is not None,
        )

    def _columns(self, file: Path, wanted: tuple[str, ...]) -> list[int]:
        names = self._layout.names
        for name in wanted:
            if names.count(name) != 1:
                raise FileError(
                    f"Expected one property {name!r} per vertex in {file}, got {names.count(name)} in"
                    f" '{' '.join(names)[:80]}'. Export the points with x, y, z."
                )
        return [names.index(name) for name in wanted]

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        file, layout = self.header.path, self._layout
        rows = _ascii_rows if layout.is_ascii else _binary_rows
        with as_file_error(file, "a PLY file"), file.open("rb") as stream:
            stream.seek(layout.start)
            for columns in rows(file, stream, layout, max_points):
                yield self._chunk(columns)

    def _chunk(self, columns: Columns) -> CloudChunk:
        def table(indices: list[int]) -> NDArray[np.float64]:
            return np.stack([as_float64(columns[i]) for i in indices], axis=1)

        classes: NDArray[np.uint8] | None = None
        if self._classes is not None:
            classes = as_classes(self.header.path, self._layout.names[self._classes], columns[self._classes])
        return CloudChunk(
            points=table(self._points),
            normals=None if self._normals is None else table(self._normals),
            classes=classes,
            times=None if self._times is None else as_float64(columns[self._times]),
        )


@dataclass(slots=True)
class _Element:
    """One kind of row: its name, how many there are, and name and type of each property."""

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)

    def dtype(self, order: str) -> np.dtype[np.void]:
        """One row; fields are numbered, because names need not be unique."""
        return np.dtype([(f"f{i}", order + kind) for i, (_, kind) in enumerate(self.properties)])


class _Layout(NamedTuple):
    """Where the vertices of a PLY file are.

    `start` is where the rows after the header begin, bytes; in a binary file, where the first vertex does.
    `n_rows_before` are lines of other elements before the first vertex (ascii only).
    """

    is_ascii: bool
    start: int
    n_rows_before: int
    n_points: int
    names: list[str]
    dtype: np.dtype[np.void]


def _read_layout(file: Path, stream: BinaryIO) -> _Layout:
    """Return the layout of an open PLY file, checked against its size."""
    size = stream.seek(0, 2)
    stream.seek(0)
    order, elements = _parse(file, _header_lines(file, stream))
    start = stream.tell()
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise FileError(f"Expected an element 'vertex' in {file}, got {', '.join(names) or 'none'}. Export its points.")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    for element in (*before, vertex):
        if any(kind == LIST for _, kind in element.properties):
            raise FileError(
                f"Expected elements up to 'vertex' without lists in {file}, got a list in {element.name!r}."
                " Export the points alone, with scalar properties."
            )
    if vertex.count == 0:
        raise FileError(f"Expected points in {file}, got a header that says 0 vertices. Leave this file out.")
    dtype = vertex.dtype(order)
    least = dtype.itemsize if order else 2 * len(vertex.properties)  # a digit and a blank or line end each
    if order:
        start += sum(element.count * element.dtype(order).itemsize for element in before)
    if start + vertex.count * least > size + 1:
        raise FileError(
            f"Expected {vertex.count} vertices in {file}, got {size} bytes, fewer than they need: truncated."
            " Copy it again."
        )
    n_rows_before = sum(element.count for element in before)
    return _Layout(not order, start, n_rows_before, vertex.count, [name for name, _ in vertex.properties], dtype)


def _header_lines(file: Path, stream: BinaryIO) -> list[list[str]]:
    """Words of each header line; the stream stands behind the header afterwards."""
    lines: list[list[str]] = []
    while True:
        raw = stream.readline(MAX_HEADER_BYTES)
        words = raw.decode("latin-1").split()
        if not lines and words != ["ply"]:
            raise FileError(f"Expected {file} to begin with the line 'ply', got {raw[:20]!r}. Is it a PLY file?")
        if not raw.endswith(b"\n") or stream.tell() > MAX_HEADER_BYTES:
            raise FileError(
                f"Expected a PLY header of at most {MAX_HEADER_BYTES} bytes that ends with 'end_header' in {file}, got"
                " none. Is the file complete?"
            )
        if words == ["end_header"]:
            return lines
        if words:
            lines.append(words)


def _parse(file: Path, lines: list[list[str]]) -> tuple[str, list[_Element]]:
    """Byte order ("" for ascii) and elements in order."""
    order: str | None = None
    elements: list[_Element] = []
    for words in lines[1:]:
        match words:
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in ORDERS and order is None:
                order = ORDERS[kind]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 19:
                elements.append(_Element(name, int(count)))
            case ["property", "list", _, _, name] if elements:
                elements[-1].properties.append((name, LIST))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind]))
            case _:
                raise FileError(
                    f"Expected a PLY 1.0 header in {file}, got the line {' '.join(words)[:60]!r}. Export it anew."
                )
    if order is None:
        raise FileError(f"Expected a line 'format ... 1.0' in the header of {file}, got none. Export it anew.")
    return order, elements


def _truncated(file: Path, layout: _Layout, n_missing: int) -> FileError:
    return FileError(f"Expected {layout.n_points} vertices in {file}, got {n_missing} fewer: truncated. Copy it again.")


def _binary_rows(file: Path, stream: BinaryIO, layout: _Layout, max_points: int) -> Generator[Columns]:
    """Yield the columns of some vertices at a time, by number of property."""
    n_left = layout.n_points
    n_most = rows_at_a_time(max_points, layout.dtype.itemsize)
    while n_left > 0:
        n_rows = min(n_left, n_most)
        records = np.fromfile(stream, layout.dtype, n_rows)
        if len(records) < n_rows:
            raise _truncated(file, layout, n_left - len(records))
        yield [records[name] for name in layout.dtype.names or ()]
        n_left -= n_rows


def _ascii_rows(file: Path, stream: BinaryIO, layout: _Layout, max_points: int) -> Generator[Columns]:
    """As `_binary_rows`, from lines of text."""
    text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n")
    read_lines(file, text, layout.n_rows_before, keep=False)
    n_left = layout.n_points
    while n_left > 0:
        n_rows = min(n_left, max_points, MAX_LINES)
        values = read_table(file, text, n_rows, len(layout.names))
        if len(values) < n_rows:
            raise _truncated(file, layout, n_left - len(values))
        yield list(values.T)
        n_left -= n_rows
