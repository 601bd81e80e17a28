# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Checks how large a record claims to be unpacked against its bytes, before anything is unpacked.

Each buffer of a compressed Arrow record batch begins with the length that it will have, and Arrow makes room for it
at once. The positions of the buffers are in the metadata, a table of FlatBuffers, of which nothing else is read.
"""

import struct
from typing import Any

__all__ = ["check_claims"]

MOST_SHRUNK = 255
"""Largest ratio of compression: that of LZ4 is below."""
SMALL = 4096
"""Claims up to so many bytes are not checked: they take little memory."""
HEADER_OF_MESSAGE, BUFFERS_OF_BATCH = 2, 2
"""Field numbers in the FlatBuffers tables of the Arrow IPC format."""


def check_claims(content: bytes | memoryview) -> None:
    """Refuse a message of a record batch whose buffers claim more bytes than they can hold.

    Parameters
    ----------
    content : bytes-like
        The message, with its body.

    Raises
    ------
    ValueError
        If one does, or lies outside of the body, or there is no table of them.
    OSError, pyarrow.ArrowException
        If it is no message.
    """
    import pyarrow as pa

    message: Any = pa.ipc.read_message(pa.py_buffer(content))
    table, body = memoryview(message.metadata).cast("B"), memoryview(message.body or b"").cast("B")
    try:
        places = _buffer_places(table)
    except struct.error:
        raise ValueError("a broken table of buffers") from None
    for offset, length in places:
        if offset < 0 or length < 0 or offset + length > len(body):
            raise ValueError(f"a buffer of {length} bytes at {offset} of {len(body)}")
        claimed = struct.unpack_from("<q", body, offset)[0] if length >= 8 else 0
        if claimed > max(SMALL, MOST_SHRUNK * length):
            raise ValueError(f"a buffer of {length} bytes that is to unpack to {claimed}")


def _buffer_places(table: memoryview) -> list[tuple[int, int]]:
    """Offset and length of each buffer in the body of a record batch."""
    message = struct.unpack_from("<I", table, 0)[0]
    batch = _follow(table, _field(table, message, HEADER_OF_MESSAGE))
    buffers = _follow(table, _field(table, batch, BUFFERS_OF_BATCH))
    n_buffers = struct.unpack_from("<I", table, buffers)[0]
    if n_buffers * 16 > len(table):
        raise ValueError("a broken table of buffers")
    return [struct.unpack_from("<qq", table, buffers + 4 + 16 * number) for number in range(n_buffers)]


def _field(table: memoryview, start: int, number: int) -> int:
    """Where a field of a table lies."""
    offsets = start - struct.unpack_from("<i", table, start)[0]
    if offsets < 0 or 6 + 2 * number > struct.unpack_from("<H", table, offsets)[0]:
        raise ValueError("a broken table of buffers")
    return start + int(struct.unpack_from("<H", table, offsets + 4 + 2 * number)[0])


def _follow(table: memoryview, place: int) -> int:
    return place + int(struct.unpack_from("<I", table, place)[0])
