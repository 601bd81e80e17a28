# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_recording: the reader of a bag of ROS 1, a bag of ROS 2, or an MCAP file, by its path."""

import bz2
import os
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from maxcon.errors import FileError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.file_names import SCAN_SUFFIXES, in_natural_order
from maxcon.io.recordings.mcap_files import McapFiles
from maxcon.io.recordings.recording import LARGEST_CHUNK, Message, Recording, Topic, as_extra_missing

__all__ = ["CAPTURE_SUFFIX", "RECORDING_SUFFIXES", "existing_file", "is_recording", "open_recording"]

RECORDING_SUFFIXES = (".bag", ".mcap", ".db3")
CAPTURE_SUFFIX = ".pcap"


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a recording or a capture by its suffix, or the folder of a ROS 2 bag without scans in files."""
    place = Path(path)
    if not os.path.isdir(place):  # noqa: PTH112  (a name that is too long is no folder, not an error)
        return place.suffix.lower() in (*RECORDING_SUFFIXES, CAPTURE_SUFFIX)
    try:
        names = [file.name for file in place.iterdir() if file.is_file()]
    except OSError:
        return False
    suffixes = {Path(name).suffix.lower() for name in names}
    return ("metadata.yaml" in names or ".mcap" in suffixes) and suffixes.isdisjoint(SCAN_SUFFIXES)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return a path that is a file; FileError if it is missing, a folder, or a pipe."""
    place = Path(path)
    if not os.path.isfile(place):  # noqa: PTH113
        got = "which is no file" if os.path.lexists(place) else "no such file or folder"
        raise FileError(f"Expected a recording at {place}, got {got}. Check the path.")
    return place


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Return an open recording; its index is read, no message.

    Parameters
    ----------
    path : path
        A .bag (ROS 1), a .mcap, a .db3, or the folder of a ROS 2 bag with .mcap or .db3 files.

    Raises
    ------
    FileError
        If there is none, or it is broken.
    MissingExtraError
        If the extra `recordings` is not installed.
    """
    place = Path(path)
    suffix = place.suffix.lower()
    if os.path.lexists(place) and (suffix == CAPTURE_SUFFIX or not is_recording(place)):
        raise FileError(
            f"Expected a recording with suffix {', '.join(RECORDING_SUFFIXES)}, or the folder of a ROS 2 bag, got"
            f" {place}. Check the path."
        )
    if os.path.isdir(place):  # noqa: PTH112
        files = in_natural_order([file for file in place.glob("*.mcap") if file.is_file()])
        return McapFiles(place, files) if files else _Ros2Bag(place)
    file = existing_file(place)
    if suffix == ".bag":
        return _Ros1Bag(file)
    return McapFiles(file, [file]) if suffix == ".mcap" else _Ros2Bag(file)


class _Bag(Recording):
    """A bag that rosbags reads."""

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
            counts: Counter[tuple[str, str]] = Counter()  # a topic has a connection for each of its publishers
            for connection in self._reader.connections:
                counts[connection.topic, connection.msgtype] += connection.msgcount
            self.topics = tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    @staticmethod
    @abstractmethod
    def _reader_class() -> Any:
        """Import the class of rosbags."""

    def _read(self, topics: Collection[str], start: int) -> Iterator[Message]:
        wanted = [connection for connection in self._reader.connections if connection.topic in topics]
        if not wanted:
            return
        for connection, recorded, data in self._reader.messages(connections=wanted, start=start or None):
            yield Message(connection.topic, connection.msgtype, self.encoding, recorded, data)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()


class _Ros1Bag(_Bag):
    """A .bag of ROS 1."""

    kind = "a ROS 1 bag"
    encoding = "ros1"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        import lz4.frame

        # rosbags does not bound what a chunk unpacks to.
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


class _Ros2Bag(_Bag):
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
    if len(data) > LARGEST_CHUNK:
        raise FileError(f"Expected chunks of at most {LARGEST_CHUNK:,} bytes, got one that unpacks to more.")
    return data
