# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAZ of the scans of a drive, placed in the map where they were localized."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import OptionError, TrajectoryError
from maxcon.export.rows import PoseRow
from maxcon.geometry import Pose
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.crs import metric_crs
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans

__all__ = ["SCAN_SUFFIXES", "write_placed_scans"]

SCAN_SUFFIXES = (".laz", ".las")
"""Of scans placed in the map."""

RESOLUTION = 0.001
"""Of the stored coordinates, m."""
SAME_TIME = 1e-3
MOST_SOURCES = 2**16


def write_placed_scans(
    path: str | os.PathLike[str],
    rows: Sequence[PoseRow],
    scans: Scans,
    crs: str,
    *,
    min_range: float = 1.0,
    max_range: float = 120.0,
) -> int:
    """Write the points of all localized epochs in the map's frame, one epoch in memory at a time.

    LAS 1.4, point format 6: gps_time is the time of the epoch, or of the point where it is known, s as in the table;
    point_source_id is the number of the epoch, counted on from 0 after 65,535.

    Parameters
    ----------
    path : path
        .laz or .las.
    rows : sequence of PoseRow
        Epochs that are not localized are left out.
    scans : Scans
        The same ones: each localized row has a scan of its time.
    crs : str
        Of the poses, projected and in metres.
    min_range, max_range : float
        Points nearer or farther than this are left out, m.

    Returns
    -------
    int
        How many points are written.

    Raises
    ------
    TrajectoryError
        If a localized row has no scan.
    CrsError
        If the CRS is unknown, or not a projected one in metres.
    OptionError
        If the suffix is another.
    FileError
        If a scan cannot be read, or the file not be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SCAN_SUFFIXES:
        raise OptionError(f"Expected a .laz or .las file for scans in the map, got {os.fspath(path)!r}. Rename it.")
    epochs = _epochs(rows, scans)
    n_points = 0
    with atomic_file(path) as partial, partial.open("wb") as stream, _las(stream, rows, crs, suffix) as writer:
        for row, epoch, pose in epochs:
            raw = scans.read(epoch, min_range, max_range)
            times = np.full(len(raw.points), row.time) + (0.0 if raw.point_times is None else raw.point_times)
            writer.write_points(_record(writer.header, pose.apply(raw.points), times, epoch))
            n_points += len(raw.points)
    return n_points


def _epochs(rows: Sequence[PoseRow], scans: Scans) -> list[tuple[PoseRow, int, Pose]]:
    """Localized rows, with the number of the scan of each."""
    found = []
    for row in rows:
        if row.pose is None:
            continue
        epoch = int(nearest_in_time(scans.times, np.array([row.time]))[0])
        if abs(float(scans.times[epoch]) - row.time) > SAME_TIME:
            raise TrajectoryError(
                f"Expected a scan of the epoch at {row.time:.3f} s, got the nearest at {scans.times[epoch]:.3f} s. Name"
                " the scans that the table was made of."
            )
        found.append((row, epoch, row.pose))
    return found


@contextmanager
def _las(stream: Any, rows: Sequence[PoseRow], crs: str, suffix: str) -> Iterator[Any]:
    import laspy
    import pyproj

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, RESOLUTION)
    header.offsets = np.floor(next(row.pose.position for row in rows if row.pose is not None))
    header.add_crs(pyproj.CRS.from_user_input(metric_crs(crs)))
    with (
        laz_as_os_error(),
        laspy.open(stream, mode="w", header=header, do_compress=suffix == ".laz", closefd=False) as writer,
    ):
        yield writer


def _record(header: Any, points: NDArray[np.float64], times: NDArray[np.float64], epoch: int) -> Any:
    import laspy

    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    record.x, record.y, record.z = points.T
    record.gps_time = times
    record.point_source_id = np.full(len(points), epoch % MOST_SOURCES, dtype=np.uint16)
    record.return_number = np.ones(len(points), dtype=np.uint8)
    record.number_of_returns = np.ones(len(points), dtype=np.uint8)
    return record
