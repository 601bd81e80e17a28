# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAZ of the scans of a drive, placed in the map where they were localized."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from maxcon._system.atomic import atomic_file
from maxcon.errors import TrajectoryError
from maxcon.export.pose_rows import PoseRow
from maxcon.geometry import Pose
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.crs import metric_crs
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans

SCAN_SUFFIXES = (".laz", ".las")
"""Of scans placed in the map."""
RESOLUTION = 0.001
"""Of the stored coordinates, m."""
SAME_TIME = 1e-3
MAX_SOURCES = 2**16


def write_placed_scans(
    path: Path, rows: Sequence[PoseRow], scans: Scans, crs: str, min_range: float, max_range: float
) -> int:
    """Write the points of all localized epochs in the map's frame, whose CRS is given; return how many they are.

    LAS 1.4, point format 6: gps_time is the time of the epoch, or of the point where it is known, s as in the table;
    point_source_id is the number of the epoch, counted on from 0 after 65,535. One epoch is in memory at a time.
    """
    import laspy
    import pyproj

    epochs = list(_epochs(rows, scans))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, RESOLUTION)
    header.offsets = np.floor(epochs[0][2].position)
    header.add_crs(pyproj.CRS.from_user_input(metric_crs(crs)))
    n_points = 0
    with (
        atomic_file(path) as partial,
        partial.open("wb") as stream,
        laz_as_os_error(),
        laspy.open(stream, "w", header=header, do_compress=path.suffix.lower() == ".laz", closefd=False) as writer,
    ):
        for row, epoch, pose in epochs:
            raw = scans.read(epoch, min_range, max_range)
            record = laspy.ScaleAwarePointRecord.zeros(len(raw.points), header=header)
            record.x, record.y, record.z = pose.apply(raw.points).T
            record.gps_time = row.time + (np.zeros(len(raw.points)) if raw.point_times is None else raw.point_times)
            record.point_source_id[:] = epoch % MAX_SOURCES
            record.return_number[:] = record.number_of_returns[:] = 1
            writer.write_points(record)
            n_points += len(raw.points)
    return n_points


def _epochs(rows: Sequence[PoseRow], scans: Scans) -> Iterator[tuple[PoseRow, int, Pose]]:
    """Localized rows, with the number of the scan of each."""
    for row in rows:
        if row.pose is None:
            continue
        epoch = int(nearest_in_time(scans.times, np.array([row.time]))[0])
        if abs(float(scans.times[epoch]) - row.time) > SAME_TIME:
            raise TrajectoryError(
                f"Expected a scan of the epoch at {row.time:.3f} s, got the nearest at {scans.times[epoch]:.3f} s. Name"
                " the scans that the table was made of."
            )
        yield row, epoch, row.pose
