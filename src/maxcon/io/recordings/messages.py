# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Messages of ROS 1 and ROS 2, decoded by the standard definitions of their types, not by those in a recording."""

from functools import cache
from typing import Any

from maxcon.errors import FileError
from maxcon.io.recordings.base import Message, printable

__all__ = ["decode_message", "frame_name", "frame_of", "stamp_of", "with_added_types"]

ADDED = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "velodyne_msgs/msg/VelodynePacket": "time stamp\nuint8[1206] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
}
"""Definitions of transforms, and of scans that drivers store as packets: not among the standard ones, or not of each
version of ROS."""


@cache
def _types(encoding: str) -> Any:
    """The types of a ROS version; its header differs between the two."""
    from rosbags.typesys import Stores, get_typestore

    return with_added_types(get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE))


def with_added_types(store: Any) -> Any:
    """Return a store of types with those it lacks of `ADDED`."""
    from rosbags.typesys import get_types_from_msg

    added: dict[str, Any] = {}
    for name, text in ADDED.items():
        if name not in store.types:
            added |= get_types_from_msg(text, name)
    store.register(added)
    return store


def decode_message(message: Message) -> Any:
    """Return the content of a message, with the names of its definition as attributes.

    Raises
    ------
    FileError
        If it is not encoded as ROS does.
    """
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
    """Name of the frame that a message's header tells."""
    return frame_name(str(content.header.frame_id))


def stamp_of(content: Any, recorded: int) -> int:
    """Time of a message, ns; when it was recorded where its header says nothing."""
    stamp = int(content.header.stamp.sec) * 10**9 + int(content.header.stamp.nanosec)
    return stamp if stamp > 0 else recorded
