# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PCD: ascii, binary and compressed; the header is checked against the size of the file before points are read."""

import io
import math
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import needs_extra
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudReader, FieldNames, as_file_error, rows_at_a_time
from maxcon.io.point_records import coordinate_fields, record_type
from maxcon.io.text import MAX_LINES, read_table

MAX_HEADER_BYTES = 2**16
MAX_COLUMNS = 10_000
MAX_RATIO = 300
"""The compression of PCD reaches 88 at the very most."""
TYPES = {"F4", "F8", "U1", "U2", "U4", "U8", "I1", "I2", "I4", "I8"}
ENCODINGS = ("ascii", "binary", "binary_compressed")
KIND = "a PCD file of points"
NORMAL_NAMES = ("normal_x", "normal_y", "normal_z")
CLASS_NAMES, TIME_NAMES = ("classification", "class", "label"), ("gps_time", "time", "timestamp")
MAX_POINTS = 10**12
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


class PcdReader(CloudReader):
    """Points of a PCD file of a map; with normals, classes and times where it has such fields.

    Normals are normal_x, normal_y, normal_z; classes `classification`, `class` or `label`; times, of the trajectory's
    clock, `gps_time`, `time` or `timestamp`. A compressed file, of at most 4 GiB by its format, is in memory as a
    whole while it is read, others by pieces. FileError as of `read_pcd`.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND), file.open("rb") as stream:
            self._layout = _read_layout(stream, MAX_POINTS)
        dtype = self._layout.dtype
        names = [name for name, kind in _fields(dtype) if not kind.shape]
        self._fields = FieldNames(
            coordinate_fields(dtype, "fiu"),
            coordinate_fields(dtype, "fiu", NORMAL_NAMES) if set(NORMAL_NAMES) <= set(names) else None,
            next((name for name in CLASS_NAMES if name in names), None),
            next((name for name in TIME_NAMES if name in names), None),
        )
        self.header = self._fields.header(file, self._layout.n_points)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        n_most = rows_at_a_time(max_points, self._layout.dtype.itemsize)
        if self._layout.encoding == "ascii":
            n_most = min(n_most, MAX_LINES)
        with as_file_error(self.header.path, KIND), self.header.path.open("rb") as stream:
            stream.seek(self._layout.start)
            for records in _pieces(self.header.path, stream, self._layout, n_most):
                yield self._fields.chunk(records)


class _Layout(NamedTuple):
    """Where the points of a PCD file begin, how many there are, and the type of one."""

    encoding: str
    start: int
    n_points: int
    dtype: np.dtype[np.void]


def read_pcd(file: Path, n_most: int) -> NDArray[np.void]:
    """Return the points of a PCD file (ascii, binary or binary_compressed) as records, shape (n,).

    Points without a return (not finite, or at the origin) are among them; floating-point numbers of ascii are float64.

    FileError if the header is broken or does not fit the file, or there are no points or more than `n_most`;
    MissingExtraError if the points are compressed and the extra `pcd` is not installed.
    """
    with as_file_error(file, f"a PCD file of 1 to {n_most:,} points"), file.open("rb") as stream:
        layout = _read_layout(stream, n_most)
        return next(_pieces(file, stream, layout, layout.n_points))


def _pieces(file: Path, stream: BinaryIO, layout: _Layout, n_most: int) -> Iterator[NDArray[np.void]]:
    """Yield the points as records, at most so many at a time; the stream is at the first point."""
    text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n") if layout.encoding == "ascii" else None
    columns = dict(_unpacked(file, stream, layout)) if layout.encoding == "binary_compressed" else None
    for start in range(0, layout.n_points, n_most):
        n_rows = min(n_most, layout.n_points - start)
        if columns is not None:
            yield _records({name: values[start : start + n_rows] for name, values in columns.items()}, layout, n_rows)
        elif text is not None:
            yield _records(dict(_parsed(text, layout, n_rows)), layout, n_rows)
        else:
            yield np.fromfile(stream, layout.dtype, n_rows)


def _records(columns: dict[str, NDArray[Any]], layout: _Layout, n_rows: int) -> NDArray[np.void]:
    records = np.empty(n_rows, layout.dtype)
    with np.errstate(invalid="ignore"):  # NaN in a field of integers
        for name, values in columns.items():
            records[name] = values
    return records


def _parsed(text: TextIO, layout: _Layout, n_rows: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the fields of the next rows of an ascii file and their numbers."""
    table = read_table(text, n_rows, _n_columns(layout.dtype))
    at = 0
    for name, kind in _fields(layout.dtype):
        n_columns = math.prod(kind.shape)
        yield name, table[:, at : at + n_columns].reshape(-1, *kind.shape)
        at += n_columns


