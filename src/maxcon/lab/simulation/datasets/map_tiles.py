# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MapTiles: the map cloud of a simulated drive, streamed to square LAZ files."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import LocalFrame
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.lab.simulation.sensing.scanners import Echoes

__all__ = ["MapTiles"]

TILE_EDGE = 50.0
RESOLUTION = 0.001
"""Of the stored coordinates, m."""


class MapTiles:
    """Open LAZ files (LAS 1.4, point format 6), one per square of 50 m, named by its lower left corner.

    folder: where the files go; must exist.
    frame: from city metres to global coordinates; its CRS must be known and is written into every file.
    """

    def __init__(self, folder: Path, frame: LocalFrame) -> None:
        import laspy
        import pyproj

        self._laspy = laspy
        self._crs = pyproj.CRS.from_user_input(frame.crs)
        self._folder = folder
        self._frame = frame
        self._writers: dict[tuple[int, int], Any] = {}
        self._open_files = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with laz_as_os_error():
            self._open_files.close()

    def write(self, echoes: Echoes) -> None:
        """Append `echoes` to the files they fall in."""
        points = self._frame.to_global(echoes.points)
        tiles = np.floor(points[:, :2] / TILE_EDGE).astype(np.int64)
        order = np.lexsort((tiles[:, 1], tiles[:, 0]))
        starts = np.flatnonzero(np.any(np.diff(tiles[order], axis=0, prepend=-1), axis=1))
        for rows in np.split(order, starts[1:]) if len(order) else []:
            rows.sort()
            self._append((int(tiles[rows[0], 0]), int(tiles[rows[0], 1])), points, echoes, rows)

    def _append(
        self, tile: tuple[int, int], points: NDArray[np.float64], echoes: Echoes, rows: NDArray[np.int64]
    ) -> None:
        writer = self._writers.get(tile)
        if writer is None:
            writer = self._writers[tile] = self._open(tile)
        record = self._laspy.ScaleAwarePointRecord.zeros(len(rows), header=writer.header)
        record.x, record.y, record.z = points[rows].T
        record.intensity = (echoes.intensities[rows] * 65535.0).astype(np.uint16)
        record.classification = echoes.classes[rows]
        record.gps_time = echoes.times[rows]
        record.return_number[:] = 1
        record.number_of_returns[:] = 1
        with laz_as_os_error():
            writer.write_points(record)

    def _open(self, tile: tuple[int, int]) -> Any:
        east, north = (round(index * TILE_EDGE) for index in tile)
        header = self._laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, RESOLUTION)
        header.offsets = np.array([east, north, 0.0])
        header.add_crs(self._crs)
        path = self._folder / f"tile_{east}_{north}.laz"
        # Opened here: laspy leaves a file of its own open when the disk is full, and Python warns of that much later.
        stream = self._open_files.enter_context(path.open("w+b"))
        writer = self._laspy.open(stream, mode="w", header=header, do_compress=True, closefd=False)
        return self._open_files.enter_context(writer)
