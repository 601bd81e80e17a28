"""Clouds of rows of the same fields behind a header, as text or as bytes (PLY; `pcd`), or of an array each (NPZ)."""

import io
import math
import zipfile
from abc import abstractmethod
from collections import deque
from collections.abc import Generator, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.clouds import base
from maxcon.io.point_records import coordinate_fields, record_type
from maxcon.io.text import MAX_LINES, printable, table_of, text_lines

ARRAYS = {"points": (3,), "normals": (3,), "classes": (), "times": ()}
MAX_NPZ_RATIO = 100  # coordinates hardly compress: a large array that claims more was made to exhaust memory
NPZ = "an NPZ archive of numpy.savez(path, points=...)"
MAX_HEADER_BYTES = 2**18  # real headers have some hundred bytes, with long comments some thousand
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
LIST = "list"


class RecordLayout(NamedTuple):
    """Where and how the points of a file are stored."""

    encoding: str  # "ascii", or "binary", or another, of which the reader of the format makes pieces itself
    start: int  # where rows begin, bytes
    n_points: int  # how many points there are
    dtype: np.dtype[np.void]  # of one point
    n_rows_before: int = 0  # rows of text before the first point


class RecordReader(base.CloudReader):
    """Points of a file of rows; with normals, classes and times where it has fields of such names."""

    kind: ClassVar[str]
    normal_names: ClassVar[tuple[str, str, str]]
    class_names: ClassVar[tuple[str, ...]]
    time_names: ClassVar[tuple[str, ...]]
    ignores_case: ClassVar[bool]  # of names of classes and times

    def __init__(self, file: Path) -> None:
        super().__init__()
        with base.as_file_error(file, self.kind), file.open("rb") as stream:
            self._layout = self._read_layout(stream)
            dtype = self._layout.dtype
            scalars = [name for name in dtype.names or () if not dtype[name].shape]
            names = {name.lower() if self.ignores_case else name: name for name in reversed(scalars)}
            self.coordinates = coordinate_fields(dtype, "fiu")
            self._fields: dict[str, str | list[str]] = {"points": self.coordinates}
            if set(self.normal_names) <= set(scalars):
                self._fields["normals"] = coordinate_fields(dtype, "fiu", self.normal_names)
        for key, possible in (("classes", self.class_names), ("times", self.time_names)):
            if found := [names[name] for name in possible if name in names]:
                self._fields[key] = found[0]
        has: dict[str, Any] = {f"has_{key}": key in self._fields for key in ("normals", "classes", "times")}
        self.header = base.CloudHeader(file, self._layout.n_points, **has)

    @abstractmethod
    def _read_layout(self, stream: BinaryIO) -> RecordLayout:
        """Read the header, and check it against the size of the file; ValueError with what is there instead."""

    def records(self) -> NDArray[np.void]:
        """Return all points as records, shape (n,)."""
        found = np.empty(self._layout.n_points, self._layout.dtype)
        start = 0
        with np.errstate(invalid="ignore"):  # NaN in a field of integers
            for columns in self._pieces(self._layout.n_points):
                part = found[start : start + len(columns[self.coordinates[0]])]
                for name in found.dtype.names or ():
                    part[name] = columns[name]
                start += len(part)
        return found

    def _read(self, max_points: int, bounds: base.Bounds | None) -> Generator[base.CloudChunk]:
        for columns in self._pieces(base.rows_at_a_time(max_points, self._layout.dtype.itemsize)):
            yield base.cloud_chunk(**{key: _column(columns, names) for key, names in self._fields.items()})

    def _pieces(self, n_most: int) -> Iterator[Mapping[str, NDArray[Any]]]:
        """Yield the fields of the points, at most so many points at a time; those of text are float64."""
        layout, file = self._layout, self.header.path
        with base.as_file_error(file, self.kind), file.open("rb") as stream:
            stream.seek(layout.start)
            lines = text_lines(io.TextIOWrapper(stream, encoding="latin-1", newline="\n"))
            if layout.encoding == "ascii":
                n_most = min(n_most, MAX_LINES)
                deque(islice(lines, layout.n_rows_before), maxlen=0)
            for start in range(0, layout.n_points, n_most):
                n_rows = min(n_most, layout.n_points - start)
                if layout.encoding == "ascii":
                    yield _parsed(list(islice(lines, n_rows)), n_rows, layout.dtype)
                else:
                    records: Any = np.fromfile(stream, layout.dtype, n_rows)
                    if len(records) < n_rows:
                        raise ValueError(f"{n_rows - len(records)} points fewer: truncated")
                    yield records


