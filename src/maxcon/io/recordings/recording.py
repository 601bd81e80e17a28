# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Recording: topics and messages of a bag (ROS 1 or 2) or of an MCAP file, and their content by ROS's definitions."""

import bz2
import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.text import SCAN_SUFFIXES, in_natural_order, printable

LARGEST_CHUNK = 2**29
"""Bytes; recorders write chunks of about a megabyte, and more where a single message is larger."""
ADDED = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "velodyne_msgs/msg/VelodynePacket": "time stamp\nuint8[1206] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
}
"""Definitions of messages that rosbags lacks for ROS 1 or ROS 2."""


@dataclass(frozen=True, slots=True)
class Topic:
    """Name of a topic, type of its messages (sensor_msgs/msg/PointCloud2), and how many there are."""

    name: str
    type: str
    n_messages: int

    @property
    def words(self) -> str:
        """Return "/points (sensor_msgs/msg/PointCloud2)", on one line whatever the name."""
        return f"{printable(self.name)} ({printable(self.type)})"


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """A message as recorded: its topic and type, its encoding (cdr or ros1), time of recording (ns), and bytes."""

    topic: str
    type: str
    encoding: str
    recorded: int
    data: bytes


class Recording(ABC):
    """An open recording. Opening reads its index; iterating holds one chunk of it at a time."""

    kind = "a recording"
    topics: tuple[Topic, ...]
    notes: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path

    @abstractmethod
    def _read(self, topics: Collection[str], start: int) -> Iterator[Message]:
        """Yield the messages of some topics recorded at `start` (ns) or later."""

    def messages(self, topics: Collection[str], start: int = 0) -> Iterator[Message]:
        """Yield the messages of some topics recorded at `start` (ns) or later, one in memory at a time.

        They come by time of recording where the file allows; which come after which does not depend on `start`.
        """
        with as_file_error(self.path, self.kind):
            yield from self._read(topics, start)

    def of_type(self, *types: str) -> list[Topic]:
        """Return the topics of some types that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.n_messages]

    def close(self) -> None:  # noqa: B027  (MCAP files are open only while they are read)
        """Close the files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def as_extra_missing(path: Path, package: str) -> MissingExtraError:
    """Return the error of a recording that needs a package which is not installed."""
    return MissingExtraError(
        f"Expected the package {package} to read {path}, got none installed. pip install 'maxcon[recordings]'"
    )


@cache
def _types(encoding: str) -> Any:
    """Types of ROS 1 or ROS 2, whose headers differ."""
    from rosbags.typesys import Stores, get_typestore

    return with_added_types(get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE))


def with_added_types(store: Any) -> Any:
    """Return a store of types, with those of `ADDED` that it lacks."""
    from rosbags.typesys import get_types_from_msg

    added: dict[str, Any] = {}
    for name, text in ADDED.items():
        if name not in store.types:
            added |= get_types_from_msg(text, name)
    store.register(added)
    return store


def decode_message(message: Message) -> Any:
    """Return the content of a message, with the names of its definition as attributes; FileError if it is not ROS's."""
    if message.encoding == "cdr":
        return _types("cdr").deserialize_cdr(message.data, message.type)
    if message.encoding == "ros1":
        return _types("ros1").deserialize_ros1(message.data, message.type)
    raise FileError(
        f"Expected messages of {printable(message.topic)} in the encoding cdr or ros1, got {message.encoding!r}."
        " Record them with ROS, or convert the recording."
    )


def frame_name(text: str) -> str:
    """Return a frame's name without the slash that older recordings begin it with."""
    return text.strip().lstrip("/")


def frame_of(content: Any) -> str:
    """Name of the frame in the header of a message."""
    return frame_name(str(content.header.frame_id))


def stamp_of(content: Any, recorded: int) -> int:
    """Time in the header of a message, ns; when it was recorded where the header has none."""
    stamp = int(content.header.stamp.sec) * 10**9 + int(content.header.stamp.nanosec)
    return stamp if stamp > 0 else recorded


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
    from maxcon.io.recordings.mcap_files import McapFiles

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
