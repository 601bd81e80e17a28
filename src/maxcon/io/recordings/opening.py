# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_recording: the reader of a bag of ROS 1, a bag of ROS 2, or an MCAP file, by its path."""

import bz2
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from maxcon.errors import FileError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.mcap_files import McapFiles
from maxcon.io.recordings.recording import LARGEST_CHUNK, Message, Recording, Topic, as_extra_missing
from maxcon.io.text import SCAN_SUFFIXES, in_natural_order

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
    """Open a .bag (ROS 1), a .mcap, a .db3, or the folder of a ROS 2 bag; its index is read, no message.

    FileError if there is none, or it is broken; MissingExtraError if the extra `recordings` is not installed.
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
        return McapFiles(place, files) if files else _Bag(place, is_ros1=False)
    file = existing_file(place)
    return McapFiles(file, [file]) if suffix == ".mcap" else _Bag(file, is_ros1=suffix == ".bag")


class _Bag(Recording):
    """A .bag of ROS 1; or a folder of ROS 2 with .db3 files and their metadata.yaml, or one .db3 file."""

    def __init__(self, path: Path, *, is_ros1: bool) -> None:
        super().__init__(path)
        self.kind, self._encoding = ("a ROS 1 bag", "ros1") if is_ros1 else ("a ROS 2 bag", "cdr")
        with as_file_error(path, self.kind):
            try:
                if is_ros1:
                    import lz4.frame  # for the chunks
                    from rosbags.rosbag1 import Reader
                else:
                    from rosbags.rosbag2 import Reader  # type: ignore[assignment]
            except ImportError as error:
                raise as_extra_missing(path, "rosbags") from error
            self._reader: Any = Reader(path)
            self._reader.open()
            counts: Counter[tuple[str, str]] = Counter()  # a topic has a connection for each of its publishers
            for connection in self._reader.connections:
                counts[connection.topic, connection.msgtype] += connection.msgcount
            self.topics = tuple(Topic(*key, count) for key, count in sorted(counts.items()))
        if is_ros1:
            # rosbags does not bound what a chunk unpacks to.
            bounded = {bz2.decompress: bz2.BZ2Decompressor, lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor}
            for position, chunk in list(self._reader.chunks.items()):
                if chunk.decompressor in bounded:
                    unpack = partial(_unpacked, bounded[chunk.decompressor])
                    self._reader.chunks[position] = chunk._replace(decompressor=unpack)

    def _read(self, topics: Collection[str], start: int) -> Iterator[Message]:
        wanted = [connection for connection in self._reader.connections if connection.topic in topics]
        if not wanted:
            return
        for connection, recorded, data in self._reader.messages(connections=wanted, start=start or None):
            yield Message(connection.topic, connection.msgtype, self._encoding, recorded, data)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()


def _unpacked(decompressor: Callable[[], Any], packed: bytes) -> bytes:
    """Unpack a chunk, but no more than one may hold."""
    data: bytes = decompressor().decompress(packed, LARGEST_CHUNK + 1)
    if len(data) > LARGEST_CHUNK:
        raise FileError(f"Expected chunks of at most {LARGEST_CHUNK:,} bytes, got one that unpacks to more.")
    return data
