"""LAS and LAZ, read through laspy once header, CRS and chunk table are checked against the file.

laspy waits for ever on some headers, and skips damaged records: a file would seem to name no CRS.
"""

import math
import os
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_file_error, rows_at_a_time
from maxcon.io.clouds.laz import LazChunks, bytes_at, check_layers, copc_chunks_within, read_laz_chunks
from maxcon.io.crs import FileCrs, read_file_crs

if TYPE_CHECKING:
    import laspy

KIND = "a LAS or LAZ file"
HEADER_BYTES = 227  # of LAS 1.0 to 1.2; 1.4 has 375
MAX_RECORDS_BYTES = 2**28  # of records between header and points; real files have kilobytes
MAX_EVLRS = 10_000
MAX_WKT_BYTES = 2**20
RECORD_HEAD, EXTENDED_HEAD = struct.Struct("<2x16sHH32x"), struct.Struct("<2x16sHQ32x")  # user, number, length
CRS_USER, WKT, GEO_KEYS = b"LASF_Projection", 2112, 34735
PROJECTED_KEY, GEODETIC_KEY = 3072, 2048
MAX_PARALLEL_CHUNK = 2_000_000  # points; the parallel decompressor holds whole chunks (usually of 50,000)
PROCESS = os.getpid()  # that has the decompressor's threads: after a fork they are gone, and it would wait for them


class LasReader(CloudReader):
    """Points, classes and gps_time of a LAS or LAZ file, LAS 1.0 to 1.4, all point formats."""

    def __init__(self, file: Path) -> None:
        import laspy

        super().__init__()
        with as_file_error(file, KIND), file.open("rb") as stream:
            self._layout = layout = _read_layout(stream)
            stream.seek(0)
            header = laspy.LasHeader.read_from(stream, read_evlrs=False)
            self._chunks: LazChunks | None = None
            if layout.is_compressed:
                self._chunks = read_laz_chunks(
                    stream, layout.start, layout.record_length, layout.n_points, _laszip_record(header)
                )
            crs = _read_crs(stream, layout)
        has: dict[str, Any] = {"has_classes": True, "has_asprs_classes": True, **crs._asdict()}
        has_times = "gps_time" in header.point_format.dimension_names
        self.header = CloudHeader(file, layout.n_points, has_times=has_times, **has)

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        chunks = self._chunks
        n_most = rows_at_a_time(max_points, self._layout.record_length)
        # The decompressor of parts works in parallel, and on whole chunks.
        if bounds is not None and chunks is not None and os.getpid() == PROCESS and max(chunks.n_points) <= n_most:
            file, what = self.header.path, "a COPC file, to read a part of it"
            with as_file_error(file, what), file.open("rb") as stream:
                is_wanted = copc_chunks_within(stream, chunks, bounds)
                if is_wanted is not None:
                    numbers = np.flatnonzero(is_wanted).tolist()
                    yield from map(self._chunk, self._records_of_chunks(stream, chunks, numbers, n_most))
                    return
        yield from map(self._chunk, self.records(max_points, _needed()))

    def records(self, max_points: int = 1_000_000, selection: Any = None) -> Generator[Any]:
        """Yield laspy's records of all points in order; of a LAZ file only the fields of a `selection`, if any."""
        import laspy

        file, n_left = self.header.path, self.header.n_points
        backend = laspy.LazBackend.LazrsParallel if os.getpid() == PROCESS else laspy.LazBackend.Lazrs
        with as_file_error(file, KIND), file.open("rb") as stream:
            if self._chunks is not None:
                check_layers(stream, self._chunks, self._layout.record_length)
                if max(self._chunks.n_points) > MAX_PARALLEL_CHUNK:
                    backend = laspy.LazBackend.Lazrs
            stream.seek(0)
            wanted = selection or laspy.DecompressionSelection.all()
            reader = laspy.LasReader(
                stream, closefd=False, laz_backend=backend, read_evlrs=False, decompression_selection=wanted
            )
            n_most = rows_at_a_time(max_points, self._layout.record_length)
            while n_left > 0:
                record = reader.read_points(min(n_left, n_most))
                if len(record) != min(n_left, n_most):
                    raise ValueError(f"{n_left - len(record)} points fewer: truncated")
                yield record
                n_left -= len(record)

    def _records_of_chunks(self, stream: BinaryIO, chunks: LazChunks, numbers: list[int], n_most: int) -> Iterator[Any]:
        """Yield laspy's records of some compressed chunks, as many at a time as have `n_most` points together."""
        import laspy
        import lazrs

        check_layers(stream, chunks, self._layout.record_length)
        stream.seek(0)
        header = laspy.LasHeader.read_from(stream, read_evlrs=False)
        while numbers:
            n_run = max(1, int(np.searchsorted(np.cumsum([chunks.n_points[k] for k in numbers]), n_most, "right")))
            run, numbers = numbers[:n_run], numbers[n_run:]
            sizes = [(chunks.n_points[k], chunks.n_bytes[k]) for k in run]
            compressed = b"".join(bytes_at(stream, chunks.starts[k], chunks.n_bytes[k]) for k in run)
            unpacked = np.zeros(sum(n for n, _ in sizes) * self._layout.record_length, dtype=np.uint8)
            selection = _needed().to_lazrs()
            lazrs.decompress_points_with_chunk_table(compressed, _laszip_record(header), unpacked, sizes, selection)
            packed = laspy.PackedPointRecord.from_buffer(unpacked, header.point_format)
            yield laspy.ScaleAwarePointRecord(packed.array, packed.point_format, header.scales, header.offsets)

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


