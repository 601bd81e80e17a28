# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""NPZ: arrays `points`, and optionally `normals`, `classes`, `times`, streamed out of the archive."""

import zipfile
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.clouds.base import (
    Bounds,
    CloudChunk,
    CloudHeader,
    CloudReader,
    as_classes,
    as_file_error,
    as_float64,
    check_unpacked_size,
    rows_at_a_time,
)
from maxcon.io.text import printable

COLUMNS = {"points": 3, "normals": 3, "classes": 0, "times": 0}
# Coordinates hardly compress; a large array that claims a higher ratio than this was made to exhaust memory.
MAX_RATIO = 100
KIND = "an NPZ archive of numpy.savez(path, points=...)"


class _Member(NamedTuple):
    """One array of the archive: its name, type and shape of a row, number of rows, and a stream at the first."""

    name: str
    row: np.dtype[np.void]
    n_rows: int
    stream: IO[bytes]


class NpzReader(CloudReader):
    """Points of an archive written by `numpy.savez` or `numpy.savez_compressed`; nothing is unpickled.

    Arrays are `points` (n, 3), and optionally `normals` (n, 3), `classes` (n,) and `times` (n,). FileError if it is no
    such archive, an array has another shape or type than these, or sizes contradict.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND), zipfile.ZipFile(file) as archive, ExitStack() as streams:
            there = {info.filename.removesuffix(".npy") for info in archive.infolist()}
            if "points" not in there:
                raise ValueError(f"no array `points` among {printable(', '.join(sorted(there))) or 'none'}")
            self._names = [name for name in COLUMNS if name in there]
            n_rows = [_open_member(archive, name, streams).n_rows for name in self._names]
            if len(set(n_rows)) > 1 or n_rows[0] == 0:
                counts = ", ".join(f"{n} of `{name}`" for name, n in zip(self._names, n_rows, strict=True))
                raise ValueError(f"rows that are none, or not one per point: {counts}")
        has_normals, has_classes, has_times = (name in there for name in ("normals", "classes", "times"))
        self.header = CloudHeader(
            file, n_rows[0], has_normals=has_normals, has_classes=has_classes, has_times=has_times
        )

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        file, n_left = self.header.path, self.header.n_points
        with as_file_error(file, KIND), zipfile.ZipFile(file) as archive, ExitStack() as streams:
            members = [_open_member(archive, name, streams) for name in self._names]
            n_most = rows_at_a_time(max_points, sum(member.row.itemsize for member in members))
            while n_left > 0:
                n_rows = min(n_left, n_most)
                n_left -= n_rows
                arrays = {member.name: _read_rows(member, n_rows) for member in members}
                floats = {name: as_float64(array) for name, array in arrays.items() if name != "classes"}
                classes = as_classes(arrays["classes"]) if "classes" in arrays else None
                yield CloudChunk(floats["points"], floats.get("normals"), classes, floats.get("times"))
            for member in members:
                member.stream.read(1)  # at the end of a member its checksum is compared


def _open_member(archive: zipfile.ZipFile, name: str, streams: ExitStack) -> _Member:
    """One array, checked against the archive."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("another compression than stored or deflated")
    if name == "points":  # classes that are all alike do compress
        check_unpacked_size(info.file_size, info.compress_size, MAX_RATIO)
    stream = streams.enter_context(archive.open(info))
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, is_fortran, dtype = read_header(stream)
    wanted = tuple(filter(None, (-1, COLUMNS[name])))
    if len(shape) != len(wanted) or shape[1:] != wanted[1:] or min(shape) < 0:
        raise ValueError(f"`{name}` of shape {shape}, not (n{', 3' if COLUMNS[name] else ','})")
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise ValueError(f"`{name}` of {dtype}, no numbers: save .astype(float)")
    if is_fortran and len(shape) > 1 and shape[0] > 1:
        raise ValueError(f"`{name}` in Fortran order: save numpy.ascontiguousarray of it")
    row = np.dtype((dtype, shape[1:]))
    if shape[0] * row.itemsize != info.file_size - stream.tell():
        raise ValueError(f"another number of bytes of `{name}` than of its {shape[0]} rows")
    return _Member(name, row, shape[0], stream)


def _read_rows(member: _Member, n_rows: int) -> NDArray[np.generic]:
    raw = member.stream.read(n_rows * member.row.itemsize)
    return np.frombuffer(raw, member.row.base).reshape(n_rows, *member.row.shape)
