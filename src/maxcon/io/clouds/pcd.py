"""PCD: ascii, binary and compressed; the header is checked against the size of the file before points are read."""

import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import needs_extra
from maxcon.io.clouds.base import as_file_error
from maxcon.io.clouds.records import RecordLayout, RecordReader, n_columns
from maxcon.io.point_records import coordinate_fields, record_type

MAX_HEADER_BYTES = 2**16
MAX_COLUMNS = 10_000
MAX_RATIO = 300  # the compression of PCD reaches 88 at the very most
TYPES = {"F4", "F8", "U1", "U2", "U4", "U8", "I1", "I2", "I4", "I8"}
ENCODINGS = ("ascii", "binary", "binary_compressed")
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


class PcdReader(RecordReader):
    """Points of a PCD file of a map; a compressed one is in memory while it is read, and needs the extra `pcd`."""

    kind = "a PCD file of points"
    normal_names = ("normal_x", "normal_y", "normal_z")
    class_names = ("classification", "class", "label")
    time_names = ("gps_time", "time", "timestamp")
    ignores_case = False

    def _read_layout(self, stream: BinaryIO) -> RecordLayout:
        header = _header(stream)
        dtype = _dtype(header)
        width, height = (_whole_numbers(header, key, default) for key, default in (("WIDTH", [0]), ("HEIGHT", [1])))
        area = [width[0] * height[0]]
        n_points = _whole_numbers(header, "POINTS", area)
        if n_points != area or n_points == [0] or len(width + height) != 2:
            raise ValueError(f"{n_points[0]:,} points, WIDTH {width[0]:,} and HEIGHT {height[0]:,}")
        layout = RecordLayout(header["DATA"][0], stream.tell(), n_points[0], dtype)
        _check_size(stream, layout)
        return layout

    def _pieces(self, n_most: int) -> Iterator[Mapping[str, NDArray[Any]]]:
        if self._layout.encoding != "binary_compressed":
            return super()._pieces(n_most)
        with as_file_error(self.header.path, self.kind), self.header.path.open("rb") as stream:
            stream.seek(self._layout.start)
            columns = self._unpacked(stream)
        starts = range(0, self._layout.n_points, n_most)
        return ({name: values[k : k + n_most] for name, values in columns.items()} for k in starts)

    def _unpacked(self, stream: BinaryIO) -> dict[str, NDArray[Any]]:
        """All points of a compressed file, in columns by the names of their fields."""
        with needs_extra("pypcd4", f"to read compressed points in {self.header.path}", "pcd"):
            import lzf  # comes with pypcd4
        n_packed, n_unpacked = struct.unpack("<II", stream.read(8))
        data, at, columns = lzf.decompress(stream.read(n_packed), n_unpacked), 0, {}
        dtype = self._layout.dtype
        for name in dtype.names or ():  # one field behind the other
            kind = dtype[name]
            values = np.frombuffer(data, kind.base, self._layout.n_points * math.prod(kind.shape), at)
            columns[name] = values.reshape(-1, *kind.shape)
            at += values.nbytes
        return columns


def _dtype(header: dict[str, list[str]]) -> np.dtype[np.void]:
    """The type of a point; floating-point numbers of ascii are float64."""
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
    return dtype


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


def _check_size(stream: BinaryIO, layout: RecordLayout) -> None:
    """Check the number of points against the bytes that are there; the stream is left at their start."""
    n_there = stream.seek(0, 2) - layout.start
    stream.seek(layout.start)
    n_needed = layout.n_points * layout.dtype.itemsize
    if layout.encoding == "ascii":
        n_needed = layout.n_points * 2 * n_columns(layout.dtype) - 1  # a digit and a blank or line end each
    elif layout.encoding == "binary_compressed":
        n_packed, n_unpacked = struct.unpack("<II", stream.read(8))
        stream.seek(layout.start)
        if n_unpacked != n_needed or n_unpacked > MAX_RATIO * n_packed:
            raise ValueError(f"{n_packed} bytes that unpack to {n_unpacked}, for points of {n_needed} bytes")
        n_needed = 8 + n_packed
    if n_there < n_needed:
        raise ValueError(f"{n_there} bytes of points, not {n_needed}: truncated")
