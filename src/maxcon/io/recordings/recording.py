"""Recording: topics and messages of a bag or MCAP file, read and written by the standard definitions of ROS."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, OptionError, needs_extra
from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.clouds.base import as_file_error
from maxcon.io.text import printable

ADDED = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "velodyne_msgs/msg/VelodynePacket": "time stamp\nuint8[1206] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
}
"""Definitions of messages that rosbags lacks for ROS 1 or ROS 2."""
FLOAT32 = 7  # code in sensor_msgs/PointField


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


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """An open recording. Opening reads its index; iterating holds one chunk of it at a time."""

    path: Path
    kind: str  # in words
    topics: tuple[Topic, ...]
    read: Callable[[Collection[str], int], Iterator[Message]]
    close: Callable[[], None] = lambda: None
    notes: tuple[str, ...] = ()

    def messages(self, topics: Collection[str], start: int = 0) -> Iterator[Message]:
        """Yield the messages of some topics recorded at `start` (ns) or later; by time where the file allows."""
        with as_file_error(self.path, self.kind):
            yield from self.read(topics, start)

    def of_type(self, *types: str) -> list[Topic]:
        """Return the topics of some types that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.n_messages]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def choose_topic(
    recording: Recording, name: str | None, kinds: Sequence[str], preferred: Collection[str], what: str, option: str,
    otherwise: Callable[[], str],
) -> Topic:  # fmt: skip
    """Return the topic asked for, or the only one of some kinds, or of several the only one of the preferred kinds."""
    found = recording.of_type(*kinds)
    if name is not None:
        if named := [topic for topic in found if topic.name == name]:
            return named[0]
        got = next((printable(topic.type) for topic in recording.topics if topic.name == name), "no such topic")
        raise OptionError(
            f"Expected {what} in the topic {name} of {recording.path}, got {got}. Ask for {_listed(found) or 'none'}."
        )
    for topics in (found, [topic for topic in found if topic.type in preferred]):
        if len(topics) == 1:
            return topics[0]
    if found:
        raise FileError(
            f"Expected one topic of {what} in {recording.path}, got {_listed(found)}. Choose one with {option}."
        )
    wanted = ", ".join(dict.fromkeys(kind.rpartition("/")[2] for kind in kinds))
    raise FileError(
        f"Expected {what} ({wanted}) in {recording.path}, got {_listed(recording.topics) or 'no messages'}."
        f" {otherwise()}"
    )


def _listed(topics: Sequence[Topic]) -> str:
    """Names and types, at most six of them."""
    words = ", ".join(topic.words for topic in topics[:6])
    return f"{words} and {len(topics) - 6} more" if len(topics) > 6 else words


@cache
def message_types(encoding: str) -> Any:
    """Return rosbags' store of types of ROS 1 (encoding ros1) or ROS 2 (cdr), whose headers differ."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    for name, text in ADDED.items():
        if name not in store.types:
            store.register(get_types_from_msg(text, name))
    return store


def decode_message(message: Message) -> Any:
    """Return the content of a message, with the names of its definition as attributes; FileError if it is not ROS's."""
    if message.encoding == "cdr":
        return message_types("cdr").deserialize_cdr(message.data, message.type)
    if message.encoding == "ros1":
        return message_types("ros1").deserialize_ros1(message.data, message.type)
    raise FileError(
        f"Expected messages of {printable(message.topic)} in the encoding cdr or ros1, got {message.encoding!r}."
        " Record them with ROS, or convert the recording."
    )


def encode_message(kind: str, content: dict[str, Any], encoding: str = "cdr") -> bytes:
    """Return the bytes of a message from nested values; fields that are not given are 0."""
    store = message_types(encoding)
    serialize = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
    return bytes(serialize(_built(store, kind, content), kind))


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
    with needs_extra("rosbags", "to write a recording", "recordings"):
        import rosbags.typesys  # noqa: F401


def write_recording(path: Path, kind: RecordingKind, entries: Iterable[Entry]) -> None:
    """Write messages as a recording, which appears at its path once it is complete; an old file there is replaced."""
    check_writers()
    from rosbags import rosbag1, rosbag2

    with atomic_file(path) as partial:
        if kind is RecordingKind.ROS1:
            with rosbag1.Writer(partial) as bag:
                write_bag(bag, entries, "ros1")
            return
        folder = partial.with_name("ros2")
        of_ros2 = rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
        of_ros2.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        with of_ros2:
            write_bag(of_ros2, entries)
        (folder / "ros2.mcap").replace(partial)


def write_bag(bag: Any, entries: Iterable[Entry], encoding: str = "cdr") -> None:
    """Write messages into a bag of rosbags; those without a header get that of a sensor."""
    connections: dict[str, Any] = {}
    for entry in entries:
        if entry.topic not in connections:
            connections[entry.topic] = bag.add_connection(entry.topic, entry.type, typestore=message_types(encoding))
        content = {"header": header_of(entry.time, "sensor"), **entry.content}
        bag.write(connections[entry.topic], round(entry.time * 1e9), encode_message(entry.type, content, encoding))


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


def position_and_turn(pose: Pose, names: tuple[str, str]) -> dict[str, dict[str, float]]:
    """Return a pose, or a transform, of its position and its quaternion by these names."""
    turn = quaternions_from_angles(pose.roll, pose.pitch, pose.heading).ravel().tolist()
    position = pose.position.tolist()
    return {names[0]: dict(zip("xyz", position, strict=True)), names[1]: dict(zip("xyzw", turn, strict=True))}


def cloud_content(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, Any]:
    """Return a sensor_msgs/PointCloud2 without a header, of one row; fields by their names, all float32."""
    rows = np.stack(list(columns.values()), axis=1).astype("<f4")
    step = 4 * len(columns)
    fields = [dict(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate(columns)]
    return {
        "height": 1, "width": len(rows), "fields": fields, "is_bigendian": False, "point_step": step,
        "row_step": step * len(rows), "data": rows.ravel().view(np.uint8), "is_dense": True,
    }  # fmt: skip
