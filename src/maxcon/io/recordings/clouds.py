"""Scans of a recording: clouds of a topic, or of a capture (.pcap) of a Velodyne's packets, in order of time."""

import io
import os
import threading
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon.errors import FileError, needs_extra
from maxcon.io.clouds.base import as_file_error
from maxcon.io.point_records import CloudPoints, decode_points, decode_times, records_of_message
from maxcon.io.raw_scan import RawScan, Scans, scan_within
from maxcon.io.recordings.livox import LIVOX, records_of_livox
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, existing_file, open_recording
from maxcon.io.recordings.recording import Message, Recording, Topic, choose_topic, decode_message, frame_of, stamp_of
from maxcon.io.text import printable

T = TypeVar("T")
CLOUDS, VELODYNE = ("sensor_msgs/msg/PointCloud2", *LIVOX), "velodyne_msgs/msg/VelodyneScan"
PACKET_BYTES, POSITION_BYTES = 1206, (512, 554)  # of a Velodyne's data, and of its GNSS receiver's position
LOOKED_AT = 2000  # UDP packets that are read to find out whether they are a Velodyne's
HEADER_BYTES = 24  # of a capture file


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCloud:
    """One cloud of a recording, decoded when it is asked for its content."""

    label: str  # file and topic, for messages
    recorded: int  # ns
    stamp: int  # time of its message, ns
    records: NDArray[np.void] | FileError  # its points as stored, or why they cannot be read

    def points(self) -> CloudPoints:
        """Return its returns; FileError if it is broken."""
        return self.decoded(decode_points)

    def decoded(self, decode: Callable[[NDArray[np.void], int], T]) -> T:
        """Return what is made of its points and its time; FileError if it is broken."""
        if isinstance(self.records, FileError):
            raise self.records
        with as_file_error(Path(self.label), "a point cloud"):
            return decode(self.records, self.stamp)


def open_clouds(path: str | os.PathLike[str], topic: str | None = None) -> "CloudSource":
    """Return the clouds of a recording or capture; none is read yet."""
    if Path(path).suffix.lower() == CAPTURE_SUFFIX and topic is None:
        return VelodyneCapture(existing_file(path))
    recording = open_recording(path)
    try:
        return TopicOfClouds(recording, topic_of_clouds(recording, topic))
    except BaseException:
        recording.close()
        raise


def topic_of_clouds(recording: Recording, name: str | None) -> Topic:
    """Return the topic with the clouds; packets of the scanner may have been recorded beside it."""
    advice = "If these are packets, record the cloud of the scanner's driver."
    return choose_topic(recording, name, (*CLOUDS, VELODYNE), CLOUDS, "point clouds", "--topic", lambda: advice)


class TopicOfClouds:
    """The clouds of one topic."""

    n_passed_over = 10  # clouds to read on up to a later one, rather than to read from that one's time on

    def __init__(self, recording: Recording, topic: Topic) -> None:
        self.path, self.label, self._topic = recording.path, printable(topic.name), topic
        self.notes, self.n_clouds = recording.notes, topic.n_messages
        self._recording, self.close = recording, recording.close

    def clouds(self, start: int = 0) -> Iterator[RecordedCloud]:
        """Yield the clouds recorded at `start` (ns) or later; which comes after which does not depend on `start`."""
        for message in self._recording.messages([self._topic.name], start):
            yield _cloud(message, f"{self.path}, {self.label}")

    @property
    def frame(self) -> str:
        """Name of the scanner's frame, from the first of its messages that can be read."""
        for message in self._recording.messages([self._topic.name]):
            with suppress(FileError), as_file_error(self.path, "a message of a cloud"):
                return frame_of(decode_message(message))
        return ""


def _cloud(message: Message, label: str) -> RecordedCloud:
    stamp = message.recorded
    try:
        with as_file_error(Path(label), "a message of a cloud"):
            if message.type in LIVOX:
                captured, records = records_of_livox(message)
                return RecordedCloud(label, message.recorded, captured or stamp, records)
            content = decode_message(message)
            stamp = stamp_of(content, message.recorded)
            if message.type == VELODYNE:
                captured, records = _of_packets(content, stamp)
                return RecordedCloud(label, message.recorded, captured, records)
            return RecordedCloud(label, message.recorded, stamp, records_of_message(content))
    except FileError as error:
        return RecordedCloud(label, message.recorded, stamp, error)


