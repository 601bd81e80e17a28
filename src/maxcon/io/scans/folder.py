# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScanFolder: the scans of a drive, one file per epoch, with their times."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.file_names import SCAN_SUFFIXES, in_natural_order
from maxcon.io.point_times import PointTimes, find_point_times
from maxcon.io.raw_scan import RawScan, Scans, check_range, returns_in_range
from maxcon.io.scans.reading import read_scan_file
from maxcon.io.scans.scan_file import ScanFile
from maxcon.io.scans.times import times_from_file, times_from_names

__all__ = ["ScanFolder", "open_scan_folder"]


@dataclass(frozen=True, slots=True, eq=False)
class ScanFolder(Scans):
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

    def name(self, i: int) -> str:
        """Return the name of the file of scan number `i`."""
        return self.paths[i].name

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`; parameters as of any scans.

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
        content = read_scan_file(self.paths[i])
        points = content.points
        is_kept, n_returns = returns_in_range(points, min_range, max_range)
        kept = points if is_kept.all() else points.compress(is_kept, axis=0)
        times = self._times_of(content, i, is_kept)
        return RawScan(
            points=kept,
            time=float(self.times[i]),
            name=self.paths[i].name,
            n_returns=len(points),
            n_dropped_invalid=len(points) - n_returns,
            n_dropped_range=n_returns - len(kept),
            point_times=None if times is None else times.offsets,
        )

    def _times_of(self, content: ScanFile, i: int, is_wanted: NDArray[np.bool_]) -> PointTimes | None:
        """When the points of a scan were measured, from its time on; None where its file has no such field."""
        if not content.times:
            return None
        columns = {name: (kind, values[is_wanted]) for name, (kind, values) in content.times.items()}
        return find_point_times(columns, round(float(self.times[i]) * 1e9))

    def words(self, i: int) -> tuple[str, str]:
        """Return the fields of scan number `i`, and how the times of its points are understood; errors as of `read`."""
        content = read_scan_file(self.paths[i])
        is_return = returns_in_range(content.points, 0.0, np.inf)[0]
        times = self._times_of(content, i, is_return)
        return content.fields, "" if times is None else times.words


def open_scan_folder(path: str | os.PathLike[str], times: str | os.PathLike[str] | None = None) -> ScanFolder:
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
        raise FileError(f"Expected a folder of scans at {root}, got no such folder or file. Check the path.") from error
    except OSError as error:
        raise FileError(f"Expected a folder of scans at {root}, got: {error.strerror}. Check the path.") from error
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
        raise FileError(f"Expected to be able to list {root}, got: {error.strerror}. Check its permissions.") from error
    paths = [p for p in there if p.suffix.lower() in SCAN_SUFFIXES and not p.name.startswith(".") and not p.is_dir()]
    if not paths:
        raise FileError(f"Expected scans with suffix {kinds} in {root}, got none. Name the folder they are in.")
    suffixes = sorted({p.suffix.lower() for p in paths})
    if len(suffixes) > 1:
        raise FileError(
            f"Expected scans of one kind in {root}, got {', '.join(suffixes)}. Put each kind in its own folder."
        )
    return paths
