# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAS and LAZ, read through laspy once header and chunk table are checked."""

import os
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_file_error, rows_at_a_time
from maxcon.io.clouds.las_header import read_las_crs, read_las_layout
from maxcon.io.clouds.laz import LazChunks, check_layers, copc_chunks_within, read_laz_chunks

if TYPE_CHECKING:
    import laspy

KIND = "a LAS or LAZ file"
# The parallel decompressor holds whole chunks (usually 50,000 points); larger ones are read in one thread.
MAX_PARALLEL_CHUNK = 2_000_000
# The decompressor's threads are of the process that loaded it: after a fork they are gone, and it would wait for them.
PROCESS = os.getpid()


class LasReader(CloudReader):
    """Points, classes and gps_time of a LAS or LAZ file, LAS 1.0 to 1.4, all point formats.

    FileError if it is not LAS or LAZ, says 0 points, or is shorter or longer than its header says.
    """

    def __init__(self, file: Path) -> None:
        import laspy

        super().__init__()
        with as_file_error(file, KIND), file.open("rb") as stream:
            self._layout = read_las_layout(file, stream)
            stream.seek(0)
            header = laspy.LasHeader.read_from(stream, read_evlrs=False)
            self._chunks = self._read_chunks(file, stream, header)
            crs = read_las_crs(file, stream, self._layout)
            self.header = CloudHeader(
                path=file,
                n_points=self._layout.n_points,
                crs=crs.wkt,
                crs_fault=crs.fault,
                has_classes=True,
                has_asprs_classes=True,
                has_times="gps_time" in header.point_format.dimension_names,
            )

    def _read_chunks(self, file: Path, stream: BinaryIO, header: "laspy.LasHeader") -> LazChunks | None:
        layout = self._layout
        if not layout.is_compressed:
            return None
        found = header.vlrs.get("LasZipVlr")
        if not found:
            raise FileError(f"Expected a LASzip record in {file}, got none. Its header is broken; write it anew.")
        return read_laz_chunks(file, stream, layout.start, layout.record_length, layout.n_points, found[0].record_data)

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        for record in self.records(max_points, _needed()):
            yield self._chunk(record)

    def records(
        self, max_points: int = 1_000_000, selection: "laspy.DecompressionSelection | None" = None
    ) -> Generator[Any]:
        """Yield laspy's records of all points in order, at most `max_points` at a time, checked as in `chunks`.

        `selection` are the fields of a LAZ file that are wanted; all if None.
        """
        import laspy

        file, n_left = self.header.path, self.header.n_points
        backend = laspy.LazBackend.LazrsParallel if os.getpid() == PROCESS else laspy.LazBackend.Lazrs
        with as_file_error(file, KIND), file.open("rb") as stream:
            if self._chunks is not None:
                check_layers(file, stream, self._chunks, self._layout.record_length)
                if max(self._chunks.n_points) > MAX_PARALLEL_CHUNK:
                    backend = laspy.LazBackend.Lazrs
            stream.seek(0)
            reader = laspy.LasReader(
                stream,
                closefd=False,
                laz_backend=backend,
                read_evlrs=False,
                decompression_selection=selection or laspy.DecompressionSelection.all(),
            )
            n_most = rows_at_a_time(max_points, self._layout.record_length)
            while n_left > 0:
                n_wanted = min(n_left, n_most)
                record = reader.read_points(n_wanted)
                if len(record) != n_wanted:
                    raise FileError(
                        f"Expected {self.header.n_points} points in {file}, got {n_left - len(record)} fewer:"
                        " truncated. Copy it again."
                    )
                yield record
                n_left -= n_wanted

    def _read_within(self, max_points: int, bounds: Bounds) -> Generator[CloudChunk]:
        """Of a COPC file only the nodes of its octree that meet the rectangle."""
        import laspy
        import lazrs

        file, chunks = self.header.path, self._chunks
        n_most = rows_at_a_time(max_points, self._layout.record_length)
        # Its decompressor works in parallel, and on whole chunks.
        if chunks is None or os.getpid() != PROCESS or max(chunks.n_points) > n_most:
            yield from self._read(max_points)
            return
        with as_file_error(file, "a COPC file"), file.open("rb") as stream:
            is_wanted = copc_chunks_within(file, stream, chunks, bounds)
            if is_wanted is None:
                yield from self._read(max_points)
                return
            check_layers(file, stream, chunks, self._layout.record_length)
            stream.seek(0)
            header = laspy.LasHeader.read_from(stream, read_evlrs=False)
            record_data = header.vlrs.get("LasZipVlr")[0].record_data
            starts = chunks.starts
            for numbers in _runs(np.flatnonzero(is_wanted).tolist(), chunks.n_points, n_most):
                sizes = [(chunks.n_points[k], chunks.n_bytes[k]) for k in numbers]
                compressed = b"".join(_bytes_at(stream, starts[k], chunks.n_bytes[k]) for k in numbers)
                unpacked = np.zeros(sum(n for n, _ in sizes) * self._layout.record_length, dtype=np.uint8)
                lazrs.decompress_points_with_chunk_table(compressed, record_data, unpacked, sizes, _needed().to_lazrs())
                packed = laspy.PackedPointRecord.from_buffer(unpacked, header.point_format)
                record = laspy.ScaleAwarePointRecord(packed.array, packed.point_format, header.scales, header.offsets)
                yield self._chunk(record)

    def _chunk(self, record: Any) -> CloudChunk:
        classes = np.array(record["classification"], dtype=np.uint8)
        times = np.array(record["gps_time"], dtype=np.float64) if self.header.has_times else None
        return CloudChunk(positions_of(record), None, classes, times, np.array(record["withheld"], dtype=bool))


def positions_of(record: Any) -> NDArray[np.float64]:
    """Global coordinates of the points of a record of laspy's, shape (n, 3), m."""
    points = np.empty((len(record), 3))
    with np.errstate(over="ignore"):  # scales of a broken header
        for axis, name in enumerate("XYZ"):
            np.multiply(record.array[name], record.scales[axis], out=points[:, axis])
        points += record.offsets
    return points


def _needed() -> "laspy.DecompressionSelection":
    """The fields of a point that are decompressed."""
    import laspy

    selection = laspy.DecompressionSelection.base() | laspy.DecompressionSelection.Z
    selection |= laspy.DecompressionSelection.CLASSIFICATION | laspy.DecompressionSelection.GPS_TIME
    return selection | laspy.DecompressionSelection.FLAGS


def _runs(numbers: list[int], n_points: list[int], n_most: int) -> Iterator[list[int]]:
    """Yield numbers of chunks, so many at a time that they have at most `n_most` points together."""
    run: list[int] = []
    n_of_run = 0
    for number in numbers:
        if run and n_of_run + n_points[number] > n_most:
            yield run
            run, n_of_run = [], 0
        run.append(number)
        n_of_run += n_points[number]
    if run:
        yield run


def _bytes_at(stream: BinaryIO, start: int, length: int) -> bytes:
    stream.seek(start)
    return stream.read(length)
