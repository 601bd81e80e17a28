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

from maxcon.errors import FileError
from maxcon.io.clouds import base
from maxcon.io.clouds.base import CloudChunk, CloudHeader, CloudReader, as_file_error, as_float64
from maxcon.io.text import printable

COLUMNS = {"points": 3, "normals": 3, "classes": 0, "times": 0}
# Coordinates hardly compress; a large array that claims a higher ratio than this was made to exhaust memory.
MAX_RATIO = 100
KIND = "an NPZ archive"


class _Member(NamedTuple):
    """One array of the archive: type and shape of a row, the number of rows, and a stream at the first."""

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
                raise FileError(
                    f"Expected an array `points` in {file}, got {printable(', '.join(sorted(there))[:80]) or 'none'}."
                    " Save it with numpy.savez(path, points=points)."
                )
            self._names = [name for name in COLUMNS if name in there]
            members = [_open_member(file, archive, name, streams) for name in self._names]
        n_points = members[0].n_rows
        for member in members:
            if member.n_rows != n_points:
                raise FileError(
                    f"Expected `{member.name}` in {file} to have one row per point, {n_points}, got {member.n_rows}."
                    " Save them together."
                )
        if n_points == 0:
            raise FileError(f"Expected points in {file}, got none. Leave this file out.")
        self.header = CloudHeader(
            path=file,
            n_points=n_points,
            has_normals="normals" in there,
            has_classes="classes" in there,
            has_times="times" in there,
        )

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        file, n_left = self.header.path, self.header.n_points
        with as_file_error(file, KIND), zipfile.ZipFile(file) as archive, ExitStack() as streams:
            members = [_open_member(file, archive, name, streams) for name in self._names]
            n_most = base.rows_at_a_time(max_points, sum(member.row.itemsize for member in members))
            while n_left > 0:
                n_rows = min(n_left, n_most)
                n_left -= n_rows
                arrays = {member.name: _read_rows(file, member, n_rows) for member in members}
                floats = {name: as_float64(array) for name, array in arrays.items() if name != "classes"}
                classes = base.as_classes(file, "classes", arrays["classes"]) if "classes" in arrays else None
                yield CloudChunk(floats["points"], floats.get("normals"), classes, floats.get("times"))
            for member in members:
                member.stream.read(1)  # at the end of a member its checksum is compared


def _open_member(file: Path, archive: zipfile.ZipFile, name: str, streams: ExitStack) -> _Member:
    """Return one array, checked against the archive."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FileError(f"Expected {file} to be stored or deflated, got another compression. Save it with numpy.savez.")
    if name == "points":  # classes that are all alike do compress
        base.check_unpacked_size(
            f"`points` in {file}", info.file_size, info.compress_size, MAX_RATIO, "Save it uncompressed."
        )
    stream = streams.enter_context(archive.open(info))
    shape, is_fortran, dtype = _read_array_header(file, name, stream)
    n_columns = COLUMNS[name]
    if len(shape) != (2 if n_columns else 1) or min(shape) < 0 or (n_columns and shape[1] != n_columns):
        wanted = f"(n, {n_columns})" if n_columns else "(n,)"
        raise FileError(
            f"Expected `{name}` in {file} to have shape {wanted}, got {shape}. Save it with one row per point."
        )
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise FileError(f"Expected numbers as `{name}` in {file}, got {dtype}. Convert it with .astype(float).")
    if is_fortran and n_columns and shape[0] > 1:
        raise FileError(
            f"Expected `{name}` in {file} row by row, got columns first (Fortran order), which cannot be read in"
            " pieces. Save numpy.ascontiguousarray of it."
        )
    row = np.dtype((dtype, shape[1:]))
    n_bytes, n_there = shape[0] * row.itemsize, info.file_size - stream.tell()
    if n_bytes != n_there:
        raise FileError(
            f"Expected {n_bytes} bytes of `{name}` in {file}, got {n_there}. The archive is broken; save it anew."
        )
    return _Member(name, row, shape[0], stream)


def _read_array_header(file: Path, name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(stream)
    raise FileError(f"Expected `{name}` in {file} in NPY format 1.0 or 2.0, got {version}. Save it with numpy.savez.")


def _read_rows(file: Path, member: _Member, n_rows: int) -> NDArray[np.generic]:
    raw = member.stream.read(n_rows * member.row.itemsize)
    if len(raw) < n_rows * member.row.itemsize:
        raise FileError(
            f"Expected {member.n_rows} rows of `{member.name}` in {file}, got fewer: truncated. Copy it again."
        )
    values = np.frombuffer(raw, member.row.base)
    return values.reshape(n_rows, *member.row.shape)
