# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Writers of recordings: messages of nested values into a ROS 1 bag or an MCAP file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from maxcon._system.atomic import atomic_file
from maxcon.errors import MissingExtraError
from maxcon.io.recordings.recording import with_added_types

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


class RecordingWriter:
    """Writes messages; `store` has their types, `add_channel` and `append` act on a package's writer."""

    def __init__(
        self, store: Any, add_channel: Callable[[Entry], Any], append: Callable[[Any, int, str, Any], None]
    ) -> None:
        self._store, self._add_channel, self._append = store, add_channel, append
        self._channels: dict[str, Any] = {}

    def write(self, entry: Entry) -> None:
        """Append one message; its header is that of a sensor at its time, unless its content has one."""
        if entry.topic not in self._channels:
            self._channels[entry.topic] = self._add_channel(entry)
        content = self._built(entry.type, {"header": header_of(entry.time, "sensor"), **entry.content})
        self._append(self._channels[entry.topic], round(entry.time * 1e9), entry.type, content)

    def _built(self, kind: str, values: dict[str, Any]) -> Any:
        """A message from nested values; fields that are not given are 0."""
        from rosbags.interfaces import Nodetype

        _, fields = self._store.fielddefs[kind]
        given: dict[str, Any] = {}
        for name, (node, what) in fields:
            value = values.get(name, 0)
            if node == Nodetype.NAME:
                value = self._built(what, value)
            elif node == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
                value = [self._built(what[0][1], item) for item in value]
            given[name] = value
        return self._store.types[kind](**given)


def bag_writer(store: Any, bag: Any, serialize: Callable[[Any, str], Any]) -> RecordingWriter:
    """Return a writer into a bag opened by rosbags; `serialize` is the method of the store that encodes for it."""
    return RecordingWriter(
        store,
        lambda entry: bag.add_connection(entry.topic, entry.type, typestore=store),
        lambda channel, nanoseconds, kind, content: bag.write(channel, nanoseconds, serialize(content, kind)),
    )


def _mcap_writer(store: Any, mcap: Any) -> RecordingWriter:
    def add_channel(entry: Entry) -> Any:
        text, _ = store.generate_msgdef(entry.type, ros_version=2)
        return mcap.register_channel(entry.topic, "cdr", mcap.register_schema(entry.type, "ros2msg", text.encode()))

    def append(channel: Any, nanoseconds: int, kind: str, content: Any) -> None:
        mcap.add_message(channel, nanoseconds, bytes(store.serialize_cdr(content, kind)), nanoseconds)

    return RecordingWriter(store, add_channel, append)


def check_writers() -> None:
    """Refuse to write recordings where the packages for it are missing (MissingExtraError)."""
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
                yield bag_writer(store, bag, store.serialize_ros1)
        else:
            with partial.open("wb") as stream:
                mcap: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
                mcap.start(profile="ros2", library="maxcon")
                yield _mcap_writer(get_typestore(Stores.ROS2_HUMBLE), mcap)
                mcap.finish()