def _unpacked(file: Path, stream: BinaryIO, layout: _Layout) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the fields of a compressed file and their numbers, which lie one field behind the other."""
    with needs_extra("pypcd4", f"to read compressed points in {file}", "pcd"):
        import lzf  # comes with pypcd4
    n_packed, n_unpacked = struct.unpack("<II", stream.read(8))
    data, at = lzf.decompress(stream.read(n_packed), n_unpacked), 0
    for name, kind in _fields(layout.dtype):
        values = np.frombuffer(data, kind.base, layout.n_points * math.prod(kind.shape), at)
        yield name, values.reshape(-1, *kind.shape)
        at += values.nbytes


def _fields(dtype: np.dtype[np.void]) -> list[tuple[str, np.dtype[Any]]]:
    return [(name, dtype[name]) for name in dtype.names or ()]


def _n_columns(dtype: np.dtype[np.void]) -> int:
    return sum(math.prod(kind.shape) for _, kind in _fields(dtype))


def _read_layout(stream: BinaryIO, n_most: int) -> _Layout:
    """Read the header, and check it against the size of the file; the stream is left at the first point."""
    header = _header(stream)
    fields, sizes, kinds = (header.get(key, []) for key in ("FIELDS", "SIZE", "TYPE"))
    types = [kind + size for kind, size in zip(kinds, sizes, strict=False)]
    counts = _whole_numbers(header, "COUNT", [1] * len(fields))
    n_each = {len(fields), len(sizes), len(kinds), len(counts)}
    if len(n_each) != 1 or not set(types) <= TYPES or not 0 < sum(counts) <= MAX_COLUMNS or 0 in counts:
        raise ValueError("FIELDS, SIZE, TYPE, COUNT of different lengths, or of types other than F, U, I")
    encoding = " ".join(header["DATA"])
    if encoding not in ENCODINGS:
        raise ValueError(f"DATA {encoding[:40]!r}, not {', '.join(ENCODINGS)}")
    if encoding == "ascii":
        types = ["F8" if kind == "F4" else kind for kind in types]
    formats = [f"{f'({n},)' if n > 1 else ''}<{kind.lower()}" for kind, n in zip(types, counts, strict=True)]
    dtype = record_type(fields, formats)
    coordinate_fields(dtype, "fiu")
    width, height = (_whole_numbers(header, key, default) for key, default in (("WIDTH", [0]), ("HEIGHT", [1])))
    area = [width[0] * height[0]]
    n_points = _whole_numbers(header, "POINTS", area)
    if n_points != area or not 0 < n_points[0] <= n_most or len(width + height) != 2:
        raise ValueError(f"{n_points[0]:,} points, WIDTH {width[0]:,} and HEIGHT {height[0]:,}")
    layout = _Layout(encoding, stream.tell(), n_points[0], dtype)
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
        n_needed = layout.n_points * 2 * _n_columns(layout.dtype) - 1  # a digit and a blank or line end each
    elif layout.encoding == "binary_compressed":
        n_packed, n_unpacked = struct.unpack("<II", stream.read(8))
        stream.seek(layout.start)
        if n_unpacked != n_needed or n_unpacked > MAX_RATIO * n_packed:
            raise ValueError(f"{n_packed} bytes that unpack to {n_unpacked}, for points of {n_needed} bytes")
        n_needed = 8 + n_packed
    if n_there < n_needed:
        raise ValueError(f"{n_there} bytes of points, not {n_needed}: truncated")
