# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Reads PCD files; only DATA binary_compressed needs the package pypcd4."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error, as_float64
from maxcon.io.point_times import TIME_FIELDS, Column
from maxcon.io.scans.pcd_header import PcdLayout, read_pcd_layout
from maxcon.io.scans.scan_file import ScanFile
from maxcon.io.text import read_table

__all__ = ["read_pcd"]


def read_pcd(file: Path, n_most: int) -> ScanFile:
    """Return the points of a PCD file, and the fields that may be their times.

    Parameters
    ----------
    file : Path
        PCD with DATA ascii, binary or binary_compressed.
    n_most : int
        More points than this are refused before they are read.

    Raises
    ------
    FileError
        If the header is broken or does not fit the file.
    MissingExtraError
        If the points are compressed and the extra `pcd` is not installed.
    """
    with as_file_error(file, "a PCD file"), file.open("rb") as stream:
        layout = read_pcd_layout(file, stream, n_most)
        if layout.encoding == "ascii":
            table = _read_ascii(file, stream, layout)
            return _content(layout, lambda name: table[:, layout.column(name)])
        if layout.encoding == "binary":
            records = np.fromfile(stream, layout.dtype, layout.n_points)
        else:
            records = _read_compressed(file, stream, layout)
        return _content(layout, lambda name: records[f"f{layout.fields.index(name)}"])


def _content(layout: PcdLayout, column: Callable[[str], NDArray[Any]]) -> ScanFile:
    """Points and possible times of a file whose values `column` returns by the name of the field."""
    kinds = dict(zip(layout.fields, (np.dtype(f"<{kind.lower()}").name for kind in layout.types), strict=True))
    points = np.stack([as_float64(column(name)) for name in "xyz"], axis=1)
    once = [
        name
        for name, count in zip(layout.fields, layout.counts, strict=True)
        if name.lower() in TIME_FIELDS and count == 1 and layout.fields.count(name) == 1
    ]
    times: dict[str, Column] = {name: (kinds[name], column(name)) for name in once}
    return ScanFile(points, times, ", ".join(f"{name} {kind}" for name, kind in kinds.items()))


def _read_ascii(file: Path, stream: BinaryIO, layout: PcdLayout) -> NDArray[np.float64]:
    text = io.TextIOWrapper(stream, encoding="latin-1", newline="\n")
    table = read_table(file, text, layout.n_points, sum(layout.counts))
    if len(table) < layout.n_points:
        raise FileError(f"Expected {layout.n_points} points in {file}, got {len(table)}: truncated. Copy it again.")
    return table


def _read_compressed(file: Path, stream: BinaryIO, layout: PcdLayout) -> NDArray[np.void]:
    """Unpack the points behind a plain header, because pypcd4 refuses some legal ones (without COUNT)."""
    try:
        from pypcd4.pypcd4 import PointCloud
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package pypcd4 to read compressed points in {file}, got none installed."
            " pip install 'maxcon[pcd]'"
        ) from error
    header = "\n".join(
        [
            "VERSION 0.7",
            "FIELDS " + " ".join(f"f{i}" for i in range(len(layout.fields))),
            "SIZE " + " ".join(kind[1:] for kind in layout.types),
            "TYPE " + " ".join(kind[0] for kind in layout.types),
            "COUNT " + " ".join(str(count) for count in layout.counts),
            f"WIDTH {layout.n_points}",
            "HEIGHT 1",
            f"POINTS {layout.n_points}",
            "DATA binary_compressed\n",
        ]
    )
    plain: Any = io.BytesIO(header.encode("ascii") + stream.read())
    records: NDArray[np.void] = PointCloud.from_fileobj(plain).pc_data
    return records
