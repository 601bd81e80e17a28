# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packets of Velodyne scanners, in bags and in packet captures, decoded by velodyne-decoder."""

from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.recordings.point_cloud2 import CloudRecord
from maxcon.io.recordings.turns import TurnsOfCapture, record_of_points

__all__ = ["VelodyneCapture", "record_of_packets"]


class VelodyneCapture(TurnsOfCapture):
    """The packets of a Velodyne scanner.

    Notes
    -----
    Times are those at which the packets were captured: the scanner's own clock counts from the full hour, and is set
    only where a GNSS receiver is connected.
    """

    kind = "a capture of a Velodyne's packets"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        _decoder_package(path)

    def _turns(self) -> Generator[tuple[int, Callable[[], CloudRecord]]]:
        package = _decoder_package(self.path)
        for stamp, points in package.read_pcap(str(self.path), as_pcl_structs=True):
            captured = round(stamp.host * 1e9)
            yield captured, partial(record_of_points, points, captured)

    def _without_turns(self) -> str:
        return (
            f"Expected packets of a Velodyne scanner in {self.path}, got none, but perhaps another scanner's."
            " Record that one's point cloud as a bag or MCAP."
        )


def record_of_packets(content: Any, stamp: int) -> CloudRecord:
    """Return the points of a velodyne_msgs/VelodyneScan message; their time is that of its last packet.

    Parameters
    ----------
    content : message
        As rosbags decodes it.
    stamp : int
        Time of the message, ns, for packets without a time of their own.

    Raises
    ------
    FileError
        If it has no packets.
    MissingExtraError
        If the extra `velodyne` is not installed.
    """
    package = _decoder_package(None)
    packets = package.PacketVector()
    for packet in content.packets:
        host = packet.stamp.sec + packet.stamp.nanosec * 1e-9
        packets.append(package.VelodynePacket(host or stamp * 1e-9, packet.data))
    if not len(packets):
        raise FileError("Expected packets in a VelodyneScan, got none. Leave this message out.")
    time, points = package.ScanDecoder(package.Config()).decode(packets, as_pcl_structs=True)
    return record_of_points(points, round(time.host * 1e9))


def _decoder_package(path: Path | None) -> Any:
    try:
        import velodyne_decoder
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package velodyne-decoder to read {path or 'packets of a Velodyne'}, got none installed."
            " pip install 'maxcon[velodyne]'"
        ) from error
    return velodyne_decoder