class VelodyneCapture:
    """The packets of one Velodyne scanner, as `TopicOfClouds`; each cloud is one turn, found by the first pass.

    Times are those at which packets were captured: the scanner's own clock counts from the full hour, and is set only
    where a GNSS receiver is connected.
    """

    n_passed_over = 1
    n_clouds, notes, frame = 0, (), ""

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self._turns: list[tuple[int, int, int]] = []  # when the last packet was captured, ns; begin and end in the file
        seen = Counter(islice(_datagrams(path), LOOKED_AT))
        if not any(n_bytes == PACKET_BYTES for _, n_bytes in seen):
            listed = ", ".join(f"{n} of {size} bytes to port {port}" for (port, size), n in seen.most_common(3))
            raise FileError(
                f"Expected packets of a Velodyne in {path}, got {listed or 'no UDP packets'}. Record that scanner's"
                " point cloud as a bag or MCAP."
            )
        self._package = _decoder_package(path)

    def clouds(self, start: int = 0) -> Iterator[RecordedCloud]:
        """Yield the turns captured at `start` (ns) or later, in the order of their capture."""
        with as_file_error(self.path, "a capture of a Velodyne's packets"), self.path.open("rb") as stream:
            turns = self._known(stream, start) if self._turns else self._found(stream)
            for captured, points in turns:
                if captured >= start:
                    yield RecordedCloud(self.label, captured, captured, points)

    def _found(self, stream: Any) -> Iterator[tuple[int, Any]]:
        """Decode all packets one after the other, and note where each turn is."""
        turns: list[tuple[int, int, int]] = []
        self._config = self._package.Config()
        self._config.model, self._config.calibration = self._package.hdl64e.detect_hdl64e(stream)
        stream.seek(0)
        decoder = self._package.StreamDecoder(self._config)
        begin = end = HEADER_BYTES
        for time, data in self._package.util.iter_pcap(stream):
            packet, end = end, stream.tell()
            if len(data) != PACKET_BYTES:
                continue
            turn = decoder.decode(time, data, True)
            if turn is not None:
                # After a gap the packet that ended a turn is the first of the next one, which is later.
                turns.append((_captured(turn), begin, end if turn[0].host == float(time) else packet))
                begin = turns[-1][2]
                yield turns[-1][0], turn[1]
        turn = decoder.finish(True)
        if turn is not None:
            turns.append((_captured(turn), begin, end))
            yield turns[-1][0], turn[1]
        if not turns:
            raise FileError(f"Expected a turn of a Velodyne scanner in {self.path}, got none. Was it recorded whole?")
        self._turns = turns

    def _known(self, stream: Any, start: int) -> Iterator[tuple[int, Any]]:
        """Decode the turns captured at `start` or later, each from its own packets."""
        header = stream.read(HEADER_BYTES)
        for captured, begin, end in self._turns:
            if captured >= start:
                stream.seek(begin)
                own = io.BytesIO(header + stream.read(end - begin))
                packets = [(t, data) for t, data in self._package.util.iter_pcap(own) if len(data) == PACKET_BYTES]
                yield captured, _decoded(self._package, packets, self._config)[1]

    def close(self) -> None:
        """Do nothing: a capture is open only while it is read."""


CloudSource = TopicOfClouds | VelodyneCapture


def topics_of_capture(path: Path) -> tuple[Topic, ...]:
    """Return the ports of a capture as topics: kind and number of packets."""
    kinds = {PACKET_BYTES: ": returns of a Velodyne"}
    kinds |= dict.fromkeys(POSITION_BYTES, ": position of a Velodyne's receiver")
    seen = sorted(Counter(_datagrams(path)).items())[:20]
    return tuple(Topic(f"port {port}", f"{size} bytes{kinds.get(size, '')}", n) for (port, size), n in seen)


def _datagrams(path: Path) -> Iterator[tuple[int, int]]:
    """Yield port and bytes of payload (of the whole, if IP has split it) of the UDP packets of a capture."""
    with needs_extra("dpkt", f"to read {path}", "recordings"):
        import dpkt
    with as_file_error(path, "a capture of packets (.pcap)"), path.open("rb") as stream:
        for _, data in dpkt.pcap.Reader(stream):
            try:
                packet = dpkt.ethernet.Ethernet(data).data.data
            except (dpkt.dpkt.UnpackError, AttributeError):
                continue
            if isinstance(packet, dpkt.udp.UDP):
                yield packet.dport, max(packet.ulen - 8, 0)


