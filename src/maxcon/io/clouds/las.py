# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LAS and LAZ, read through laspy once header, CRS and chunk table are checked against the file.

laspy waits for ever on some headers, and skips records that it cannot parse: a file with a damaged CRS would seem to
name none.
"""

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
from maxcon.io.clouds.laz import LazChunks, check_layers, copc_chunks_within, read_laz_chunks

if TYPE_CHECKING:
    import laspy


HEADER_BYTES = 227  # of LAS 1.0 to 1.2; 1.4 has 375
# Records between header and points; real files have kilobytes.
MAX_RECORDS_BYTES = 2**28
MAX_EVLRS = 10_000
MAX_WKT_BYTES = 2**20
WKT, GEO_KEYS = 2112, 34735
PROJECTED_KEY, GEODETIC_KEY = 3072, 2048
USER_DEFINED = 32767
EPSG_CODES = range(1024, USER_DEFINED)


class LasLayout(NamedTuple):
    """Where the points and the extended records of a file are, as its header says, checked against its size."""

    n_points: int
    start: int
    record_length: int
    is_compressed: bool
    evlr_start: int
    n_evlrs: int


def read_las_layout(file: Path, stream: BinaryIO) -> LasLayout:
    """Return the layout of an open file."""
    size = stream.seek(0, 2)
    stream.seek(0)
    head = stream.read(375).ljust(375, b"\0")
    if size < HEADER_BYTES or head[:4] != b"LASF":
        raise FileError(
            f"Expected {file} to begin with a LAS header of {HEADER_BYTES} bytes, got {size} bytes that begin with"
            f" {head[: min(size, 4)]!r}. Is it a LAS or LAZ file, and complete?"
        )
    header_bytes, start, n_vlrs, kind, record_length, n_points = struct.unpack_from("<HIIBHI", head, 94)
    minor, waveforms, evlr_start, n_evlrs = head[25], 0, 0, 0
    if minor >= 3:
        (waveforms,) = struct.unpack_from("<Q", head, 227)
    if minor >= 4:
        evlr_start, n_evlrs, n_points = struct.unpack_from("<QIQ", head, 235)
    scales = struct.unpack_from("<6d", head, 131)
    if not all(map(math.isfinite, scales)) or 0.0 in scales[:3]:
        raise FileError(
            f"Expected finite scales and offsets in {file}, got {scales}. Its header is broken; write it anew."
        )
    if n_points == 0:
        raise FileError(f"Expected points in {file}, got a header that says 0 points. Leave this file out.")
    if start > size or start > MAX_RECORDS_BYTES or n_vlrs * 54 > start - header_bytes or record_length == 0:
        raise FileError(
            f"Expected the points of {file} within its {size} bytes, got a header with {n_vlrs} records and points of"
            f" {record_length} bytes from byte {start}. Is the file complete? Copy it again."
        )
    layout = LasLayout(n_points, start, record_length, bool(kind & 0xC0), evlr_start, n_evlrs)
    if not layout.is_compressed:  # else the table of chunks tells
        _check_count(file, layout, size, waveforms)
    return layout


def _check_count(file: Path, layout: LasLayout, size: int, waveforms: int) -> None:
    """Refuse bytes for fewer points than the header says, or up to what is said to follow them, for more."""
    n_there = (size - layout.start) // layout.record_length
    if n_there < layout.n_points:
        raise FileError(
            f"Expected {layout.n_points} points in {file}, got bytes for {n_there}: truncated. Copy it again."
        )
    end = min((at for at in (layout.evlr_start if layout.n_evlrs else 0, waveforms) if at), default=size)
    n_there = (min(end, size) - layout.start) // layout.record_length
    if n_there > layout.n_points:
        raise FileError(
            f"Expected {layout.n_points} points in {file}, as its header says, got bytes for {n_there}. Its header is"
            " broken; write it anew."
        )


class LasCrs(NamedTuple):
    """The CRS as WKT, None if the file names none that can be used; in `fault`, what it has instead of one."""

    wkt: str | None
    fault: str = ""


def read_las_crs(file: Path, stream: BinaryIO, layout: LasLayout) -> LasCrs:
    """Return the CRS of an open file; FileError if its extended records are not there."""
    records = list(_records(stream))
    wkts = _wkts(records, b"LASF_Projection") + _wkts_after_points(file, stream, layout)
    if wkts:
        return _of_wkt(wkts[0])
    keys = [content for user, number, content in records if (user, number) == (b"LASF_Projection", GEO_KEYS)]
    found = _of_keys(keys[0]) if keys else LasCrs(None)
    # libLAS wrote WKT into a record of its own, beside keys of its own making.
    others = _wkts(records, b"liblas")
    return _of_wkt(others[0]) if found.wkt is None and others else found


def _wkts(records: list[tuple[bytes, int, bytes]], user: bytes) -> list[bytes]:
    """WKT of a user's records, if it is not blank."""
    return [record[2] for record in records if record[:2] == (user, WKT) and record[2].strip(b"\0 ")]


