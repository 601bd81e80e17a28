# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which compressed chunks of a COPC file may have points in a rectangle: what its octree says, held against the file.

A COPC file (Cloud Optimized Point Cloud 1.0) is a LAZ file whose every chunk is a node of an octree. Nothing that the
octree says is followed unless the table of chunks says the same.
"""

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds.base import Bounds
from maxcon.io.clouds.laz import LazChunks

__all__ = ["copc_chunks_within"]

# The first record of a COPC file lies at a fixed place: its head of 54 bytes, and what it says of the octree.
HEADER_BYTES, RECORD_HEAD = 375, 54
OCTREE = struct.Struct("<5d2Q")
ENTRY = np.dtype([("level", "<i4"), ("key", "<i4", 3), ("offset", "<u8"), ("n_bytes", "<i4"), ("n_points", "<i4")])
DEEPEST = 30
PAGE = -1
"""The count of points of an entry that leads to another page of the octree."""


def copc_chunks_within(file: Path, stream: BinaryIO, chunks: LazChunks, bounds: Bounds) -> NDArray[np.bool_] | None:
    """Whether each chunk may have points in a rectangle, shape (n_chunks,); None for a file that is no COPC.

    Parameters
    ----------
    file : Path
        For messages.
    stream : binary file
        The open file, seekable.
    chunks : LazChunks
        Its table of chunks, checked.
    bounds : Bounds
        In the coordinates of the file.

    Raises
    ------
    FileError
        If the octree lies outside of the file, goes round in circles, or does not fit the table of chunks.
    """
    stream.seek(HEADER_BYTES)
    record = stream.read(RECORD_HEAD + OCTREE.size)
    if len(record) < RECORD_HEAD + OCTREE.size or record[2:20] != b"copc".ljust(16, b"\0") + b"\x01\x00":
        return None
    x, y, _, half, _, start, n_bytes = OCTREE.unpack_from(record, RECORD_HEAD)
    entries = _entries(file, stream, start, n_bytes)
    nodes = entries[entries["n_points"] > 0]
    numbers = _chunk_numbers(file, nodes, chunks)
    edges = 2.0 * half / 2.0 ** nodes["level"]
    x_low, y_low = x - half + nodes["key"][:, 0] * edges, y - half + nodes["key"][:, 1] * edges
    # A point on a face may be in the node on either side of it; scales round by far less than this.
    slack = 1e-6 * half
    may_have = (x_low <= bounds.x_max + slack) & (x_low + edges >= bounds.x_min - slack)
    may_have &= (y_low <= bounds.y_max + slack) & (y_low + edges >= bounds.y_min - slack)
    found = np.zeros(len(chunks.n_points), dtype=bool)
    found[numbers[may_have]] = True
    return found


def _entries(file: Path, stream: BinaryIO, start: int, n_bytes: int) -> NDArray[np.void]:
    """All entries of the octree's pages, shape (n,)."""
    size = stream.seek(0, 2)
    pages, seen, found = [(start, n_bytes)], 0, []
    while pages:
        at, length = pages.pop()
        seen += length
        # Pages do not overlap: together they are no longer than the file.
        if length < 0 or length % ENTRY.itemsize or at + length > size or seen > size:
            raise FileError(
                f"Expected the octree of {file} within its {size} bytes, got a page of {length} bytes at byte {at}."
                " Is the file complete? Copy it again, or leave out the area."
            )
        stream.seek(at)
        entries = np.frombuffer(stream.read(length), dtype=ENTRY)
        if ((entries["level"] < 0) | (entries["level"] > DEEPEST)).any():
            raise FileError(
                f"Expected an octree of {DEEPEST} levels at most in {file}, got another. Its header is broken; write"
                " it anew, or leave out the area."
            )
        found.append(entries)
        leading = entries[(entries["n_points"] == PAGE) & (entries["n_bytes"] != 0)]
        pages += [(int(entry["offset"]), int(entry["n_bytes"])) for entry in leading]
    return np.concatenate(found)


def _chunk_numbers(file: Path, nodes: NDArray[np.void], chunks: LazChunks) -> NDArray[np.int64]:
    """Which chunk each node is, shape (n,): by its offset, length and count."""
    lengths = np.array(chunks.n_bytes, dtype=np.int64)
    starts = chunks.starts
    offsets = nodes["offset"].astype(np.int64)
    numbers = np.clip(np.searchsorted(starts, offsets), 0, len(starts) - 1)
    fits = (starts[numbers] == offsets) & (lengths[numbers] == nodes["n_bytes"])
    fits &= np.array(chunks.n_points)[numbers] == nodes["n_points"]
    if not fits.all() or len(np.unique(numbers)) != len(numbers) or nodes["n_points"].sum() != sum(chunks.n_points):
        raise FileError(
            f"Expected each chunk of points of {file} as a node of its octree, got an octree of"
            f" {len(nodes)} nodes with {int(nodes['n_points'].sum())} points for {len(starts)} chunks with"
            f" {sum(chunks.n_points)}. Write it anew with the program it comes from, or leave out the area."
        )
    return numbers
