# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packets of Velodyne scanners, in bags and in packet captures, through velodyne-decoder."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.cloud_sources import CloudSource, RecordedCloud
from maxcon.io.recordings.point_cloud2 import FORMATS, CloudRecord, FieldDescription

__all__ = ["PacketCapture", "record_of_packets"]

CODES = {name: code for code, name in FORMATS.items()}


class PacketCapture(CloudSource):
    """A .pcap with the packets of a Velodyne scanner; one cloud is a turn.

    Notes
    -----
    Times are those at which the packets were captured: the scanner's own clock knows but the hour, and that only
    with a GNSS receiver.
    """

    kind = "a capture of a Velodyne's packets"

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self._running: list[Generator[RecordedCloud]] = []
        _decoder_package(path)

    def clouds(self, start: int | None = None) -> Generator[RecordedCloud]:
        """Yield the turns in the order of their recording; those before a time (ns) are decoded, too."""
        running = self._turns(start)
        self._running.append(running)
        return running

    def _turns(self, start: int | None) -> Generator[RecordedCloud]:
        package = _decoder_package(self.path)
        n_turns = 0
        with as_file_error(self.path, self.kind):
            for stamp, points in package.read_pcap(str(self.path), as_pcl_structs=True):
                n_turns += 1
                recorded = round(stamp.host * 1e9)
                if start is None or recorded >= start:
                    yield RecordedCloud(self.label, recorded, recorded, _as_record(points, recorded))
        if not n_turns:
            raise FileError(
                f"Expected packets of a Velodyne scanner in {self.path}, got none, but perhaps another scanner's."
                " Record that one's point cloud as a bag or MCAP."
            )

    def close(self) -> None:
        """End all iterations, which closes the file."""
        while self._running:
            self._running.pop().close()


def record_of_packets(content: Any, stamp: int) -> CloudRecord:
    """Return the cloud of a VelodyneScan; its time is that of its last packet.

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
    return _as_record(points, round(time.host * 1e9))


def _decoder_package(path: Path | None) -> Any:
    try:
        import velodyne_decoder
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package velodyne-decoder to read {path or 'packets of a Velodyne'}, got none installed."
            " pip install 'maxcon[velodyne]'"
        ) from error
    return velodyne_decoder


def _as_record(points: NDArray[np.void], stamp: int) -> CloudRecord:
    """What the package returns, to be decoded as any other cloud."""
    places: Any = points.dtype.fields
    fields = tuple(
        FieldDescription(name, place[1], CODES[place[0].str[1:]]) for name, place in places.items()
    )
    step = points.dtype.itemsize
    data = np.ascontiguousarray(points).view(np.uint8)
    return CloudRecord(fields, len(points), 1, step, step * len(points), False, data, stamp)
