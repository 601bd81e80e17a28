# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Reads a scan file of any format; the suffix tells which."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import check_regular
from maxcon.errors import FileError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.base import as_float64
from maxcon.io.scans.pcd import read_pcd
from maxcon.io.scans.scan_file import ScanFile

__all__ = ["MAX_SCAN_POINTS", "read_scan_file"]

# The densest scanners return some hundred thousand points per turn; more is a map in the wrong place, and would take
# over a gigabyte (about 200 bytes a point) to localize.
MAX_SCAN_POINTS = 5_000_000
KITTI_RECORD = 16


def read_scan_file(file: Path) -> ScanFile:
    """Return the points of a scan file, and the fields that may be their times.

    Raises
    ------
    FileError
        If the file is empty, truncated or broken, or has more than 5 million points.
    MissingExtraError
        If it is a PCD file and the extra `pcd` is not installed.
    """
    suffix = file.suffix.lower()
    try:
        check_regular(file)
        if suffix == ".bin":
            return ScanFile(_read_kitti(file))
        if suffix == ".pcd":
            return read_pcd(file, MAX_SCAN_POINTS)
        return ScanFile(_read_cloud(file))
    except OSError as error:
        raise FileError(f"Expected to be able to read {file}, got: {error.strerror}. Check the file.") from error


def _check_count(file: Path, n_points: int) -> None:
    if n_points > MAX_SCAN_POINTS:
        raise FileError(
            f"Expected a scan of at most {MAX_SCAN_POINTS:,} points, got {n_points:,} in {file}. Is it a map?"
        )


def _read_kitti(file: Path) -> NDArray[np.float64]:
    n_bytes = file.stat().st_size
    if n_bytes == 0 or n_bytes % KITTI_RECORD:
        raise FileError(
            f"Expected float32 x, y, z, reflectance in {file}, {KITTI_RECORD} bytes per point, got"
            f" {n_bytes} bytes."
            " Is the file empty or truncated? Copy it again."
        )
    _check_count(file, n_bytes // KITTI_RECORD)
    return as_float64(np.fromfile(file, dtype="<f4").reshape(-1, 4)[:, :3])


def _read_cloud(file: Path) -> NDArray[np.float64]:
    with open_cloud(file) as reader:
        _check_count(file, reader.header.n_points)
        chunks = [chunk.points for chunk in reader.chunks()]
    return np.concatenate(chunks) if chunks else np.empty((0, 3))
