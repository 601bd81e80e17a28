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
from maxcon.io.clouds.base import (
    CloudChunk,
    CloudHeader,
    CloudReader,
    as_classes,
    as_file_error,
    as_float64,
    rows_at_a_time,
)
from maxcon.io.text import printable

__all__ = ["NpzReader"]

COLUMNS = {"points": 3, "normals": 3, "classes": 0, "times": 0}
# Coordinates hardly compress; a large array that claims a higher ratio than this was made to exhaust memory.
MAX_RATIO = 100
SMALL_BYTES = 2**24
KIND = "an NPZ archive"


class _Member(NamedTuple):
    """One array of the archive: its number of rows, and their type."""

    name: str
    dtype: np.dtype[np.generic]
    n_rows: int
    n_columns: int

    @property
    def row_bytes(self) -> int:
        return self.dtype.itemsize * max(1, self.n_columns)


class NpzReader(CloudReader):
    """Points of an archive written by `numpy.savez` or `numpy.savez_compressed`; nothing is unpickled.

    Arrays are `points` (n, 3), and optionally `normals` (n, 3), `classes` (n,) and `times` (n,).

    Parameters
    ----------
    file : Path
        An existing file.

    Raises
    ------
    FileError
        If it is no such archive, an array has another shape or type than these, or sizes contradict.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND), zipfile.ZipFile(file) as archive:
            there = {info.filename.removesuffix(".npy") for info in archive.infolist()}
            if "points" not in there:
                raise FileError(
                    f"Expected an array `points` in {file}, got {printable(', '.join(sorted(there))[:80]) or 'none'}."
                    " Save it with numpy.savez(path, points=points)."
                )
            self._members = [_open_member(file, archive, name)[0] for name in COLUMNS if name in there]
        n_points = self._members[0].n_rows
        for member in self._members:
            if member.n_rows != n_points:
                raise FileError(
                    f"Expected `{member.name}` in {file} to have one row per point, {n_points}, got"
                    f" {member.n_rows}."
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
        n_most = rows_at_a_time(max_points, sum(member.row_bytes for member in self._members))
        with as_file_error(file, KIND), zipfile.ZipFile(file) as archive, ExitStack() as streams:
            opened = [_open_member(file, archive, member.name) for member in self._members]
            for _, stream in opened:
                streams.enter_context(stream)
            while n_left > 0:
                n_rows = min(n_left, n_most)
                n_left -= n_rows
                yield _chunk(file, {m.name: _read_rows(file, m, stream, n_rows) for m, stream in opened})
            for _, stream in opened:
                stream.read(1)  # at the end of a member its checksum is compared


def _chunk(file: Path, arrays: dict[str, NDArray[np.generic]]) -> CloudChunk:
    def floats(name: str) -> NDArray[np.float64] | None:
        return as_float64(arrays[name]) if name in arrays else None

    classes = as_classes(file, "classes", arrays["classes"]) if "classes" in arrays else None
    return CloudChunk(as_float64(arrays["points"]), floats("normals"), classes, floats("times"))


def _open_member(file: Path, archive: zipfile.ZipFile, name: str) -> tuple[_Member, IO[bytes]]:
    """Return what one array is, checked against the archive, and a stream that stands at its first row."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FileError(f"Expected {file} to be stored or deflated, got another compression. Save it with numpy.savez.")
    if info.file_size > SMALL_BYTES and name == "points" and info.file_size > MAX_RATIO * info.compress_size:
        raise FileError(
            f"Expected `points` in {file} to unpack to at most {MAX_RATIO} times its size, got"
            f" {info.file_size / max(1, info.compress_size):.0f} times. Is it real data? Save it"
            " uncompressed."
        )
    stream = archive.open(info)
    shape, is_fortran, dtype = _read_array_header(file, name, stream)
    n_columns = COLUMNS[name]
    wanted = f"(n, {n_columns})" if n_columns else "(n,)"
    if len(shape) != (2 if n_columns else 1) or min(shape) < 0 or (n_columns and shape[1] != n_columns):
        raise FileError(
            f"Expected `{name}` in {file} to have shape {wanted}, got {shape}. Save it with one row per point."
        )
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise FileError(f"Expected numbers as `{name}` in {file}, got {dtype}. Convert it with .astype(float).")
    if is_fortran and n_columns and shape[0] > 1:
        raise FileError(
            f"Expected `{name}` in {file} row by row, got columns first (Fortran order), which cannot be"
            " read in"
            " pieces. Save numpy.ascontiguousarray of it."
        )
    member = _Member(name, dtype, shape[0], n_columns)
    if stream.tell() + member.n_rows * member.row_bytes != info.file_size:
        raise FileError(
            f"Expected {member.n_rows * member.row_bytes} bytes of `{name}` in {file}, got"
            f" {info.file_size - stream.tell()}. The archive is broken; save it anew."
        )
    return member, stream


def _read_array_header(file: Path, name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(stream)
    raise FileError(f"Expected `{name}` in {file} in NPY format 1.0 or 2.0, got {version}. Save it with numpy.savez.")


def _read_rows(file: Path, member: _Member, stream: IO[bytes], n_rows: int) -> NDArray[np.generic]:
    raw = stream.read(n_rows * member.row_bytes)
    if len(raw) < n_rows * member.row_bytes:
        raise FileError(
            f"Expected {member.n_rows} rows of `{member.name}` in {file}, got fewer: truncated. Copy it again."
        )
    rows = np.frombuffer(raw, member.dtype)
    return rows.reshape(n_rows, member.n_columns) if member.n_columns else rows
