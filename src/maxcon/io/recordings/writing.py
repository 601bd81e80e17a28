# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Writes recordings: messages of nested values into a ROS 1 bag or an MCAP file, for exports and simulated drives."""

from collections.abc import Callable, Iterable, Iterator
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


def write_recording(path: Path, kind: RecordingKind, entries: Iterable[Entry]) -> None:
    """Write messages as a recording, which appears at its path once it is complete; an old file there is replaced."""
    check_writers()
    from mcap.writer import CompressionType, Writer
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial:
        if kind is RecordingKind.ROS1:
            store = with_added_types(get_typestore(Stores.ROS1_NOETIC))
            with rosbag1.Writer(partial) as bag:
                write_bag(bag, store, store.serialize_ros1, entries)
            return
        store, channels = get_typestore(Stores.ROS2_HUMBLE), {}
        with partial.open("wb") as stream:
            mcap: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
            mcap.start(profile="ros2", library="maxcon")
            for entry, nanoseconds, content in _messages(store, entries):
                if entry.topic not in channels:
                    text, _ = store.generate_msgdef(entry.type, ros_version=2)
                    schema = mcap.register_schema(entry.type, "ros2msg", text.encode())
                    channels[entry.topic] = mcap.register_channel(entry.topic, "cdr", schema)
                data = bytes(store.serialize_cdr(content, entry.type))
                mcap.add_message(channels[entry.topic], nanoseconds, data, nanoseconds)
            mcap.finish()


def write_bag(bag: Any, store: Any, serialize: Callable[[Any, str], Any], entries: Iterable[Entry]) -> None:
    """Write messages into a bag opened by rosbags; `serialize` is the method of the store of types that encodes."""
    connections: dict[str, Any] = {}
    for entry, nanoseconds, content in _messages(store, entries):
        if entry.topic not in connections:
            connections[entry.topic] = bag.add_connection(entry.topic, entry.type, typestore=store)
        bag.write(connections[entry.topic], nanoseconds, serialize(content, entry.type))


def _messages(store: Any, entries: Iterable[Entry]) -> Iterator[tuple[Entry, int, Any]]:
    """Yield time (ns) and content of each; its header is that of a sensor at its time, unless it has one."""
    for entry in entries:
        content = {"header": header_of(entry.time, "sensor"), **entry.content}
        yield entry, round(entry.time * 1e9), _built(store, entry.type, content)


def _built(store: Any, kind: str, values: dict[str, Any]) -> Any:
    """A message from nested values; fields that are not given are 0."""
    from rosbags.interfaces import Nodetype

    given: dict[str, Any] = {}
    for name, (node, what) in store.fielddefs[kind][1]:
        value = values.get(name, 0)
        if node == Nodetype.NAME:
            value = _built(store, what, value)
        elif node == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
            value = [_built(store, what[0][1], item) for item in value]
        given[name] = value
    return store.types[kind](**given)
