"""The chunks of a LAZ file, and which of them a COPC file's octree says may have points in a rectangle.

Both are checked against the bytes before anything is decompressed: the decompressor allocates what the file claims
(measured: 3.7 GB for a file of 0.6 MB). Each chunk of a COPC file (Cloud Optimized Point Cloud 1.0) is a node.
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.io.clouds.base import Bounds, check_unpacked_size

POINTWISE, LAYERED = 2, 3  # codes of the LASzip specification: chunks of formats 0-5, and of 6-10
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of each item: point, RGB, RGB and NIR, wave packet; extra bytes: one per byte
EXTRA_BYTES = 14
MAX_RATIO = 300  # real clouds are compressed 5 to 20 times; a large file that claims more was made to exhaust memory
HEADER_BYTES, RECORD_HEAD = 375, 54  # behind these lies what a COPC file says of its octree
OCTREE = struct.Struct("<5d2Q")
ENTRY = np.dtype([("level", "<i4"), ("key", "<i4", 3), ("offset", "<u8"), ("n_bytes", "<i4"), ("n_points", "<i4")])
DEEPEST = 30
PAGE = -1  # the count of points of an entry that leads to another page of the octree


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


def bytes_at(stream: BinaryIO, start: int, length: int) -> bytes:
    """Return so many bytes of a file from one on."""
    stream.seek(start)
    return stream.read(length)


@contextmanager
def laz_as_os_error() -> Iterator[None]:
    """Turn the compressor's own error for a full disk into OSError."""
    import lazrs

    try:
        yield
    except lazrs.LazrsError as error:
        raise OSError(str(error)) from error


def read_laz_chunks(stream: BinaryIO, start: int, record_length: int, n_points: int, laszip_record: bytes) -> LazChunks:
    """Return the chunk table of an open file; ValueError if it contradicts the LAS header or the bytes there."""
    import lazrs

    n_layers = _count_layers(laszip_record)
    vlr = lazrs.LazVlr(laszip_record)
    if vlr.item_size() != record_length:
        raise ValueError(f"compressed points of {vlr.item_size()} bytes, not {record_length}")
    size = stream.seek(0, 2)
    table = _table_offset(stream, start, size)
    n_chunks = struct.unpack("<II", bytes_at(stream, table, 8))[1]
    if n_chunks * record_length > size:  # each chunk begins with an uncompressed point
        raise ValueError(f"{n_chunks} compressed chunks in {size} bytes")
    stream.seek(start)
    rows = lazrs.read_chunk_table(stream, vlr)
    chunks = LazChunks(start + 8, [row[0] for row in rows], [row[1] for row in rows], n_layers)
    if sum(chunks.n_bytes) > table - chunks.start:
        raise ValueError(f"chunks of {sum(chunks.n_bytes)} bytes where there are {table - chunks.start}")
    if not sum(chunks.n_points[:-1]) < n_points <= sum(chunks.n_points):
        raise ValueError(f"chunks of {sum(chunks.n_points)} points for {n_points}")
    check_unpacked_size(n_points * record_length, size, MAX_RATIO)
    return chunks


def check_layers(stream: BinaryIO, chunks: LazChunks, record_length: int) -> None:
    """Check that the layers of each chunk (point formats 6 to 10) fit into it; ValueError if they do not."""
    if chunks.n_layers == 0:
        return
    sizes = struct.Struct(f"<4x{chunks.n_layers}I")
    rows = zip(chunks.starts.tolist(), chunks.n_points, chunks.n_bytes, strict=True)
    for number, (at, n_points, n_bytes) in enumerate(rows):
        if n_points == 0 or n_bytes == 0:
            continue
        needed = record_length + sizes.size + sum(sizes.unpack(bytes_at(stream, at + record_length, sizes.size)))
        if needed > n_bytes:
            raise ValueError(f"layers of {needed} bytes in chunk {number} of {n_bytes}")