def _records(stream: BinaryIO) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield user, number and content of the records between header and points."""
    stream.seek(94)
    at, start, n_records = struct.unpack("<HII", stream.read(10))
    for _ in range(n_records):
        stream.seek(at)
        head = stream.read(54)
        if len(head) < 54 or at + 54 > start:
            return
        number, length = struct.unpack_from("<HH", head, 18)
        yield head[2:18].partition(b"\0")[0], number, stream.read(length)
        at += 54 + length


def _wkts_after_points(file: Path, stream: BinaryIO, layout: LasLayout) -> list[bytes]:
    """Return the WKT in the extended records at the end of the file, if there is one."""
    size, at = stream.seek(0, 2), layout.evlr_start
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
        user, number = head[2:18].rstrip(b"\0"), struct.unpack_from("<H", head, 18)[0]
        if (user, number) == (b"LASF_Projection", WKT) and length <= MAX_WKT_BYTES:
            content = stream.read(length)
            return [content] if content.strip(b"\0 ") else []
        at += 60 + length
    return []


def _of_wkt(content: bytes) -> LasCrs:
    import pyproj

    try:
        return LasCrs(pyproj.CRS.from_wkt(content.rstrip(b"\0").decode("utf-8")).to_wkt())
    except (UnicodeDecodeError, pyproj.exceptions.CRSError) as error:
        return LasCrs(None, f"a WKT that it does not: {_first_words(error)}")


def _of_keys(content: bytes) -> LasCrs:
    """The CRS of GeoTIFF keys."""
    import pyproj

    if len(content) < 8 or content[:2] != b"\1\0":
        return LasCrs(None, "a damaged directory of GeoTIFF keys")
    n_keys = struct.unpack_from("<H", content, 6)[0]
    if 8 + 8 * n_keys > len(content):
        return LasCrs(None, f"{n_keys} GeoTIFF keys in {len(content)} bytes")
    rows = [struct.unpack_from("<4H", content, 8 + 8 * number) for number in range(n_keys)]
    codes = {key: code for key, place, _, code in rows if place == 0}
    code = codes.get(PROJECTED_KEY, 0) or codes.get(GEODETIC_KEY, 0)
    if not code:
        return LasCrs(None, "GeoTIFF keys without a code" if rows else "")
    if code == USER_DEFINED:
        return LasCrs(None, "GeoTIFF keys of a CRS of its own, without WKT")
    if code not in EPSG_CODES:
        return LasCrs(None, f"the code {code}")
    try:
        return LasCrs(pyproj.CRS.from_epsg(code).to_wkt())
    except pyproj.exceptions.CRSError as error:
        return LasCrs(None, f"EPSG:{code}: {_first_words(error)}")


def _first_words(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


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
