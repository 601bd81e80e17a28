# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAS and LAZ, read through laspy; the header is checked against the file before laspy relies on it."""

import math
import os
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_file_error, rows_at_a_time
from maxcon.io.clouds.copc import copc_chunks_within
from maxcon.io.clouds.las_crs import read_las_crs
from maxcon.io.clouds.laz import LazChunks, check_layers, read_laz_chunks

if TYPE_CHECKING:
    import laspy

__all__ = ["LasReader", "positions_of"]

HEADER_BYTES = 227  # of LAS 1.0 to 1.2; 1.4 has 375
# The parallel decompressor holds whole chunks (usually 50,000 points); larger ones are read in one thread.
MAX_PARALLEL_CHUNK = 2_000_000
# Records between header and points; real files have kilobytes.
MAX_RECORDS_BYTES = 2**28
MAX_EVLRS = 10_000
MAX_WKT_BYTES = 2**20
# The decompressor's threads are of the process that loaded it: after a fork they are gone, and it would wait for them.
PROCESS = os.getpid()


class _Layout(NamedTuple):
    """Where the points of a file are, as its header says, checked against its size."""

    n_points: int
    start: int
    record_length: int
    is_compressed: bool
    evlr_start: int
    n_evlrs: int


def _read_layout(file: Path, stream: BinaryIO) -> _Layout:
    size = stream.seek(0, 2)
    stream.seek(0)
    head = stream.read(375).ljust(375, b"\0")
    if size < HEADER_BYTES or head[:4] != b"LASF":
        raise FileError(
            f"Expected {file} to begin with a LAS header of {HEADER_BYTES} bytes, got {size} bytes that"
            " begin with"
            f" {head[: min(size, 4)]!r}. Is it a LAS or LAZ file, and complete?"
        )
    header_bytes, start, n_vlrs, kind, record_length, n_points = struct.unpack_from("<HIIBHI", head, 94)
    minor, evlr_start, n_evlrs = head[25], 0, 0
    if minor >= 4:
        evlr_start, n_evlrs, n_points = struct.unpack_from("<QIQ", head, 235)
    layout = _Layout(n_points, start, record_length, bool(kind & 0xC0), evlr_start, n_evlrs)
    scales = struct.unpack_from("<6d", head, 131)
    if not all(map(math.isfinite, scales)) or 0.0 in scales[:3]:
        raise FileError(
            f"Expected finite scales and offsets in {file}, got {scales}. Its header is broken; write it anew."
        )
    if n_points == 0:
        raise FileError(f"Expected points in {file}, got a header that says 0 points. Leave this file out.")
    if start > size or start > MAX_RECORDS_BYTES or n_vlrs * 54 > start - header_bytes or record_length == 0:
        raise FileError(
            f"Expected the points of {file} within its {size} bytes, got a header with {n_vlrs} records"
            " and points of"
            f" {record_length} bytes from byte {start}. Is the file complete? Copy it again."
        )
    if not layout.is_compressed and start + n_points * record_length > size:
        n_there = (size - start) // record_length
        raise FileError(f"Expected {n_points} points in {file}, got bytes for {n_there}: truncated. Copy it again.")
    _check_end(file, layout, size, struct.unpack_from("<Q", head, 227)[0] if minor >= 3 else 0)
    return layout


def _check_end(file: Path, layout: _Layout, size: int, waveforms: int) -> None:
    """Refuse more bytes than the points and what is said to follow them: a count of points that is too low."""
    if layout.is_compressed:
        return  # the table of chunks tells
    end = min((at for at in (layout.evlr_start if layout.n_evlrs else 0, waveforms) if at), default=size)
    n_there = (min(end, size) - layout.start) // layout.record_length
    if n_there > layout.n_points:
        raise FileError(
            f"Expected {layout.n_points} points in {file}, as its header says, got bytes for {n_there}. Its header is"
            " broken; write it anew."
        )


def _wkt_after_points(file: Path, stream: BinaryIO, layout: _Layout) -> bytes | None:
    """Return the WKT in the extended records at the end of the file, if there is one."""
    size = stream.seek(0, 2)
    at = layout.evlr_start
    if layout.n_evlrs > MAX_EVLRS:
        raise FileError(
            f"Expected at most {MAX_EVLRS} extended records in {file}, got {layout.n_evlrs}. Its header is broken."
        )
    for _ in range(layout.n_evlrs):
        stream.seek(min(at, size))
        head = stream.read(60)
        length = struct.unpack_from("<Q", head, 20)[0] if len(head) == 60 else size
        if at + 60 + length > size:
            raise FileError(
                f"Expected {layout.n_evlrs} extended records in {file}, got the end of the file: truncated."
                " Copy it again."
            )
        user, record = head[2:18].rstrip(b"\0"), struct.unpack_from("<H", head, 18)[0]
        if user == b"LASF_Projection" and record == 2112 and length <= MAX_WKT_BYTES:
            return stream.read(length)
        at += 60 + length
    return None


class LasReader(CloudReader):
    """Points, classes and gps_time of a LAS or LAZ file, LAS 1.0 to 1.4, all point formats.

    Parameters
    ----------
    file : Path
        An existing file.

    Raises
    ------
    FileError
        If it is not LAS or LAZ, says 0 points, or is shorter or longer than its header says.
    """

    def __init__(self, file: Path) -> None:
        import laspy

        super().__init__()
        with as_file_error(file, "a LAS or LAZ file"), file.open("rb") as stream:
            self._layout = _read_layout(file, stream)
            stream.seek(0)
            header = laspy.LasHeader.read_from(stream, read_evlrs=False)
            self._chunks = self._read_chunks(file, stream, header)
            crs = read_las_crs(stream, _wkt_after_points(file, stream, self._layout))
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
        if not self._layout.is_compressed:
            return None
        found = header.vlrs.get("LasZipVlr")
        if not found:
            raise FileError(f"Expected a LASzip record in {file}, got none. Its header is broken; write it anew.")
        layout = self._layout
        return read_laz_chunks(file, stream, layout.start, layout.record_length, layout.n_points, found[0].record_data)

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        for record in self.records(max_points, _needed()):
            yield self._chunk(record)

    def records(
        self, max_points: int = 1_000_000, selection: "laspy.DecompressionSelection | None" = None
    ) -> Generator[Any]:
        """Yield laspy's records of all points in order, at most `max_points` at a time, checked as in `chunks`.

        Parameters
        ----------
        max_points : int
            Most points of one record.
        selection : DecompressionSelection, optional
            The fields of a LAZ file that are wanted; all if None.
        """
        import laspy

        file, n_left = self.header.path, self.header.n_points
        backend = laspy.LazBackend.LazrsParallel if os.getpid() == PROCESS else laspy.LazBackend.Lazrs
        with as_file_error(file, "a LAS or LAZ file"), file.open("rb") as stream:
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


def positions_of(record: Any) -> NDArray[np.float64]:
    """Global coordinates of the points of a record of laspy's, shape (n, 3), m."""
    points = np.empty((len(record), 3))
    with np.errstate(over="ignore"):  # scales of a broken header
        for axis, name in enumerate("XYZ"):
            np.multiply(record.array[name], record.scales[axis], out=points[:, axis])
        points += record.offsets
    return points
