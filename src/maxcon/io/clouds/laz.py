# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The chunk table of a LAZ file, checked against its bytes before anything is decompressed.

The decompressor allocates what the file claims (measured: 3.7 GB for a file of 0.6 MB).
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError

__all__ = ["LazChunks", "check_layers", "laz_as_os_error", "read_laz_chunks"]

# Codes of the LASzip specification: pointwise chunked (formats 0-5) and layered chunked (6-10).
POINTWISE, LAYERED = 2, 3
# Layers of each kind of item: point, RGB, RGB and NIR, wave packet; extra bytes have one per byte.
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
EXTRA_BYTES = 14
# Real clouds are compressed 5 to 20 times; a large file that claims more than this was made to exhaust memory.
MAX_RATIO = 300
SMALL_BYTES = 2**24


class LazChunks(NamedTuple):
    """Where the compressed chunks lie, and how large they are."""

    start: int
    n_points: list[int]
    n_bytes: list[int]
    n_layers: int

    @property
    def starts(self) -> NDArray[np.int64]:
        """Where each chunk begins in the file, shape (n_chunks,)."""
        return self.start + np.cumsum([0, *self.n_bytes[:-1]], dtype=np.int64)


@contextmanager
def laz_as_os_error() -> Iterator[None]:
    """Turn the compressor's own error for a full disk into OSError."""
    import lazrs

    try:
        yield
    except lazrs.LazrsError as error:
        raise OSError(str(error)) from error


def broken_laz(file: Path, expected: str, got: str) -> FileError:
    """Return the error of a LAZ file whose claims do not fit its bytes."""
    return FileError(f"Expected {expected} in {file}, got {got}. Is the file complete? Copy it again.")


def read_laz_chunks(
    file: Path, stream: BinaryIO, start: int, record_length: int, n_points: int, laszip_record: bytes
) -> LazChunks:
    """Return the chunk table, checked.

    Parameters
    ----------
    file : Path
        For messages.
    stream : binary file
        The open file, seekable.
    start : int
        Offset of the point data, bytes.
    record_length : int
        Bytes of one uncompressed point, as the LAS header says.
    n_points : int
        As the LAS header says.
    laszip_record : bytes
        The LASzip record of the header.

    Raises
    ------
    FileError
        If the compression is of an unknown kind, or the table does not fit the file or the header.
    """
    import lazrs

    n_layers = _count_layers(file, laszip_record)
    vlr = lazrs.LazVlr(laszip_record)
    if vlr.item_size() != record_length:
        raise broken_laz(file, f"compressed points of {record_length} bytes", f"{vlr.item_size()} bytes")
    size = stream.seek(0, 2)
    table = _table_offset(file, stream, start, size)
    stream.seek(table)
    n_chunks = struct.unpack("<II", stream.read(8))[1]
    if n_chunks * record_length > size:  # each chunk begins with an uncompressed point
        raise broken_laz(file, f"at most {size // record_length} chunks", f"{n_chunks}")
    stream.seek(start)
    rows = lazrs.read_chunk_table(stream, vlr)
    chunks = LazChunks(start + 8, [row[0] for row in rows], [row[1] for row in rows], n_layers)
    if sum(chunks.n_bytes) > table - chunks.start:
        raise broken_laz(
            file, f"{table - chunks.start} bytes of compressed points", f"{sum(chunks.n_bytes)} in its table"
        )
    if not sum(chunks.n_points[:-1]) < n_points <= sum(chunks.n_points):
        raise broken_laz(file, f"{n_points} points", f"chunks of {sum(chunks.n_points)}")
    if n_points * record_length > max(SMALL_BYTES, MAX_RATIO * size):
        raise FileError(
            f"Expected the points of {file} to unpack to at most {MAX_RATIO} times its size, got"
            f" {n_points * record_length / size:.0f} times. Is it real data? Write it as LAS."
        )
    return chunks


def check_layers(file: Path, stream: BinaryIO, chunks: LazChunks, record_length: int) -> None:
    """Check that the layers of each chunk (point formats 6 to 10) fit into it.

    Raises
    ------
    FileError
        If a chunk claims longer layers than it has bytes.
    """
    if chunks.n_layers == 0:
        return
    at = chunks.start
    n_head = 4 + 4 * chunks.n_layers
    for number, (n_points, n_bytes) in enumerate(zip(chunks.n_points, chunks.n_bytes, strict=True)):
        stream.seek(at + record_length)
        head = stream.read(n_head)
        at += n_bytes
        if n_points == 0 or n_bytes == 0:
            continue
        if len(head) < n_head:
            raise broken_laz(file, f"chunk {number} of the points", "the end of the file")
        needed = record_length + n_head + sum(struct.unpack(f"<{chunks.n_layers}I", head[4:]))
        if needed > n_bytes:
            raise broken_laz(file, f"chunk {number} to have {n_bytes} bytes", f"layers of {needed}")


def _count_layers(file: Path, laszip_record: bytes) -> int:
    """How many layers each chunk has; 0 for the older, pointwise compression."""
    if len(laszip_record) < 34:
        raise broken_laz(file, "a LASzip record of 34 bytes or more", f"{len(laszip_record)}")
    compressor = struct.unpack_from("<H", laszip_record)[0]
    n_items = struct.unpack_from("<H", laszip_record, 32)[0]
    if compressor not in (POINTWISE, LAYERED):
        raise FileError(
            f"Expected {file} to be compressed in chunks (LASzip 2 or later), got compressor {compressor}."
            " Write it anew with a current LASzip, or as LAS."
        )
    if len(laszip_record) < 34 + 6 * n_items:
        raise broken_laz(file, f"a LASzip record of {n_items} items", f"{len(laszip_record)} bytes")
    if compressor == POINTWISE:
        return 0
    items = [struct.unpack_from("<HH", laszip_record, 34 + 6 * i) for i in range(n_items)]
    return sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size in items)


def _table_offset(file: Path, stream: BinaryIO, start: int, size: int) -> int:
    """Offset of the chunk table; writers that could not seek put it at the very end of the file."""
    for position in (start, size - 8):
        stream.seek(position)
        head = stream.read(8)
        if len(head) < 8:
            break
        (table,) = struct.unpack("<q", head)
        if start + 8 <= table <= size - 8:
            return int(table)
        if table != -1:
            break
    raise broken_laz(file, "a table of the compressed chunks", "none within the file")
