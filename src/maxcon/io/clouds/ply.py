# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PLY: ascii and binary of either byte order, any scalar types of properties."""

import io
from collections.abc import Generator
from pathlib import Path
from typing import Any, BinaryIO

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
from maxcon.io.clouds.ply_header import PlyLayout, read_ply_layout
from maxcon.io.text import read_lines, read_table

__all__ = ["PlyReader"]

POINT_NAMES = ("x", "y", "z")
NORMAL_NAMES = ("nx", "ny", "nz")
CLASS_NAMES = ("classification", "class", "label", "scalar_classification", "scalar_class", "scalar_label")
TIME_NAMES = ("gps_time", "gpstime", "time", "scalar_gpstime", "scalar_gps_time")
# Lines of text are heavier in memory than their numbers: a quarter of a million take about 100 MB.
MAX_LINES = 250_000

Columns = list[NDArray[Any]]


class PlyReader(CloudReader):
    """Points of a PLY file; with normals, classes and times where it has such properties.

    Normals are nx, ny, nz; classes `classification`, `class` or `label`; times `gps_time` or `time`; of these, whatever
    their case, also as scalar fields of CloudCompare: `scalar_Classification`. Elements other than `vertex` are passed
    over.

    Parameters
    ----------
    file : Path
        An existing file.

    Raises
    ------
    FileError
        If it is not PLY, has no x, y, z, has lists in its vertices or before them, or is too short.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, "a PLY file"), file.open("rb") as stream:
            self._layout = read_ply_layout(file, stream)
        names = self._layout.names
        self._points = self._columns(file, POINT_NAMES)
        self._normals = self._columns(file, NORMAL_NAMES) if set(NORMAL_NAMES) <= set(names) else None
        lowered = [name.lower() for name in names]
        self._classes = next((lowered.index(name) for name in CLASS_NAMES if name in lowered), None)
        self._times = next((lowered.index(name) for name in TIME_NAMES if name in lowered), None)
        self.header = CloudHeader(
            path=file,
            n_points=self._layout.n_points,
            has_normals=self._normals is not None,
            has_classes=self._classes is not None,
            has_times=self._times is not None,
        )

    def _columns(self, file: Path, wanted: tuple[str, ...]) -> list[int]:
        names = self._layout.names
        for name in wanted:
            if names.count(name) != 1:
                raise FileError(
                    f"Expected one property {name!r} per vertex in {file}, got {names.count(name)} in"
                    f" '{' '.join(names)[:80]}'. Export the points with x, y, z."
                )
        return [names.index(name) for name in wanted]

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        file, layout = self.header.path, self._layout
        with as_file_error(file, "a PLY file"), file.open("rb") as stream:
            stream.seek(layout.start)
            rows = _ascii_rows if layout.is_ascii else _binary_rows
            for columns in rows(file, stream, layout, max_points):
                yield self._chunk(columns)

    def _chunk(self, columns: Columns) -> CloudChunk:
        def table(indices: list[int]) -> NDArray[np.float64]:
            return np.stack([as_float64(columns[i]) for i in indices], axis=1)

        classes = None
        if self._classes is not None:
            classes = as_classes(self.header.path, self._layout.names[self._classes], columns[self._classes])
        return CloudChunk(
            points=table(self._points),
            normals=None if self._normals is None else table(self._normals),
            classes=classes,
            times=None if self._times is None else as_float64(columns[self._times]),
        )


def _truncated(file: Path, layout: PlyLayout, n_missing: int) -> FileError:
    return FileError(f"Expected {layout.n_points} vertices in {file}, got {n_missing} fewer: truncated. Copy it again.")


def _binary_rows(file: Path, stream: BinaryIO, layout: PlyLayout, max_points: int) -> Generator[Columns]:
    """Yield the columns of some vertices at a time, by number of property."""
    n_left = layout.n_points
    n_most = rows_at_a_time(max_points, layout.dtype.itemsize)
    while n_left > 0:
        n_rows = min(n_left, n_most)
        records = np.fromfile(stream, layout.dtype, n_rows)
        if len(records) < n_rows:
            raise _truncated(file, layout, n_left - len(records))
        yield [records[name] for name in layout.dtype.names or ()]
        n_left -= n_rows


def _ascii_rows(file: Path, stream: BinaryIO, layout: PlyLayout, max_points: int) -> Generator[Columns]:
    """As `_binary_rows`, from lines of text."""
    text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n")
    read_lines(file, text, layout.n_rows_before, keep=False)
    n_left = layout.n_points
    while n_left > 0:
        n_rows = min(n_left, max_points, MAX_LINES)
        values = read_table(file, text, n_rows, len(layout.names))
        if len(values) < n_rows:
            raise _truncated(file, layout, n_left - len(values))
        yield list(values.T)
        n_left -= n_rows
