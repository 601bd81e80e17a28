# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points of a scan file of any format, by its suffix; .bin of floats: x, y, z with reflectance (KITTI), or alone."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import check_regular
from maxcon.errors import FileError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.base import as_float64
from maxcon.io.scans.pcd import ScanFile, read_pcd

# The densest scanners return some hundred thousand points per turn; more is a map in the wrong place, and would take
# over a gigabyte (about 200 bytes a point) to localize.
MAX_SCAN_POINTS = 5_000_000
BLOCK, N_BLOCKS = 12, 400
"""Floats that are whole points of three and of four numbers, and how many such blocks are compared."""
LEAST_DIFFERENCE = 0.1
"""Between the distributions of x, y, z and reflectance in a file that is read with the right count of numbers. On 149
real scans it is 0.41 to 1.0, and at most 0.02 with a wrong count: every column then holds x, y and z in turn."""


def read_scan_file(file: Path) -> ScanFile:
    """Return the points of a scan file, and the fields that may be their times.

    FileError if it is empty, truncated or broken, or has more than 5 million points; MissingExtraError if it is a PCD
    file and the extra `pcd` is not installed.
    """
    suffix = file.suffix.lower()
    try:
        check_regular(file)
        if suffix == ".bin":
            return _read_floats(file)
        if suffix == ".pcd":
            return read_pcd(file, MAX_SCAN_POINTS)
        with open_cloud(file) as reader:
            _check_count(file, reader.header.n_points)
            chunks = [chunk.points for chunk in reader.chunks()]
        return ScanFile(np.concatenate(chunks) if chunks else np.empty((0, 3)))
    except OSError as error:
        raise FileError(f"Expected to be able to read {file}, got: {error.strerror}. Check the file.") from error


def _check_count(file: Path, n_points: int) -> None:
    if n_points > MAX_SCAN_POINTS:
        raise FileError(
            f"Expected a scan of at most {MAX_SCAN_POINTS:,} points, got {n_points:,} in {file}. Is it a map?"
        )


def _read_floats(file: Path) -> ScanFile:
    n_bytes = file.stat().st_size
    _check_count(file, n_bytes // 16)
    values = np.fromfile(file, dtype="<f4")
    if n_bytes and n_bytes % 12 == 0 and _are_triples(values):
        return ScanFile(as_float64(values.reshape(-1, 3)), fields="x float32, y float32, z float32")
    if n_bytes == 0 or n_bytes % 16:
        raise FileError(
            f"Expected float32 x, y, z, reflectance in {file}, 16 bytes per point, got {n_bytes} bytes. Is the file"
            " empty or truncated? Copy it again."
        )
    return ScanFile(as_float64(values.reshape(-1, 4)[:, :3]))


def _are_triples(values: NDArray[np.float32]) -> bool:
    """Whether floats are points of three numbers rather than four, by what differs more between their columns."""
    blocks = values[: values.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    if not len(blocks):
        return False
    sample = np.nan_to_num(blocks[:: max(1, len(blocks) // N_BLOCKS)])
    of_three, of_four = (_difference(sample.reshape(-1, width)) for width in (3, 4))
    chance = 2.0 / np.sqrt(sample.size / 3.0)  # columns of few points differ by chance
    return bool(of_three > of_four + LEAST_DIFFERENCE + chance)


def _difference(columns: NDArray[np.float32]) -> float:
    """Largest difference between the distributions of two columns, 0 to 1, at 33 levels (Kolmogorov and Smirnov)."""
    levels = np.quantile(columns, np.linspace(0.02, 0.98, 33))
    return float(max(np.ptp((columns <= level).mean(axis=0)) for level in levels))
