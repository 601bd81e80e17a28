# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Reads PCD files; their header is checked against the size of the file before points are read."""

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MissingExtraError
from maxcon.io.clouds.base import as_file_error, as_float64
from maxcon.io.point_times import TIME_FIELDS, Column
from maxcon.io.text import printable, read_table

MAX_HEADER_BYTES = 2**16
MAX_COLUMNS = 10_000
MAX_RATIO = 300
"""The compression of PCD reaches 88 at the very most."""
TYPES = {"F4", "F8", "U1", "U2", "U4", "U8", "I1", "I2", "I4", "I8"}
ENCODINGS = ("ascii", "binary", "binary_compressed")
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


@dataclass(frozen=True, slots=True, eq=False)
class ScanFile:
    """All points of one scan file, and the fields that may be their times.

    points: shape (n, 3), float64; sensor frame, m; points without a return (not finite, or at the origin) are still
        among them.
    times: shape (n,)); by the name of the field: its type as NumPy names it, and its values as stored. Read from PCD
        files only.
    fields: names and types of all fields of a point, where the file tells them; else empty.
    """

    points: NDArray[np.float64]
    times: dict[str, Column] = field(default_factory=dict)
    fields: str = ""


class _Layout(NamedTuple):
    """Where the points of a PCD file begin, how many there are, and name, type (F4) and count of each field."""

    encoding: str
    start: int
    n_points: int
    fields: tuple[str, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """One binary record; fields are numbered, because names need not be unique."""
        rows = enumerate(zip(self.types, self.counts, strict=True))
        return np.dtype(
            [(f"f{i}", f"({count},)<{kind.lower()}" if count > 1 else f"<{kind.lower()}") for i, (kind, count) in rows]
        )


def read_pcd(file: Path, n_most: int) -> ScanFile:
    """Return the points of a PCD file (ascii, binary or binary_compressed), and the fields that may be their times.

    FileError if the header is broken or does not fit the file, or there are no points or more than `n_most`;
    MissingExtraError if the points are compressed and the extra `pcd` is not installed.
    """
    with as_file_error(file, f"a PCD file of 1 to {n_most:,} points"), file.open("rb") as stream:
        layout = _read_layout(stream, n_most)
        if layout.encoding == "ascii":
            text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n")
            table = read_table(text, layout.n_points, sum(layout.counts))
            return _content(layout, lambda name: table[:, sum(layout.counts[: layout.fields.index(name)])])
        if layout.encoding == "binary":
            records = np.fromfile(stream, layout.dtype, layout.n_points)
        else:
            records = _read_compressed(file, stream, layout)
        return _content(layout, lambda name: records[f"f{layout.fields.index(name)}"])


def _content(layout: _Layout, column: Callable[[str], NDArray[Any]]) -> ScanFile:
    """Points and possible times of a file whose values `column` returns by the name of the field."""
    kinds = dict(zip(layout.fields, (np.dtype(f"<{kind.lower()}").name for kind in layout.types), strict=True))
    points = np.stack([as_float64(column(name)) for name in "xyz"], axis=1)
    times: dict[str, Column] = {
        name: (kinds[name], column(name))
        for name, count in zip(layout.fields, layout.counts, strict=True)
        if name.lower() in TIME_FIELDS and count == 1 and layout.fields.count(name) == 1
    }
    return ScanFile(points, times, ", ".join(f"{name} {kind}" for name, kind in kinds.items()))


def _read_compressed(file: Path, stream: BinaryIO, layout: _Layout) -> NDArray[np.void]:
    """Unpack the points behind a plain header, because pypcd4 refuses some legal ones (without COUNT)."""
    try:
        from pypcd4.pypcd4 import PointCloud
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package pypcd4 to read compressed points in {file}, got none installed."
            " pip install 'maxcon[pcd]'"
        ) from error
    header = [
        "VERSION 0.7",
        "FIELDS " + " ".join(f"f{i}" for i in range(len(layout.fields))),
        "SIZE " + " ".join(kind[1:] for kind in layout.types),
        "TYPE " + " ".join(kind[0] for kind in layout.types),
        "COUNT " + " ".join(map(str, layout.counts)),
        f"WIDTH {layout.n_points}\nHEIGHT 1\nPOINTS {layout.n_points}\nDATA binary_compressed\n",
    ]
    plain: Any = io.BytesIO("\n".join(header).encode("ascii") + stream.read())
    records: NDArray[np.void] = PointCloud.from_fileobj(plain).pc_data
    return records


