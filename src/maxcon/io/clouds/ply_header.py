# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The header of a PLY file: where its vertices are and what each consists of."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from maxcon.errors import FileError

__all__ = ["PlyLayout", "read_ply_layout"]

# Real headers have some hundred bytes, with long comments some thousand.
MAX_HEADER_BYTES = 2**18
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
LIST = "list"


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)

    @property
    def has_list(self) -> bool:
        return any(kind == LIST for _, kind in self.properties)

    def dtype(self, order: str) -> np.dtype[np.void]:
        """One row; fields are numbered, because names need not be unique."""
        return np.dtype([(f"f{i}", order + kind) for i, (_, kind) in enumerate(self.properties)])


@dataclass(frozen=True, slots=True)
class PlyLayout:
    """Where the vertices of a PLY file are.

    Parameters
    ----------
    is_ascii : bool
        Whether rows are lines of text; else they are records of `dtype`.
    start : int
        Offset of what follows the header, bytes; in a binary file, of the first vertex.
    n_rows_before : int
        Lines of other elements before the first vertex (ascii only).
    n_points : int
        How many vertices.
    names : tuple of str
        Property names, in order.
    dtype : dtype
        One vertex, fields f0, f1, ...
    """

    is_ascii: bool
    start: int
    n_rows_before: int
    n_points: int
    names: tuple[str, ...]
    dtype: np.dtype[np.void]


def read_ply_layout(file: Path, stream: BinaryIO) -> PlyLayout:
    """Return the layout of an open PLY file, checked against its size.

    Raises
    ------
    FileError
        If the header is broken, vertices have lists or none are there, or the file is too short for them.
    """
    size = stream.seek(0, 2)
    stream.seek(0)
    order, elements = _parse(file, _header_lines(file, stream))
    start = stream.tell()
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise FileError(f"Expected an element 'vertex' in {file}, got {', '.join(names) or 'none'}. Export its points.")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    for element in (*before, vertex):
        if element.has_list:
            raise FileError(
                f"Expected elements up to 'vertex' without lists in {file}, got a list in {element.name!r}."
                " Export the points alone, with scalar properties."
            )
    if vertex.count == 0:
        raise FileError(f"Expected points in {file}, got a header that says 0 vertices. Leave this file out.")
    dtype = vertex.dtype(order)
    if order:
        start += sum(element.count * element.dtype(order).itemsize for element in before)
        least = dtype.itemsize
    else:
        least = 2 * len(vertex.properties)  # a digit and a blank or line end each
    if start + vertex.count * least > size + 1:
        raise FileError(
            f"Expected {vertex.count} vertices in {file}, got {size} bytes, fewer than they need: truncated."
            " Copy it again."
        )
    n_rows_before = sum(element.count for element in before)
    property_names = tuple(name for name, _ in vertex.properties)
    return PlyLayout(not order, start, n_rows_before, vertex.count, property_names, dtype)


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
                f"Expected a PLY header of at most {MAX_HEADER_BYTES} bytes that ends with 'end_header' in"
                f" {file},"
                " got none. Is the file complete?"
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