def _of_packets(content: Any, stamp: int) -> tuple[int, NDArray[np.void]]:
    """The time of the last packet of a velodyne_msgs/VelodyneScan message, or else `stamp`, ns; and the points."""
    package = _decoder_package(None)
    if not len(content.packets):
        raise ValueError("no packets")
    times = [packet.stamp.sec + packet.stamp.nanosec * 1e-9 or stamp * 1e-9 for packet in content.packets]
    turn = _decoded(package, zip(times, (packet.data for packet in content.packets), strict=True), package.Config())
    return _captured(turn), turn[1]


def _decoded(package: Any, packets: Iterable[tuple[float, bytes]], config: Any) -> Any:
    """Decode the packets of one turn: its time and a structured array of points."""
    vector = package.PacketVector()
    for time, data in packets:
        vector.append(package.VelodynePacket(float(time), data))
    return package.ScanDecoder(config).decode(vector, as_pcl_structs=True)


def _captured(turn: Any) -> int:
    return round(float(turn[0].host) * 1e9)


def _decoder_package(path: Path | None) -> Any:
    with needs_extra("velodyne-decoder", f"to read {path or 'packets of a Velodyne'}", "velodyne"):
        import velodyne_decoder
    return velodyne_decoder


class RecordedScans(Scans):
    """The scans of a recording; their times are found by one pass through it, when they are first asked for."""

    def __init__(self, source: CloudSource, *, at_stamp: bool = False) -> None:
        self.source = source
        self.at_stamp = at_stamp
        self._progress: Progress | None = None
        self._running: Iterator[tuple[int, RecordedCloud]] | None = None
        self._start, self._next = 0, 0
        self._lock = threading.Lock()  # epochs may be localized by several threads
        self._close = weakref.finalize(self, source.close)

    def find_times(self, progress: Progress | None = None) -> None:
        """Find the times of all scans now, with progress; otherwise that is done when they are first needed."""
        self._progress = progress
        _ = self._index

    @cached_property
    def _index(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], dict[str, int]]:
        """When each cloud was recorded, ns; times of scans, and which clouds they are; clouds by `PointTimes.kind`."""
        recorded, times = [], []
        kinds: Counter[str] = Counter()
        for cloud in self.source.clouds():
            recorded.append(cloud.recorded)
            offset = 0.0
            try:
                found = cloud.decoded(decode_times)
            except FileError:
                kinds["not readable"] += 1
            else:
                kinds[found.kind] += 1
                offset = 0.0 if self.at_stamp else found.middle
            times.append(cloud.stamp / 1e9 + offset)
            if self._progress is not None:
                self._progress("finding times", len(times), max(self.source.n_clouds, len(times)))
        if not times:
            raise FileError(f"Expected clouds in {self.source.path}, got none. Was it recorded whole?")
        return np.array(recorded), *np.unique(np.array(times), return_index=True), dict(kinds)

    @cached_property
    def times(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Times of the scans, shape (n,), s, strictly increasing."""
        return self._index[1]

    @property
    def words(self) -> str:
        """Which clouds these are, and how their times were understood, in a line."""
        recorded, _, rows, found = self._index
        kinds = "; ".join(kind if len(found) == 1 else f"{kind} ({count})" for kind, count in found.items())
        n_repeated = len(recorded) - len(rows)
        repeated = f"; {n_repeated} left out, as another has the same time" * bool(n_repeated)
        notes = "".join(f"; {note}" for note in self.source.notes)
        return f"scans from {self.source.label}, times of points: {kinds}{repeated}{notes}"

    def name(self, i: int) -> str:
        """Return the topic of scan number `i`, and which of its clouds it is."""
        return f"{self.source.label}#{self._index[2][i]}"

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`; fast where they are read one after the other."""
        with self._lock:
            cloud = self._cloud(int(self._index[2][i]))
        time = float(self.times[i])
        return scan_within(cloud.points(), cloud.stamp / 1e9, time, self.name(i), min_range, max_range)

    def close(self) -> None:
        """Close the recording; it is closed as well when these scans are no longer used."""
        self._running = None
        self._close()

    def _cloud(self, row: int) -> RecordedCloud:
        """The cloud of a row of the index: the next ones are read up to it, or the recording from its time on."""
        recorded = self._index[0]
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
