# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Bags of ROS 1, and of ROS 2 in SQLite, through rosbags."""

import bz2
from abc import abstractmethod
from collections.abc import Collection, Generator
from pathlib import Path
from typing import Any

from maxcon.errors import FileError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.base import LARGEST_CHUNK, Message, Recording, Topic, as_extra_missing

__all__ = ["Ros1Bag", "SqliteBag"]


class _Bag(Recording):
    """What bags of both kinds have in common: a reader of rosbags, with connections."""

    encoding: str

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with as_file_error(path, self.kind):
            try:
                reader = self._reader_class()
            except ImportError as error:
                raise as_extra_missing(path, "rosbags") from error
            self._reader = reader(path)
            self._reader.open()
            self.topics = _topics(self._reader.connections)

    @staticmethod
    @abstractmethod
    def _reader_class() -> Any:
        """Import what reads such a bag: a class of rosbags."""

    def _read(self, topics: Collection[str], start: int | None) -> Generator[Message]:
        wanted = [connection for connection in self._reader.connections if connection.topic in topics]
        if not wanted:
            return
        for connection, recorded, data in self._reader.messages(connections=wanted, start=start):
            yield Message(connection.topic, connection.msgtype, self.encoding, recorded, data)

    def close(self) -> None:
        """End all iterations and close the files."""
        super().close()
        self._reader.close()


def _topics(connections: Collection[Any]) -> tuple[Topic, ...]:
    """One topic of each name; a bag has a connection for each of its publishers."""
    counts: dict[tuple[str, str], int] = {}
    for connection in connections:
        key = (connection.topic, connection.msgtype)
        counts[key] = counts.get(key, 0) + connection.msgcount
    return tuple(Topic(name, kind, count) for (name, kind), count in sorted(counts.items()))


class Ros1Bag(_Bag):
    """A .bag of ROS 1."""

    kind = "a ROS 1 bag"
    encoding = "ros1"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        import lz4.frame

        # Nothing bounds what a chunk unpacks to but the functions that unpack it.
        bounded = {bz2.decompress: _unpack_bz2, lz4.frame.decompress: _unpack_lz4}
        chunks = self._reader.chunks
        for position, chunk in list(chunks.items()):
            if chunk.decompressor in bounded:
                chunks[position] = chunk._replace(decompressor=bounded[chunk.decompressor])

    @staticmethod
    def _reader_class() -> Any:
        import lz4.frame  # noqa: F401  # for the chunks
        from rosbags.rosbag1 import Reader

        return Reader


class SqliteBag(_Bag):
    """A folder of ROS 2 with .db3 files and their metadata.yaml, or one .db3 file."""

    kind = "a ROS 2 bag"
    encoding = "cdr"

    @staticmethod
    def _reader_class() -> Any:
        from rosbags.rosbag2 import Reader

        return Reader


def _unpack_bz2(packed: bytes) -> bytes:
    return _within_limit(bz2.BZ2Decompressor().decompress(packed, LARGEST_CHUNK + 1))


def _unpack_lz4(packed: bytes) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return _within_limit(LZ4FrameDecompressor().decompress(packed, LARGEST_CHUNK + 1))


def _within_limit(data: bytes) -> bytes:
    """Return what was unpacked; sizes in headers say nothing of that.

    Raises
    ------
    FileError
        If it is larger than any chunk.
    """
    if len(data) > LARGEST_CHUNK:
        raise FileError(f"Expected chunks of at most {LARGEST_CHUNK:,} bytes, got one that unpacks to more.")
    return data