def _laszip_record(header: "laspy.LasHeader") -> bytes:
    found = header.vlrs.get("LasZipVlr")
    if not found:
        raise ValueError("no LASzip record")
    return bytes(found[0].record_data)


class _Layout(NamedTuple):
    """Where the points and the extended records of a file are, as its header says, checked against its size."""

    n_points: int
    start: int
    record_length: int
    is_compressed: bool
    evlr_start: int
    n_evlrs: int


def _read_layout(stream: BinaryIO) -> _Layout:
    """The layout of an open file; whether the points of a compressed one are there its table of chunks tells."""
    size = stream.seek(0, 2)
    head = bytes_at(stream, 0, 375).ljust(375, b"\0")
    if size < HEADER_BYTES or head[:4] != b"LASF":
        raise ValueError(f"{size} bytes that begin with {head[: min(size, 4)]!r}, no LAS header")
    header_bytes, start, n_vlrs, kind, length, n_points = struct.unpack_from("<HIIBHI", head, 94)
    minor, waveforms, evlr_start, n_evlrs = head[25], 0, 0, 0
    if minor >= 3:
        (waveforms,) = struct.unpack_from("<Q", head, 227)
    if minor >= 4:
        evlr_start, n_evlrs, n_points = struct.unpack_from("<QIQ", head, 235)
    scales = struct.unpack_from("<6d", head, 131)
    if not all(map(math.isfinite, scales)) or 0.0 in scales[:3]:
        raise ValueError(f"scales and offsets of {scales}")
    if n_points == 0 or n_evlrs > MAX_EVLRS:
        raise ValueError(f"a header that says {n_points} points and {n_evlrs} extended records")
    if start > min(size, MAX_RECORDS_BYTES) or n_vlrs * 54 > start - header_bytes or length == 0:
        raise ValueError(f"{n_vlrs} records, and points of {length} bytes from byte {start}, in {size} bytes")
    is_compressed = bool(kind & 0xC0)
    if not is_compressed:
        end = min((at for at in (evlr_start if n_evlrs else 0, waveforms) if at), default=size)
        n_most, n_least = (size - start) // length, (min(end, size) - start) // length
        if not n_least <= n_points <= n_most:
            raise ValueError(f"{n_points} points in its header, and bytes for {n_least} to {n_most}: truncated")
    return _Layout(n_points, start, length, is_compressed, evlr_start, n_evlrs)


def _read_crs(stream: BinaryIO, layout: _Layout) -> FileCrs:
    """The CRS of an open file; ValueError if its extended records are not there."""
    at, _, n_records = struct.unpack("<HII", bytes_at(stream, 94, 10))
    extended = list(_records(stream, layout.evlr_start, layout.n_evlrs, EXTENDED_HEAD))
    if len(extended) < layout.n_evlrs:
        raise ValueError(f"the end of the file before the last of {layout.n_evlrs} extended records: truncated")
    found: dict[tuple[bytes, int], bytes] = {}
    for user, number, content in [*_records(stream, at, n_records, RECORD_HEAD), *extended]:
        if content.strip(b"\0 "):
            found.setdefault((user, number), content)
    if wkt := found.get((CRS_USER, WKT)):
        return read_file_crs(wkt)
    keys = found.get((CRS_USER, GEO_KEYS))
    of_keys = _of_keys(keys) if keys else FileCrs()
    # libLAS wrote WKT into a record of its own, beside keys of its own making.
    other = found.get((b"liblas", WKT))
    return read_file_crs(other) if of_keys.crs is None and other else of_keys


def _records(stream: BinaryIO, at: int, n_records: int, head: struct.Struct) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield user, number and content of records as far as they are there; contents too large for WKT are left out."""
    size = stream.seek(0, 2)
    for _ in range(n_records):
        if at + head.size > size:
            return
        user, number, length = head.unpack(bytes_at(stream, at, head.size))
        at += head.size + length
        if at > size and head is EXTENDED_HEAD:  # of others what is there is looked at: it may be a damaged CRS
            return
        yield user.partition(b"\0")[0], number, stream.read(length) if length <= MAX_WKT_BYTES else b""


def _of_keys(content: bytes) -> FileCrs:
    """The CRS of GeoTIFF keys."""
    n_keys = struct.unpack_from("<H", content, 6)[0] if len(content) >= 8 else 0
    if content[:2] != b"\1\0" or not 8 <= 8 + 8 * n_keys <= len(content):
        return FileCrs(None, f"a damaged directory of {n_keys} GeoTIFF keys")
    rows = [struct.unpack_from("<4H", content, 8 + 8 * number) for number in range(n_keys)]
    codes = {key: code for key, place, _, code in rows if place == 0}
    code = codes.get(PROJECTED_KEY, 0) or codes.get(GEODETIC_KEY, 0)
    if not code:
        return FileCrs(None, "GeoTIFF keys without a code" if rows else "")
    return read_file_crs(code)
