# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAZ of the scans of a drive, placed in the map where they were localized."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import TrajectoryError
from maxcon.export.pose_rows import PoseRow
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.crs import metric_crs
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans

SCAN_SUFFIXES = (".laz", ".las")  # of scans placed in the map
RESOLUTION = 0.001  # of the stored coordinates, m
SAME_TIME = 1e-3
MAX_SOURCES = 2**16


def write_placed_scans(
    path: Path, rows: Sequence[PoseRow], scans: Scans, crs: str | None, min_range: float, max_range: float
) -> int:
    """Write the points of all localized epochs in the map's frame, one epoch in memory; return how many they are."""
    epochs = [(row, scan_of_row(row, scans), row.pose) for row in rows if row.pose is not None]
    n_points = 0
    with las_writer(path, epochs[0][2].position, crs) as write:
        for row, epoch, pose in epochs:
            raw = scans.read(epoch, min_range, max_range)
            times = row.time + (np.zeros(len(raw.points)) if raw.point_times is None else raw.point_times)
            write(pose.apply(raw.points), gps_time=times, point_source_id=epoch % MAX_SOURCES)
            n_points += len(raw.points)
    return n_points


@contextmanager
def las_writer(
    path: Path, origin: ArrayLike, crs: str | None, extra: Sequence[tuple[str, Any]] = ()
) -> Iterator[Callable[..., None]]:
    """Yield what writes places (n, 3), m, and their fields, also extra ones, into a LAZ or LAS 1.4, point format 6."""
    import laspy
    import pyproj

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, RESOLUTION), np.floor(origin)
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in extra])
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(metric_crs(crs)))

    def write(places: NDArray[np.float64], **fields: Any) -> None:
        record = laspy.ScaleAwarePointRecord.zeros(len(places), header=header)
        record.x, record.y, record.z = places.T
        for name, values in {"return_number": 1, "number_of_returns": 1, **fields}.items():
            record[name][:] = values
        writer.write_points(record)

    with (
        atomic_file(path) as partial,
        partial.open("wb") as stream,
        laz_as_os_error(),
        laspy.open(stream, "w", header=header, do_compress=path.suffix.lower() == ".laz", closefd=False) as writer,
    ):
        yield write


def scan_of_row(row: PoseRow, scans: Scans) -> int:
    """Return the number of the scan at the time of a row; TrajectoryError if there is none."""
    number = int(nearest_in_time(scans.times, np.array([row.time]))[0])
    if abs(float(scans.times[number]) - row.time) > SAME_TIME:
        raise TrajectoryError(
            f"Expected a scan of the epoch at {row.time:.3f} s, got the nearest at {scans.times[number]:.3f} s. Name"
            " the scans that the table was made of."
        )
    return number
