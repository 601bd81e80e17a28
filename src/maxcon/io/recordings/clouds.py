# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""open_clouds: the topic of a recording, or the capture, that has the point clouds."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from maxcon.errors import FileError, OptionError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.captures import VelodyneCapture, record_of_packets
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, existing_file, open_recording
from maxcon.io.recordings.point_cloud2 import CloudRecord, CloudSource, FieldDescription, RecordedCloud
from maxcon.io.recordings.recording import Message, Recording, Topic, decode_message, frame_of, stamp_of
from maxcon.io.text import printable

__all__ = ["CLOUD", "VELODYNE", "TopicOfClouds", "chosen_topic", "open_clouds"]

CLOUD, VELODYNE = "sensor_msgs/msg/PointCloud2", "velodyne_msgs/msg/VelodyneScan"


class TopicOfClouds(CloudSource):
    """The clouds of one topic."""

    def __init__(self, recording: Recording, topic: Topic) -> None:
        self.path, self.label, self.topic = recording.path, printable(topic.name), topic
        self.notes, self.n_clouds = recording.notes, topic.n_messages
        self._recording = recording

    def clouds(self, start: int = 0) -> Iterator[RecordedCloud]:
        """Yield the clouds recorded at `start` (ns) or later."""
        for message in self._recording.messages([self.topic.name], start):
            yield _cloud(message, f"{self.path}, {self.label}")

    @property
    def frame(self) -> str:
        """Name of the scanner's frame, from the first of its messages that can be read."""
        for message in self._recording.messages([self.topic.name]):
            with suppress(FileError), as_file_error(self.path, "a message of a cloud"):
                return frame_of(decode_message(message))
        return ""

    def close(self) -> None:
        """Close the recording."""
        self._recording.close()


def _cloud(message: Message, label: str) -> RecordedCloud:
    stamp = message.recorded
    try:
        with as_file_error(Path(label), "a message of a cloud"):
            content = decode_message(message)
            stamp = stamp_of(content, message.recorded)
            if message.type == VELODYNE:
                record = record_of_packets(content, stamp)
                return RecordedCloud(label, message.recorded, record.stamp, record)
            record = CloudRecord(
                fields=tuple(FieldDescription(f.name, f.offset, f.datatype, f.count) for f in content.fields),
                width=content.width,
                height=content.height,
                point_step=content.point_step,
                row_step=content.row_step,
                is_big_endian=bool(content.is_bigendian),
                data=content.data,
                stamp=stamp,
            )
            return RecordedCloud(label, message.recorded, stamp, record)
    except FileError as error:
        return RecordedCloud(label, message.recorded, stamp, error)


def open_clouds(path: str | os.PathLike[str], topic: str | None = None) -> CloudSource:
    """Return the clouds of a recording or capture; none is read yet.

    FileError if there is no recording, it is broken, it has no clouds, or several and none is asked for;
    MissingExtraError if an extra is not installed.
    """
    if Path(path).suffix.lower() == CAPTURE_SUFFIX and topic is None:
        return VelodyneCapture(existing_file(path))
    recording = open_recording(path)
    try:
        return TopicOfClouds(recording, chosen_topic(recording, topic))
    except BaseException:
        recording.close()
        raise


def chosen_topic(recording: Recording, name: str | None) -> Topic:
    """Return the topic with the clouds: the one asked for (OptionError if it has none), or the only one (FileError)."""
    clouds = recording.of_type(CLOUD, VELODYNE)
    if name is not None:
        return _named_topic(recording, name, clouds)
    plain = [topic for topic in clouds if topic.type == CLOUD]
    for topics in (clouds, plain):  # packets of the scanner may have been recorded beside its cloud
        if len(topics) == 1:
            return topics[0]
    if clouds:
        raise FileError(
            f"Expected one point cloud in {recording.path}, got {_listed(clouds)}. Choose one with --topic."
        )
    packets = [topic for topic in recording.topics if "packet" in f"{topic.name}{topic.type}".lower()]
    if packets:
        raise FileError(
            f"Expected a point cloud in {recording.path}, got packets, no point cloud: {_listed(packets)}. Record the"
            " cloud of the scanner's driver, or play these packets through it."
        )
    raise FileError(
        f"Expected a topic of type {CLOUD} in {recording.path}, got {_listed(recording.topics) or 'no messages'}. Is it"
        " the right recording?"
    )


def _named_topic(recording: Recording, name: str, clouds: Sequence[Topic]) -> Topic:
    found = [topic for topic in recording.topics if topic.name == name]
    if not found:
        raise OptionError(
            f"Expected the topic {name} in {recording.path}, got {_listed(clouds or recording.topics)}. Name one of"
            " these."
        )
    if found[0] not in clouds:
        raise OptionError(
            f"Expected point clouds in the topic {name} of {recording.path}, got {found[0].n_messages} messages of"
            f" type {printable(found[0].type)}. " + (f"Ask for {_listed(clouds)}." if clouds else "There is no other.")
        )
    return found[0]


def _listed(topics: Sequence[Topic]) -> str:
    """Names and types, at most six of them."""
    words = ", ".join(topic.words for topic in topics[:6])
    return f"{words} and {len(topics) - 6} more" if len(topics) > 6 else words
