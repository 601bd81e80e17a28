# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PLY: ascii and binary of either byte order, any scalar types of properties."""

from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

from maxcon.io.clouds.records import RecordLayout, RecordReader
from maxcon.io.point_records import record_type

MAX_HEADER_BYTES = 2**18  # real headers have some hundred bytes, with long comments some thousand
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
LIST = "list"


class PlyReader(RecordReader):
    """Points of a PLY file; elements other than `vertex` are passed over; names are also CloudCompare's."""

    kind = "a PLY file of points"
    normal_names = ("nx", "ny", "nz")
    class_names = ("classification", "class", "label", "scalar_classification", "scalar_class", "scalar_label")
    time_names = ("gps_time", "gpstime", "time", "scalar_gpstime", "scalar_gps_time")
    ignores_case = True

    def _read_layout(self, stream: BinaryIO) -> RecordLayout:
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
        return RecordLayout("binary" if order else "ascii", start, vertex.count, dtype, n_rows_before)


@dataclass(slots=True)
class _Element:
    """One kind of row: its name, how many there are, and name and type of each property."""

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)

    def dtype(self, order: str) -> np.dtype[np.void]:
        """One row."""
        return record_type([name for name, _ in self.properties], [order + kind for _, kind in self.properties])


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