def _column(columns: Mapping[str, NDArray[Any]], names: str | list[str]) -> NDArray[Any]:
    return columns[names] if isinstance(names, str) else np.stack([columns[name] for name in names], axis=1)


def n_columns(dtype: np.dtype[np.void]) -> int:
    """Return how many numbers a point has."""
    return sum(math.prod(dtype[name].shape) for name in dtype.names or ())


def _parsed(lines: list[str], n_rows: int, dtype: np.dtype[np.void]) -> dict[str, NDArray[np.float64]]:
    if len(lines) < n_rows:
        raise ValueError(f"{n_rows - len(lines)} rows of numbers fewer: truncated")
    table, columns, at = table_of(lines, n_columns(dtype)), {}, 0
    for name in dtype.names or ():
        shape = dtype[name].shape
        columns[name] = table[:, at : at + math.prod(shape)].reshape(-1, *shape)
        at += math.prod(shape)
    return columns


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


class NpzReader(base.CloudReader):
    """Points of an archive of `numpy.savez`, in memory as they were written; nothing is unpickled."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        with base.as_file_error(file, NPZ):
            self._arrays = _read_arrays(file)
        has: dict[str, Any] = {f"has_{name}": name in self._arrays for name in ("normals", "classes", "times")}
        self.header = base.CloudHeader(file, len(self._arrays["points"]), **has)

    def _read(self, max_points: int, bounds: base.Bounds | None) -> Generator[base.CloudChunk]:
        with base.as_file_error(self.header.path, NPZ):
            for start in range(0, self.header.n_points, max_points):
                part = slice(start, start + max_points)
                yield base.cloud_chunk(**{name: array[part] for name, array in self._arrays.items()})


def _read_arrays(file: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by their names, each with a row per point."""
    with zipfile.ZipFile(file) as archive:
        there = {info.filename.removesuffix(".npy") for info in archive.infolist()}
        if "points" not in there:
            raise ValueError(f"no array `points` among {printable(', '.join(sorted(there))) or 'none'}")
        arrays = {name: _array(archive, name) for name in ARRAYS if name in there}
    if len({len(array) for array in arrays.values()}) > 1 or not len(arrays["points"]):
        counts = ", ".join(f"{len(array)} of `{name}`" for name, array in arrays.items())
        raise ValueError(f"rows that are none, or not one per point: {counts}")
    return arrays


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """One array; its header is held against the bytes that are there, which NumPy would allocate for it first."""
    info = archive.getinfo(f"{name}.npy")
    if name == "points":  # classes that are all alike do compress
        base.check_unpacked_size(info.file_size, info.compress_size, MAX_NPZ_RATIO)
    stream = io.BytesIO(archive.read(info))
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, dtype = read_header(stream)
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise ValueError(f"`{name}` of {dtype}, no numbers: save .astype(float)")
    if len(shape) != 1 + len(ARRAYS[name]) or shape[1:] != ARRAYS[name]:
        raise ValueError(f"`{name}` of shape {shape}, not (n{', 3' if ARRAYS[name] else ','})")
    return np.ndarray(shape, dtype, stream.getbuffer(), stream.tell(), order="F" if is_fortran else "C")
