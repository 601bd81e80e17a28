# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packet captures (.pcap): their UDP packets, and which maker's scanner these come from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from enum import Enum
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from maxcon.errors import FileError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.base import Topic, as_extra_missing

__all__ = ["Maker", "datagrams", "maker_of", "metadata_beside", "topics_of_capture"]

VELODYNE_BYTES, POSITION_BYTES = 1206, (512, 554)
"""Bytes of a Velodyne's data packets, and of those with the position of its GNSS receiver."""
OUSTER_PORTS = (7502, 7503)
LOOKED_AT = 2000
"""Datagrams that are read to find the maker."""


class Maker(Enum):
    """Makers of scanners whose packets are read."""

    VELODYNE = "Velodyne"
    OUSTER = "Ouster"


class Datagram(NamedTuple):
    """A UDP packet: time of capture (s), port it was sent to, bytes of payload (of the whole, if IP has split it)."""

    time: float
    port: int
    n_bytes: int


def datagrams(path: Path) -> Iterator[Datagram]:
    """Yield the UDP packets of a capture in its order.

    Raises
    ------
    FileError
        If it is no capture.
    MissingExtraError
        If the extra `recordings` is not installed.
    """
    try:
        import dpkt
    except ImportError as error:
        raise as_extra_missing(path, "dpkt") from error
    with as_file_error(path, "a capture of packets (.pcap)"), path.open("rb") as stream:
        for time, data in dpkt.pcap.Reader(stream):
            try:
                inside = dpkt.ethernet.Ethernet(data).data
                packet = inside.data
            except (dpkt.dpkt.UnpackError, AttributeError):
                continue
            if isinstance(packet, dpkt.udp.UDP):
                yield Datagram(float(time), packet.dport, max(packet.ulen - 8, 0))


def maker_of(path: Path) -> Maker:
    """Return the maker of the scanner in a capture, from the first packets.

    Raises
    ------
    FileError
        If it is no capture, or they are neither a Velodyne's nor an Ouster's; errors as of `datagrams` besides.
    """
    seen = Counter((one.port, one.n_bytes) for one in islice(datagrams(path), LOOKED_AT))
    if any(n_bytes == VELODYNE_BYTES for _, n_bytes in seen):
        return Maker.VELODYNE
    if any(port in OUSTER_PORTS for port, _ in seen) or (seen and metadata_beside(path) is not None):
        return Maker.OUSTER
    listed = ", ".join(f"{n} of {size} bytes to port {port}" for (port, size), n in seen.most_common(3))
    raise FileError(
        f"Expected packets of a Velodyne or an Ouster in {path}, got {listed or 'no UDP packets'}. Record that"
        " scanner's point cloud as a bag or MCAP."
    )


def metadata_beside(path: Path) -> Path | None:
    """Return the metadata of an Ouster beside a capture: of the .json that its name begins with, the longest name."""
    beside = [file for file in path.parent.glob("*.json") if path.stem.startswith(file.stem)]
    return max(beside, key=lambda file: len(file.stem), default=None)


def topics_of_capture(path: Path) -> tuple[Topic, ...]:
    """Return the ports of a capture as topics: kind and number of packets; errors as of `datagrams`."""
    seen = Counter((one.port, one.n_bytes) for one in datagrams(path))
    return tuple(Topic(f"port {port}", _kind(port, n_bytes), n) for (port, n_bytes), n in sorted(seen.items())[:20])


def _kind(port: int, n_bytes: int) -> str:
    if n_bytes == VELODYNE_BYTES:
        return f"{n_bytes} bytes: returns of a Velodyne"
    if n_bytes in POSITION_BYTES:
        return f"{n_bytes} bytes: position of a Velodyne's receiver"
    if port in OUSTER_PORTS:
        return f"{n_bytes} bytes: {'returns' if port == OUSTER_PORTS[0] else 'motion'} of an Ouster"
    return f"{n_bytes} bytes"
