# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The topic of a recording, or the capture, that has the point clouds; and its scans in order of time."""

import os
import threading
import weakref
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system.progress import Progress
from maxcon.errors import FileError, OptionError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.raw_scan import RawScan, Scans, check_range, returns_in_range
from maxcon.io.recordings.captures import VelodyneCapture, record_of_packets
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, existing_file, open_recording
from maxcon.io.recordings.point_cloud2 import CloudRecord, CloudSource, FieldDescription, RecordedCloud
from maxcon.io.recordings.recording import Message, Recording, Topic, decode_message, frame_of, stamp_of
from maxcon.io.text import printable

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


class _Index(NamedTuple):
    """Clouds of a recording in the order in which they are read, and which of them are scans.

    When each was recorded, shape (k,), ns, not always increasing; times of scans, shape (n,), s, strictly increasing,
    and the clouds that they are, shape (n,); number of clouds by `PointTimes.kind`.
    """

    recorded: NDArray[np.int64]
    times: NDArray[np.float64]
    rows: NDArray[np.int64]
    kinds: dict[str, int]


class RecordedScans(Scans):
    """The scans of a recording; their times are found by one pass through it, when they are first asked for.

    source: where the clouds come from.
    at_stamp: whether the time of a scan is that of its message. Else it is the middle between its first and its last
        point, where points have times.
    """

    def __init__(self, source: CloudSource, *, at_stamp: bool = False) -> None:
        self.source = source
        self.at_stamp = at_stamp
        self._running: Iterator[tuple[int, RecordedCloud]] | None = None
        self._start, self._next = 0, 0
        self._lock = threading.Lock()  # epochs may be localized by several threads
        self._close = weakref.finalize(self, source.close)

    @classmethod
    def open(cls, path: str | os.PathLike[str], topic: str | None = None, *, at_stamp: bool = False) -> Self:
        """Return the scans of a recording; errors as of `open_clouds`."""
        return cls(open_clouds(path, topic), at_stamp=at_stamp)

    def find_times(self, progress: Progress | None = None) -> None:
        """Find the times of all scans now, with progress; otherwise that is done when they are first needed."""
        if "_index" not in self.__dict__:
            self.__dict__["_index"] = self._found(progress)

    @cached_property
    def _index(self) -> _Index:
        return self._found(None)

    def _found(self, progress: Progress | None) -> _Index:
        recorded, times = [], []
        kinds: Counter[str] = Counter()
        for cloud in self.source.clouds():
            recorded.append(cloud.recorded)
            offset = 0.0
            try:
                found = cloud.times()
            except FileError:
                kinds["not readable"] += 1
            else:
                kinds[found.kind] += 1
                offset = 0.0 if self.at_stamp else found.middle
            times.append(cloud.stamp / 1e9 + offset)
            if progress is not None:
                progress("finding times", len(times), max(self.source.n_clouds, len(times)))
        if not times:
            raise FileError(f"Expected clouds in {self.source.path}, got none. Was it recorded whole?")
        in_order, rows = np.unique(np.array(times), return_index=True)
        return _Index(np.array(recorded), in_order, rows, dict(kinds))

    @cached_property
    def times(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Times of the scans, shape (n,), s, strictly increasing."""
        return self._index.times

    @property
    def words(self) -> str:
        """Which clouds these are, and how their times were understood, in a line."""
        kinds = "; ".join(
            kind if len(self._index.kinds) == 1 else f"{kind} ({count})" for kind, count in self._index.kinds.items()
        )
        n_repeated = len(self._index.recorded) - len(self._index.rows)
        repeated = f"; {n_repeated} left out, as another has the same time" * bool(n_repeated)
        notes = "".join(f"; {note}" for note in self.source.notes)
        return f"scans from {self.source.label}, times of points: {kinds}{repeated}{notes}"

    def name(self, i: int) -> str:
        """Return the topic of scan number `i`, and which of its clouds it is."""
        return f"{self.source.label}#{self._index.rows[i]}"

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`; fast where they are read one after the other."""
        check_range(min_range, max_range)
        with self._lock:
            cloud = self._cloud(int(self._index.rows[i]))
        content = cloud.points()
        is_kept, _ = returns_in_range(content.points, min_range, max_range)
        kept, offsets = np.flatnonzero(is_kept), content.times.offsets
        time = float(self.times[i])
        return RawScan(
            points=content.points.take(kept, axis=0),
            time=time,
            name=self.name(i),
            n_returns=content.n_points,
            n_dropped_invalid=content.n_invalid,
            n_dropped_range=len(content.points) - len(kept),
            n_dropped_duplicates=content.n_duplicates,
            point_times=None if offsets is None else offsets.take(kept) - (time - cloud.stamp / 1e9),
        )

    def close(self) -> None:
        """Close the recording; it is closed as well when these scans are no longer used."""
        self._running = None
        self._close()

    def _cloud(self, row: int) -> RecordedCloud:
        """The cloud of a row of the index: the next ones are read up to it, or the recording from its time on."""
        recorded = self._index.recorded
        n_ahead = row - self._next
        running, self._running = self._running, None  # after an error it is begun anew
        if running is None or not 0 <= n_ahead < self.source.n_passed_over or recorded[row] < self._start:
            self._start = int(recorded[row])
            # Clouds recorded earlier are left out of what is read, wherever they stand.
            rows = np.flatnonzero(recorded >= self._start).tolist()
            running = zip(rows, self.source.clouds(self._start), strict=False)
        for number, cloud in running:
            if number == row and cloud.recorded == recorded[row]:
                self._running, self._next = running, number + 1
                return cloud
        raise FileError(f"Expected {self.source.path} as it was when it was opened, got fewer clouds. Open it anew.")
