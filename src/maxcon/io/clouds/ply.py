# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PLY: ascii and binary of either byte order, any scalar types of properties."""

from typing import BinaryIO

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
        names = [name for name, _, _ in elements]
        if "vertex" not in names:
            raise ValueError(f"no element 'vertex' among {', '.join(names) or 'none'}")
        types = []
        for name, _, properties in elements[: names.index("vertex") + 1]:
            if any(kind == LIST for _, kind in properties):
                raise ValueError(f"a list in {name!r}: export the points alone, with scalar properties")
            types.append(record_type([each for each, _ in properties], [order + kind for _, kind in properties]))
        *before, n_points = (count for _, count, _ in elements[: len(types)])
        least = types[-1].itemsize if order else 2 * len(types[-1].names or ())  # a digit and a blank or line end each
        if order:
            start += sum(count * dtype.itemsize for count, dtype in zip(before, types[:-1], strict=True))
        if n_points == 0 or start + n_points * least > size + 1:
            raise ValueError(f"{n_points} vertices in {size} bytes: empty or truncated")
        return RecordLayout("binary" if order else "ascii", start, n_points, types[-1], sum(before))


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


def _parse(lines: list[list[str]]) -> tuple[str, list[tuple[str, int, list[tuple[str, str]]]]]:
    """Byte order ("" for ascii), and name and count of each element with names and types of its properties."""
    order: str | None = None
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for words in lines:
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in ORDERS and order is None:
                order = ORDERS[kind]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 19:
                elements.append((name, int(count), []))
            case ["property", "list", _, _, name] if elements:
                elements[-1][2].append((name, LIST))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1][2].append((name, TYPES[kind]))
            case _:
                raise ValueError(f"the header line {' '.join(words)[:60]!r}")
    if order is None:
        raise ValueError("no header line 'format ... 1.0'")
    return order, elements
