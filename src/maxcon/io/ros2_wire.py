"""Topics of ROS 2 by DDS, without ROS: messages go in and out as the bytes that ROS puts on the wire."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from maxcon.errors import MaxconError, needs_extra
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.recording import Message, decode_message, encode_message, message_types

BLOCKED = 100_000_000  # ns that a writer waits at most for a reader that cannot follow
DEPTH = 5  # messages of a topic that are kept


def dds_names(topic: str, kind: str) -> tuple[str, str]:
    """Return the names of a topic and of its type on the wire, of "/points" and "sensor_msgs/msg/PointCloud2"."""
    package, folder, name = kind.split("/")
    return "rt/" + topic.lstrip("/"), f"{package}::{folder}::dds_::{name}_"


@cache
def _type_of(kind: str) -> Any:
    """The type of a message, by which DDS checks what comes; its content stays bytes: numbers would take 20 ms."""
    from cyclonedds import idl
    from rosbags.interfaces import Nodetype

    types: Any = idl.types

    def hint(node: Any, what: Any) -> Any:
        if node == Nodetype.NAME:
            return _type_of(what)
        if node == Nodetype.BASE:
            return {"bool": bool, "string": str}.get(what[0]) or getattr(types, what[0])
        item = hint(*what[0])
        return types.array[item, what[1]] if node == Nodetype.ARRAY else types.sequence[item]

    fields = {name: hint(*field) for name, field in message_types("cdr").fielddefs[kind][1]}
    name = dds_names("", kind)[1].replace("::", ".")
    made: Any = idl.make_idl_struct(name.rpartition(".")[2], name, fields, dataclassify=False)

    def deserialize(data: bytes, **_: object) -> Any:
        return _packed(made, data)

    made.deserialize = made.deserialize_key = staticmethod(deserialize)
    made.serialize = lambda message, **_: message.packed
    return made


def _packed(made: Any, data: bytes) -> Any:
    message = made()
    message.packed = data
    return message


class Ros2Wire:
    """A participant of DDS in a domain, as of ROS_DOMAIN_ID; needs the extra `ros2`."""

    def __init__(self, domain: int = 0) -> None:
        with needs_extra("cyclonedds", "to speak with ROS 2", "ros2"):
            from cyclonedds.core import DDSException, WaitSet
            from cyclonedds.domain import DomainParticipant
        with needs_extra("rosbags", "to speak with ROS 2", "ros2"):
            message_types("cdr")
        try:
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise MaxconError(
                f"Expected to take part in domain {domain} by DDS, got: {error.msg}. Is there a network, and is"
                " CYCLONEDDS_URI right?"
            ) from error
        self._waits = WaitSet(self._participant)
        self._readers: list[tuple[Any, Any, int, Message, Callable[[Any], None]]] = []

    def subscribe(
        self, topic: str, kind: str, tell: Callable[[Any], None], *, depth: int = DEPTH, is_latched: bool = False
    ) -> None:
        """Have `listen` call `tell` with each message; latched ones come reliably, others by best effort."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader

        reader = DataReader(self._participant, self._topic(topic, kind), _qos(depth, is_latched))
        new = ReadCondition(reader, ViewState.Any | InstanceState.Any | SampleState.NotRead)
        self._waits.attach(new)
        self._readers.append((reader, new, depth, Message(topic, kind, "cdr", 0, b""), tell))

    def publisher(self, topic: str, kind: str, *, is_latched: bool = False) -> Callable[[dict[str, Any]], None]:
        """Return what publishes nested values, reliably, so that all readers match; latched: also to later ones."""
        from cyclonedds.pub import DataWriter

        made = self._topic(topic, kind)
        writer = DataWriter(self._participant, made, _qos(1 if is_latched else DEPTH, is_latched, is_reliable=True))
        return lambda content: writer.write(_packed(made.data_type, encode_message(kind, content)))

    def listen(self, seconds: float) -> None:
        """Hand on what has come, after waiting for so long at most; FileError where a message is broken."""
        self._waits.wait(round(seconds * 1e9))
        for reader, new, depth, empty, tell in self._readers:
            for message in reader.take(N=depth, condition=new):
                if message.sample_info.valid_data:  # else it says that a writer has gone
                    with as_file_error(Path(empty.topic), f"a topic of {empty.type}"):
                        content = decode_message(replace(empty, data=message.packed))
                    tell(content)

    def _topic(self, topic: str, kind: str) -> Any:
        from cyclonedds.topic import Topic

        message_types("cdr").get_msgdef(kind)  # makes the code that packs and unpacks: the first message need not wait
        return Topic(self._participant, dds_names(topic, kind)[0], _type_of(kind))


def _qos(depth: int, is_latched: bool, *, is_reliable: bool = False) -> Any:
    from cyclonedds.core import Policy, Qos

    return Qos(
        Policy.Reliability.Reliable(BLOCKED) if is_reliable or is_latched else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
