# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScanFolder: the scans of a drive, one file per epoch, with their times."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, OptionError
from maxcon.io.scans.points import SCAN_SUFFIXES, read_scan_points
from maxcon.io.scans.times import in_natural_order, times_from_file, times_from_names

__all__ = ["RawScan", "ScanFolder", "check_range", "open_scans"]


@dataclass(frozen=True, slots=True, eq=False)
class RawScan:
    """The points of one epoch as they came from a file, less what is no return or out of range.

    Parameters
    ----------
    points : array, shape (n, 3), float64
        Sensor frame, m. May be empty.
    time : float
        s.
    name : str
        Name of the file.
    n_returns : int
        Points in the file.
    n_dropped_invalid : int
        Points at (0, 0, 0) (no return) or with NaN or infinite coordinates.
    n_dropped_range : int
        Points nearer than the smallest or farther than the largest range.
    """

    points: NDArray[np.float64]
    time: float
    name: str
    n_returns: int
    n_dropped_invalid: int
    n_dropped_range: int


@dataclass(frozen=True, slots=True, eq=False)
class ScanFolder:
    """Scans of one drive in order of time; each is read when asked for.

    Parameters
    ----------
    paths : tuple of Path
        One file per epoch.
    times : array, shape (n,)
        s, strictly increasing.
    """

    paths: tuple[Path, ...]
    times: NDArray[np.float64]

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.paths)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`.

        Parameters
        ----------
        i : int
            Counted from 0.
        min_range, max_range : float
            Points nearer or farther than this are dropped, m. Nearer than 1 m is mostly the vehicle.

        Raises
        ------
        FileError
            If the file is empty, truncated or broken.
        MissingExtraError
            If it is a PCD file and the extra `pcd` is not installed.
        OptionError
            If not 0 <= min_range < max_range.
        """
        check_range(min_range, max_range)
        points = read_scan_points(self.paths[i])
        ranges, is_return = _ranges(points)
        is_kept = is_return & (ranges >= min_range) & (ranges <= max_range)
        kept = points if is_kept.all() else points.compress(is_kept, axis=0)
        n_returns = int(np.count_nonzero(is_return))
        return RawScan(
            points=kept,
            time=float(self.times[i]),
            name=self.paths[i].name,
            n_returns=len(points),
            n_dropped_invalid=len(points) - n_returns,
            n_dropped_range=n_returns - len(kept),
        )

    def scans(self, min_range: float = 1.0, max_range: float = 120.0) -> Iterator[RawScan]:
        """Yield all scans in order of time; parameters and errors as of `read`."""
        for i in range(len(self)):
            yield self.read(i, min_range, max_range)


def _ranges(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Range of each point, m, and whether it is a return: finite, and not at (0, 0, 0)."""
    x, y, z = points.T
    with np.errstate(over="ignore"):
        squared = x * x
        squared += y * y
        squared += z * z
    is_return = (squared > 0.0) & (squared < np.inf)
    # Squares leave the range of float64 before coordinates do: what looks like no return is looked at.
    rows = np.flatnonzero(~is_return)
    is_return[rows] = np.isfinite(points[rows]).all(axis=1) & points[rows].any(axis=1)
    return np.sqrt(squared), is_return


def check_range(min_range: float, max_range: float) -> None:
    """Refuse range limits that leave nothing.

    Raises
    ------
    OptionError
        If not 0 <= min_range < max_range.
    """
    if not 0.0 <= min_range < max_range:
        raise OptionError(
            f"Expected 0 <= min_range < max_range, got {min_range} m and {max_range} m. The defaults are 1 and"
            " 120 m."
        )


def open_scans(path: str | os.PathLike[str], times: str | os.PathLike[str] | None = None) -> ScanFolder:
    """Return the scans in a folder, or the one scan in a file; none is read yet.

    Parameters
    ----------
    path : path
        A folder of scans of one kind: .bin (KITTI: float32 x, y, z, reflectance), .pcd, .ply, .npz, .las or
        .laz; or one such file. Files with other suffixes are left alone.
    times : path or None
        File with one time per line, s. If None: `times.txt` in the folder if there is one, else the names
        are the times: decimals are seconds, integers of 19, 16, 13 digits are ns, us, ms, others seconds.

    Raises
    ------
    FileError
        If there is no scan, scans are of several kinds, or times are missing or do not fit the scans.
    """
    root = Path(path)
    try:
        root.stat()
    except FileNotFoundError as error:
        raise FileError(
            f"Expected a folder of scans at {root}, got no such folder or file. Check the path."
        ) from error
    except OSError as error:
        raise FileError(
            f"Expected a folder of scans at {root}, got: {error.strerror}. Check the path."
        ) from error
    folder = root if root.is_dir() else root.parent
    paths = in_natural_order(_scan_paths(root))
    beside = folder / "times.txt"
    if times is not None:
        return ScanFolder(tuple(paths), times_from_file(Path(times), len(paths)))
    if root.is_dir() and beside.exists():
        return ScanFolder(tuple(paths), times_from_file(beside, len(paths)))
    return ScanFolder(tuple(paths), times_from_names(paths))


def _scan_paths(root: Path) -> list[Path]:
    """List the scans in a folder, or the one scan that `root` is; all of one kind."""
    kinds = ", ".join(SCAN_SUFFIXES)
    try:
        there = sorted(root.iterdir()) if root.is_dir() else [root]
    except OSError as error:
        raise FileError(
            f"Expected to be able to list {root}, got: {error.strerror}. Check its permissions."
        ) from error
    paths = [
        p
        for p in there
        if p.suffix.lower() in SCAN_SUFFIXES and not p.name.startswith(".") and not p.is_dir()
    ]
    if not paths:
        raise FileError(
            f"Expected scans with suffix {kinds} in {root}, got none. Name the folder they are in."
        )
    suffixes = sorted({p.suffix.lower() for p in paths})
    if len(suffixes) > 1:
        raise FileError(
            f"Expected scans of one kind in {root}, got {', '.join(suffixes)}. Put each kind in its own"
            " folder."
        )
    return paths