def _count_layers(laszip_record: bytes) -> int:
    """How many layers each chunk has; 0 for the older, pointwise compression."""
    (compressor,) = struct.unpack_from("<H", laszip_record)
    (n_items,) = struct.unpack_from("<H", laszip_record, 32)
    if compressor not in (POINTWISE, LAYERED) or len(laszip_record) < 34 + 6 * n_items:
        raise ValueError(f"a LASzip record of {len(laszip_record)} bytes, compressor {compressor}")
    if compressor == POINTWISE:
        return 0
    items = [struct.unpack_from("<HH", laszip_record, 34 + 6 * i) for i in range(n_items)]
    return sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size in items)


def _table_offset(stream: BinaryIO, start: int, size: int) -> int:
    """Offset of the chunk table; writers that could not seek put it at the very end of the file."""
    for position in (start, size - 8):
        (table,) = struct.unpack("<q", bytes_at(stream, position, 8))
        if start + 8 <= table <= size - 8:
            return int(table)
        if table != -1:
            break
    raise ValueError("no table of the compressed chunks within the file")


def copc_chunks_within(stream: BinaryIO, chunks: LazChunks, bounds: Bounds) -> NDArray[np.bool_] | None:
    """Return whether each chunk may have points in a rectangle, shape (n_chunks,); None for a file that is no COPC."""
    record = bytes_at(stream, HEADER_BYTES, RECORD_HEAD + OCTREE.size)
    if len(record) < RECORD_HEAD + OCTREE.size or record[2:20] != b"copc".ljust(16, b"\0") + b"\x01\x00":
        return None
    x, y, _, half, _, start, n_bytes = OCTREE.unpack_from(record, RECORD_HEAD)
    entries = _octree_entries(stream, start, n_bytes)
    nodes = entries[entries["n_points"] > 0]
    numbers = _chunk_numbers(nodes, chunks)
    edges = 2.0 * half / 2.0 ** nodes["level"]
    x_low, y_low = x - half + nodes["key"][:, 0] * edges, y - half + nodes["key"][:, 1] * edges
    # A point on a face may be in the node on either side of it; scales round by far less than this.
    slack = 1e-6 * half
    may_have = (x_low <= bounds.x_max + slack) & (x_low + edges >= bounds.x_min - slack)
    may_have &= (y_low <= bounds.y_max + slack) & (y_low + edges >= bounds.y_min - slack)
    found = np.zeros(len(chunks.n_points), dtype=bool)
    found[numbers[may_have]] = True
    return found


def _octree_entries(stream: BinaryIO, start: int, n_bytes: int) -> NDArray[np.void]:
    """All entries of the octree's pages, shape (n,)."""
    size = stream.seek(0, 2)
    pages, seen, found = [(start, n_bytes)], 0, []
    while pages:
        at, length = pages.pop()
        seen += length
        # Pages do not overlap: together they are no longer than the file.
        if length < 0 or length % ENTRY.itemsize or at + length > size or seen > size:
            raise ValueError(f"a page of its octree of {length} bytes at byte {at} of {size}")
        entries = np.frombuffer(bytes_at(stream, at, length), dtype=ENTRY)
        if ((entries["level"] < 0) | (entries["level"] > DEEPEST)).any():
            raise ValueError(f"an octree of more than {DEEPEST} levels")
        found.append(entries)
        leading = entries[(entries["n_points"] == PAGE) & (entries["n_bytes"] != 0)]
        pages += [(int(entry["offset"]), int(entry["n_bytes"])) for entry in leading]
    return np.concatenate(found)


def _chunk_numbers(nodes: NDArray[np.void], chunks: LazChunks) -> NDArray[np.int64]:
    """Which chunk each node is, shape (n,): by its offset, length and count."""
    n_points, n_bytes, starts = np.array(chunks.n_points), np.array(chunks.n_bytes), chunks.starts
    offsets = nodes["offset"].astype(np.int64)
    numbers = np.clip(np.searchsorted(starts, offsets), 0, len(starts) - 1)
    fits = (starts[numbers] == offsets) & (n_bytes[numbers] == nodes["n_bytes"])
    fits &= n_points[numbers] == nodes["n_points"]
    if not fits.all() or len(np.unique(numbers)) != len(numbers) or nodes["n_points"].sum() != n_points.sum():
        raise ValueError(f"an octree of {len(nodes)} nodes that are not its {len(starts)} chunks of points")
    return numbers
