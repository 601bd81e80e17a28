# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Writers of recordings: messages of nested values into a ROS 1 bag, a ROS 2 bag, or a bare MCAP file."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from maxcon._system.atomic import atomic_file, atomic_folder, check_replaceable
from maxcon.errors import MissingExtraError
from maxcon.io.recordings.messages import with_added_types

__all__ = ["Entry", "RecordingKind", "RecordingWriter", "check_writers", "header_of", "open_writer"]

CHUNK_BYTES = 2**20


class RecordingKind(StrEnum):
    """Kinds of recordings that can be written."""

    ROS1 = "bag"
    ROS2 = "ros2"
    MCAP = "mcap"


class Entry(NamedTuple):
    """A message to be written."""

    time: float
    topic: str
    type: str
    content: dict[str, Any]


def header_of(time: float, frame: str) -> dict[str, Any]:
    """Return the header of a message at a time, s."""
    nanoseconds = round(time * 1e9)
    return {"stamp": dict(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), "frame_id": frame}


class RecordingWriter(ABC):
    """Writes messages with a package's writer."""

    def __init__(self, store: Any) -> None:
        self.store = store
        self._channels: dict[str, Any] = {}

    def write(self, entry: Entry) -> None:
        """Append one message."""
        if entry.topic not in self._channels:
            self._channels[entry.topic] = self._channel(entry)
        content = self._built(entry.type, {"header": header_of(entry.time, "sensor"), **entry.content})
        self._append(self._channels[entry.topic], round(entry.time * 1e9), entry.type, content)

    def _built(self, kind: str, values: dict[str, Any]) -> Any:
        """Return a message from nested values; fields that are not given are 0."""
        return _built(self.store, kind, values)

    @abstractmethod
    def _channel(self, entry: Entry) -> Any: ...

    @abstractmethod
    def _append(self, channel: Any, nanoseconds: int, kind: str, content: Any) -> None: ...


def _built(store: Any, kind: str, values: dict[str, Any]) -> Any:
    from rosbags.interfaces import Nodetype

    _, fields = store.fielddefs[kind]
    given: dict[str, Any] = {}
    for name, (node, what) in fields:
        value = values.get(name, 0)
        if node == Nodetype.NAME:
            value = _built(store, what, value)
        elif node == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
            value = [_built(store, what[0][1], item) for item in value]
        given[name] = value
    return store.types[kind](**given)


class _BagWriter(RecordingWriter):
    """Into a bag of ROS 1 or ROS 2."""

    def __init__(self, store: Any, writer: Any, *, is_ros1: bool) -> None:
        super().__init__(store)
        self._writer = writer
        self._serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr

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


def open_writer(path: Path, kind: RecordingKind, *, overwrite: bool) -> AbstractContextManager[RecordingWriter]:
    """Return a context manager that opens a writer, and moves the recording to its path once it is complete."""
    check_writers()
    if kind is RecordingKind.ROS1:
        return _ros1_writer(path)
    return _mcap_writer(path) if kind is RecordingKind.MCAP else _ros2_writer(path, overwrite=overwrite)


@contextmanager
def _ros1_writer(path: Path) -> Iterator[RecordingWriter]:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial, Writer(partial) as writer:
        yield _BagWriter(with_added_types(get_typestore(Stores.ROS1_NOETIC)), writer, is_ros1=True)


@contextmanager
def _ros2_writer(path: Path, *, overwrite: bool) -> Iterator[RecordingWriter]:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if overwrite:
        check_replaceable(path, "a ROS 2 bag", ("metadata.yaml", "*.db3"))
    with atomic_folder(path, overwrite=overwrite) as partial:
        folder = partial / path.name  # the writer makes its folder itself, and names its file like it
        with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            yield _BagWriter(get_typestore(Stores.ROS2_HUMBLE), writer, is_ros1=False)
        for file in folder.iterdir():
            file.rename(partial / file.name)
        folder.rmdir()


@contextmanager
def _mcap_writer(path: Path) -> Iterator[RecordingWriter]:
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_file(path) as partial, partial.open("wb") as stream:
        writer: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="maxcon")
        yield _McapWriter(get_typestore(Stores.ROS2_HUMBLE), writer)
        writer.finish()
