# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PLY: ascii and binary of either byte order, any scalar types of properties."""

import io
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from maxcon.io.clouds.base import Bounds, CloudChunk, CloudReader, FieldNames, as_file_error, rows_at_a_time
from maxcon.io.point_records import coordinate_fields, record_type
from maxcon.io.text import MAX_LINES, pass_over_rows, read_table

KIND = "a PLY file of points"
NORMAL_NAMES = ("nx", "ny", "nz")
CLASS_NAMES = ("classification", "class", "label", "scalar_classification", "scalar_class", "scalar_label")
TIME_NAMES = ("gps_time", "gpstime", "time", "scalar_gpstime", "scalar_gps_time")
# Real headers have some hundred bytes, with long comments some thousand.
MAX_HEADER_BYTES = 2**18
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
LIST = "list"


class PlyReader(CloudReader):
    """Points of a PLY file; with normals, classes and times where it has such properties.

    Normals are nx, ny, nz; classes `classification`, `class` or `label`; times `gps_time` or `time`; of these, whatever
    their case, also as scalar fields of CloudCompare: `scalar_Classification`. Elements other than `vertex` are passed
    over. FileError if it is not PLY, has no x, y, z, has lists in its vertices or before them, or is too short.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND), file.open("rb") as stream:
            self._layout = _read_layout(stream)
            dtype = self._layout.dtype
            names = dtype.names or ()
            lowered = {name.lower(): name for name in reversed(names)}
            self._fields = FieldNames(
                coordinate_fields(dtype, "fiu"),
                coordinate_fields(dtype, "fiu", NORMAL_NAMES) if set(NORMAL_NAMES) <= set(names) else None,
                next((lowered[name] for name in CLASS_NAMES if name in lowered), None),
                next((lowered[name] for name in TIME_NAMES if name in lowered), None),
            )
        self.header = self._fields.header(file, self._layout.n_points)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        file, layout, names = self.header.path, self._layout, self._layout.dtype.names or ()
        n_left, n_most = layout.n_points, rows_at_a_time(max_points, layout.dtype.itemsize)
        with as_file_error(file, KIND), file.open("rb") as stream:
            stream.seek(layout.start)
            text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n")
            if layout.is_ascii:
                pass_over_rows(text, layout.n_rows_before)
                n_most = min(n_most, MAX_LINES)
            while n_left > 0:
                n_rows = min(n_left, n_most)
                if layout.is_ascii:
                    yield self._fields.chunk(dict(zip(names, read_table(text, n_rows, len(names)).T, strict=True)))
                else:
                    records = np.fromfile(stream, layout.dtype, n_rows)
                    if len(records) < n_rows:
                        raise ValueError(f"{n_left - len(records)} vertices fewer: truncated")
                    yield self._fields.chunk(records)
                n_left -= n_rows


@dataclass(slots=True)
class _Element:
    """One kind of row: its name, how many there are, and name and type of each property."""

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)

    def dtype(self, order: str) -> np.dtype[np.void]:
        """One row."""
        return record_type([name for name, _ in self.properties], [order + kind for _, kind in self.properties])


class _Layout(NamedTuple):
    """Where the vertices of a PLY file are.

    `start` is where the rows after the header begin, bytes; in a binary file, where the first vertex does.
    `n_rows_before` are lines of other elements before the first vertex (ascii only).
    """

    is_ascii: bool
    start: int
    n_rows_before: int
    n_points: int
    dtype: np.dtype[np.void]


def _read_layout(stream: BinaryIO) -> _Layout:
    """The layout of an open PLY file, checked against its size."""
    size = stream.seek(0, 2)
    stream.seek(0)
    order, elements = _parse(_header_lines(stream))
    start = stream.tell()
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise ValueError(f"no element 'vertex' among {', '.join(names) or 'none'}")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    for element in (*before, vertex):
        if any(kind == LIST for _, kind in element.properties):
            raise ValueError(f"a list in {element.name!r}: export the points alone, with scalar properties")
    dtype = vertex.dtype(order)
    least = dtype.itemsize if order else 2 * len(vertex.properties)  # a digit and a blank or line end each
    if order:
        start += sum(element.count * element.dtype(order).itemsize for element in before)
    if vertex.count == 0 or start + vertex.count * least > size + 1:
        raise ValueError(f"{vertex.count} vertices in {size} bytes: empty or truncated")
    n_rows_before = sum(element.count for element in before)
    return _Layout(not order, start, n_rows_before, vertex.count, dtype)


def _header_lines(stream: BinaryIO) -> list[list[str]]:
    """Words of each header line but the first; the stream stands behind the header afterwards."""
    if (first := stream.readline(MAX_HEADER_BYTES)).split() != [b"ply"]:
        raise ValueError(f"{first[:20]!r} instead of the line 'ply'")
    lines: list[list[str]] = []
    while True:
        raw = stream.readline(MAX_HEADER_BYTES)
        if not raw.endswith(b"\n") or stream.tell() > MAX_HEADER_BYTES:
            raise ValueError(f"no header of at most {MAX_HEADER_BYTES} bytes that ends with 'end_header'")
        words = raw.decode("latin-1").split()
        if words == ["end_header"]:
            return lines
        lines.append(words)


def _parse(lines: list[list[str]]) -> tuple[str, list[_Element]]:
    """Byte order ("" for ascii) and elements in order."""
    order: str | None = None
    elements: list[_Element] = []
    for words in lines:
        match words:
            case [] | ["comment" | "obj_info", *_]:
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
                raise ValueError(f"the header line {' '.join(words)[:60]!r}")
    if order is None:
        raise ValueError("no header line 'format ... 1.0'")
    return order, elements