def _read_layout(stream: BinaryIO, n_most: int) -> _Layout:
    """Read the header, and check it against the size of the file; the stream is left at the first point."""
    header = _header(stream)
    fields = tuple(header.get("FIELDS", []))
    if not any(name in fields for name in "xyz"):
        fields = tuple(name.lower() if name in ("X", "Y", "Z") else name for name in fields)
    sizes, kinds = header.get("SIZE", []), header.get("TYPE", [])
    types = tuple(kind + size for kind, size in zip(kinds, sizes, strict=False))
    counts = tuple(_whole_numbers(header, "COUNT", [1] * len(fields)))
    n_each = {len(fields), len(sizes), len(kinds), len(counts)}
    if len(n_each) != 1 or not set(types) <= TYPES or not 0 < sum(counts) <= MAX_COLUMNS or 0 in counts:
        raise ValueError("FIELDS, SIZE, TYPE, COUNT of different lengths, or of types other than F, U, I")
    for name in "xyz":
        if fields.count(name) != 1 or counts[fields.index(name)] != 1:
            raise ValueError(f"not one field {name!r} in FIELDS {printable(' '.join(fields)[:80])}")
    width, height = (_whole_numbers(header, key, default) for key, default in (("WIDTH", [0]), ("HEIGHT", [1])))
    area = [width[0] * height[0]]
    n_points = _whole_numbers(header, "POINTS", area)
    if n_points != area or not 0 < n_points[0] <= n_most or len(width + height) != 2:
        raise ValueError(f"{n_points[0]:,} points, WIDTH {width[0]:,} and HEIGHT {height[0]:,}")
    encoding = " ".join(header["DATA"])
    if encoding not in ENCODINGS:
        raise ValueError(f"DATA {encoding[:40]!r}, not {', '.join(ENCODINGS)}")
    layout = _Layout(encoding, stream.tell(), n_points[0], fields, types, counts)
    _check_size(stream, layout)
    return layout


def _header(stream: BinaryIO) -> dict[str, list[str]]:
    """Words behind each key; the stream stands behind the header afterwards."""
    header: dict[str, list[str]] = {}
    while "DATA" not in header:
        raw = stream.readline(MAX_HEADER_BYTES)
        if not raw.endswith(b"\n") or stream.tell() > MAX_HEADER_BYTES:
            raise ValueError(f"no header of at most {MAX_HEADER_BYTES} bytes that ends with DATA")
        words = raw.decode("latin-1").partition("#")[0].split()
        if words and (words[0] not in KEYS or words[0] in header):
            raise ValueError(f"the header line {words[0][:40]!r}, not {', '.join(KEYS)}, each once")
        if words:
            header[words[0]] = words[1:]
    return header


def _whole_numbers(header: dict[str, list[str]], key: str, default: list[int]) -> list[int]:
    texts = header.get(key)
    if texts is not None and not (texts and all(t.isascii() and t.isdigit() and len(t) < 19 for t in texts)):
        raise ValueError(f"no whole numbers as {key}: {' '.join(texts)[:40]!r}")
    return default if texts is None else [int(text) for text in texts]


def _check_size(stream: BinaryIO, layout: _Layout) -> None:
    """Check the number of points against the bytes that are there; the stream is left at their start."""
    n_there = stream.seek(0, 2) - layout.start
    stream.seek(layout.start)
    n_needed = layout.n_points * layout.dtype.itemsize
    if layout.encoding == "ascii":
        n_needed = layout.n_points * 2 * sum(layout.counts) - 1  # a digit and a blank or line end each
    elif layout.encoding == "binary_compressed":
        n_packed, n_unpacked = struct.unpack("<II", stream.read(8))
        stream.seek(layout.start)
        if n_unpacked != n_needed or n_unpacked > MAX_RATIO * n_packed:
            raise ValueError(f"{n_packed} bytes that unpack to {n_unpacked}, for points of {n_needed} bytes")
        n_needed = 8 + n_packed
    if n_there < n_needed:
        raise ValueError(f"{n_there} bytes of points, not {n_needed}: truncated")
