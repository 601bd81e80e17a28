# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packet captures (.pcap) and packets in bags: turns of a Velodyne scanner, decoded by velodyne-decoder."""

import io
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.point_cloud2 import FORMATS, CloudRecord, CloudSource, FieldDescription, RecordedCloud
from maxcon.io.recordings.recording import Topic, as_extra_missing

PACKET_BYTES, POSITION_BYTES = 1206, (512, 554)
"""Bytes of a Velodyne's data packets, and of those with the position of its GNSS receiver."""
LOOKED_AT = 2000
"""UDP packets that are read to find out whether they are a Velodyne's."""
HEADER_BYTES = 24
"""Of a capture file."""
CODES = {name: code for code, name in FORMATS.items()}


class _Turn(NamedTuple):
    """One turn in a capture: when its last packet was captured, ns, and the bytes of the file that hold its packets."""

    captured: int
    begin: int
    end: int


class VelodyneCapture(CloudSource):
    """The packets of one Velodyne scanner; each cloud is one turn.

    The first pass through the file finds where the packets of each turn are; later ones read only the turns they want.
    Times are those at which packets were captured: the scanner's own clock counts from the full hour, and is set only
    where a GNSS receiver is connected. FileError if it is no capture, or one of other packets.
    """

    n_passed_over = 1

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self._turns: list[_Turn] = []
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
                    yield RecordedCloud(self.label, captured, captured, _record_of_points(points, captured))

    def _found(self, stream: Any) -> Iterator[tuple[int, Any]]:
        """Decode all packets one after the other, and note where each turn is."""
        turns: list[_Turn] = []
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
                turns.append(_Turn(_captured(turn), begin, end if turn[0].host == float(time) else packet))
                begin = turns[-1].end
                yield turns[-1].captured, turn[1]
        turn = decoder.finish(True)
        if turn is not None:
            turns.append(_Turn(_captured(turn), begin, end))
            yield turns[-1].captured, turn[1]
        if not turns:
            raise FileError(f"Expected a turn of a Velodyne scanner in {self.path}, got none. Was it recorded whole?")
        self._turns = turns

    def _known(self, stream: Any, start: int) -> Iterator[tuple[int, Any]]:
        """Decode the turns captured at `start` or later, each from its own packets."""
        header = stream.read(HEADER_BYTES)
        for turn in self._turns:
            if turn.captured >= start:
                stream.seek(turn.begin)
                own = io.BytesIO(header + stream.read(turn.end - turn.begin))
                packets = [(t, data) for t, data in self._package.util.iter_pcap(own) if len(data) == PACKET_BYTES]
                yield turn.captured, _decoded(self._package, packets, self._config)[1]


def record_of_packets(content: Any, stamp: int) -> CloudRecord:
    """Return the points of a velodyne_msgs/VelodyneScan message; their time is that of its last packet.

    `stamp` is the time of the message, ns, for packets without a time of their own.
    """
    package = _decoder_package(None)
    if not len(content.packets):
        raise FileError("Expected packets in a VelodyneScan, got none. Leave this message out.")
    times = [packet.stamp.sec + packet.stamp.nanosec * 1e-9 or stamp * 1e-9 for packet in content.packets]
    turn = _decoded(package, zip(times, (packet.data for packet in content.packets), strict=True), package.Config())
    return _record_of_points(turn[1], _captured(turn))


def topics_of_capture(path: Path) -> tuple[Topic, ...]:
    """Return the ports of a capture as topics: kind and number of packets."""
    seen = Counter(_datagrams(path))
    return tuple(
        Topic(f"port {port}", f"{n_bytes} bytes{_kind(n_bytes)}", n) for (port, n_bytes), n in sorted(seen.items())[:20]
    )


def _kind(n_bytes: int) -> str:
    if n_bytes == PACKET_BYTES:
        return ": returns of a Velodyne"
    return ": position of a Velodyne's receiver" if n_bytes in POSITION_BYTES else ""


def _datagrams(path: Path) -> Iterator[tuple[int, int]]:
    """Yield port and bytes of payload (of the whole, if IP has split it) of the UDP packets of a capture."""
    try:
        import dpkt
    except ImportError as error:
        raise as_extra_missing(path, "dpkt") from error
    with as_file_error(path, "a capture of packets (.pcap)"), path.open("rb") as stream:
        for _, data in dpkt.pcap.Reader(stream):
            try:
                packet = dpkt.ethernet.Ethernet(data).data.data
            except (dpkt.dpkt.UnpackError, AttributeError):
                continue
            if isinstance(packet, dpkt.udp.UDP):
                yield packet.dport, max(packet.ulen - 8, 0)


def _decoded(package: Any, packets: Iterable[tuple[float, bytes]], config: Any) -> Any:
    """Decode the packets of one turn: its time and a structured array of points."""
    vector = package.PacketVector()
    for time, data in packets:
        vector.append(package.VelodynePacket(float(time), data))
    return package.ScanDecoder(config).decode(vector, as_pcl_structs=True)


def _captured(turn: Any) -> int:
    return round(float(turn[0].host) * 1e9)


def _record_of_points(points: Any, stamp: int) -> CloudRecord:
    """A structured array of points, shape (n,), as a PointCloud2 record of time `stamp` (ns)."""
    places = points.dtype.fields
    fields = tuple(FieldDescription(name, place[1], CODES[place[0].str[1:]]) for name, place in places.items())
    step = points.dtype.itemsize
    data = np.ascontiguousarray(points).view(np.uint8)
    return CloudRecord(fields, len(points), 1, step, step * len(points), False, data, stamp)


def _decoder_package(path: Path | None) -> Any:
    try:
        import velodyne_decoder
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package velodyne-decoder to read {path or 'packets of a Velodyne'}, got none installed."
            " pip install 'maxcon[velodyne]'"
        ) from error
    return velodyne_decoder
