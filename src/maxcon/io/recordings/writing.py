# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Writers of recordings: messages of nested values into a ROS 1 bag or an MCAP file."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from maxcon._system.atomic import atomic_file
from maxcon.errors import MissingExtraError
from maxcon.io.recordings.recording import with_added_types

__all__ = ["BagWriter", "Entry", "RecordingKind", "RecordingWriter", "check_writers", "header_of", "open_writer"]

CHUNK_BYTES = 2**20


class RecordingKind(StrEnum):
    """Kinds of recordings that can be written."""

    ROS1 = "bag"
    MCAP = "mcap"


class Entry(NamedTuple):
    """A message to be written: time of recording (s), topic, type, and nested values by the names of the type."""

    time: float
    topic: str
    type: str
    content: dict[str, Any]


def header_of(time: float, frame: str) -> dict[str, Any]:
    """Return the header of a message at a time, s."""
    nanoseconds = round(time * 1e9)
    return {"stamp": dict(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), "frame_id": frame}


class RecordingWriter(ABC):
    """Writes messages with a package's writer; `store` has the types of rosbags."""

    def __init__(self, store: Any) -> None:
        self.store = store
        self._channels: dict[str, Any] = {}

    def write(self, entry: Entry) -> None:
        """Append one message; its header is that of a sensor at its time, unless its content has one."""
        if entry.topic not in self._channels:
            self._channels[entry.topic] = self._channel(entry)
        content = self._built(entry.type, {"header": header_of(entry.time, "sensor"), **entry.content})
        self._append(self._channels[entry.topic], round(entry.time * 1e9), entry.type, content)

    def _built(self, kind: str, values: dict[str, Any]) -> Any:
        """A message from nested values; fields that are not given are 0."""
        from rosbags.interfaces import Nodetype

        _, fields = self.store.fielddefs[kind]
        given: dict[str, Any] = {}
        for name, (node, what) in fields:
            value = values.get(name, 0)
            if node == Nodetype.NAME:
                value = self._built(what, value)
            elif node == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
                value = [self._built(what[0][1], item) for item in value]
            given[name] = value
        return self.store.types[kind](**given)

    @abstractmethod
    def _channel(self, entry: Entry) -> Any: ...

    @abstractmethod
    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None: ...


class BagWriter(RecordingWriter):
    """Into a bag, with a writer of rosbags and the function of the store that encodes for it."""

    def __init__(self, store: Any, writer: Any, serialize: Callable[[Any, str], Any]) -> None:
        super().__init__(store)
        self._writer, self._serialize = writer, serialize

    def _channel(self, entry: Entry) -> Any:
        return self._writer.add_connection(entry.topic, entry.type, typestore=self.store)

    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None:
        self._writer.write(channel, nanoseconds, self._serialize(content, kind))


class _McapWriter(RecordingWriter):
    """Into an MCAP file."""

    def __init__(self, store: Any, writer: Any) -> None:
        super().__init__(store)
        self._writer = writer

    def _channel(self, entry: Entry) -> Any:
        text, _ = self.store.generate_msgdef(entry.type, ros_version=2)
        schema = self._writer.register_schema(entry.type, "ros2msg", text.encode())
        return self._writer.register_channel(entry.topic, "cdr", schema)

    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None:
        data = bytes(self.store.serialize_cdr(content, kind))
        self._writer.add_message(channel, nanoseconds, data, nanoseconds)


def check_writers() -> None:
    """Refuse to write recordings where the packages for it are missing.

    Raises
    ------
    MissingExtraError
        If the extra `recordings` is not installed.
    """
    try:
        import mcap.writer  # noqa: F401
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected the packages rosbags and mcap to write a recording, got none installed."
            " pip install 'maxcon[recordings]'"
        ) from error


@contextmanager
def open_writer(path: Path, kind: RecordingKind) -> Iterator[RecordingWriter]:
    """Open a writer of a recording, which appears at its path once it is complete; an old file there is replaced."""
    check_writers()
    from mcap.writer import CompressionType, Writer
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial:
        if kind is RecordingKind.ROS1:
            store = with_added_types(get_typestore(Stores.ROS1_NOETIC))
            with rosbag1.Writer(partial) as bag:
                yield BagWriter(store, bag, store.serialize_ros1)
        else:
            with partial.open("wb") as stream:
                mcap: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
                mcap.start(profile="ros2", library="maxcon")
                yield _McapWriter(get_typestore(Stores.ROS2_HUMBLE), mcap)
                mcap.finish()
