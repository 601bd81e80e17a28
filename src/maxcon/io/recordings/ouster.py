# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packets of Ouster scanners in captures, through ouster-sdk."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.captures import metadata_beside
from maxcon.io.recordings.cloud_sources import CloudSource, RecordedCloud
from maxcon.io.recordings.point_cloud2 import CloudRecord, FieldDescription

__all__ = ["OusterCapture"]

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")])
CODES = {"<f4": 7, "<f8": 8, "<u2": 4}
RETURNS = ("RANGE", "RANGE2")


class OusterCapture(CloudSource):
    """A .pcap with the packets of one Ouster, and its metadata (.json) beside; one cloud is a turn, all its returns.

    Notes
    -----
    The axes are the sensor's: x away from the cable. A cloud has the time at which its first packet was captured; its
    points' times are those of the scanner's clock, whatever that counts from.
    """

    kind = "a capture of an Ouster's packets"

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self._running: list[Generator[RecordedCloud]] = []
        metadata = metadata_beside(path)
        if metadata is None:
            raise FileError(
                f"Expected the metadata of an Ouster beside {path}, {path.stem}.json, got none. Save it from the"
                " scanner, or record its point cloud as a bag or MCAP."
            )
        self._metadata = metadata
        self._sdk()

    def _sdk(self) -> tuple[Any, Any]:
        """What opens a capture, and what makes points of ranges."""
        try:
            from ouster.sdk import open_source
            from ouster.sdk.core import XYZLut
        except ImportError as error:
            raise MissingExtraError(
                f"Expected the package ouster-sdk to read {self.path}, got none installed. pip install --no-deps"
                " ouster-sdk more-itertools, or convert it to a bag or MCAP"
            ) from error
        return open_source, XYZLut

    def clouds(self, start: int | None = None) -> Generator[RecordedCloud]:
        """Yield the turns in the order of their recording; those before a time (ns) are decoded, too."""
        running = self._turns(start)
        self._running.append(running)
        return running

    def _turns(self, start: int | None) -> Generator[RecordedCloud]:
        open_source, table = self._sdk()
        n_turns = 0
        with as_file_error(self.path, self.kind):
            source = open_source(str(self.path), meta=[str(self._metadata)], collate=False, index=False)
            to_points = table(source.sensor_info[0], False)
            for turns in source:
                if not len(turns) or turns[0] is None:
                    continue
                n_turns += 1
                stamp = _stamp(turns[0])
                if start is None or stamp >= start:
                    yield RecordedCloud(self.label, stamp, stamp, _as_record(turns[0], to_points, stamp))
        if not n_turns:
            raise FileError(
                f"Expected packets that {self._metadata.name} fits in {self.path}, got none. Is it another scanner's?"
            )

    def close(self) -> None:
        """End all iterations, which closes the file."""
        while self._running:
            self._running.pop().close()


def _stamp(turn: Any) -> int:
    """When the first packet of a turn was captured, ns."""
    captured = np.asarray(turn.packet_timestamp)
    return int(captured[captured > 0].min(initial=np.iinfo(np.int64).max)) if captured.any() else 0


def _as_record(turn: Any, to_points: Any, stamp: int) -> CloudRecord:
    """The returns of a turn, to be decoded as any other cloud."""
    seconds = np.asarray(turn.timestamp, dtype=np.float64) * 1e-9
    parts: list[NDArray[np.void]] = []
    for name in RETURNS:
        if name not in {str(field) for field in turn.fields}:
            continue
        ranges = np.asarray(turn.field(name))
        rings, columns = np.nonzero(ranges)
        points = np.asarray(to_points(ranges))[rings, columns]
        part = np.empty(len(rings), dtype=POINT)
        for axis, coordinate in enumerate("xyz"):
            part[coordinate] = points[:, axis]
        part["ring"], part["timestamp"] = rings, seconds[columns]
        parts.append(part)
    records = np.concatenate(parts) if parts else np.empty(0, dtype=POINT)
    places: Any = POINT.fields
    fields = tuple(FieldDescription(name, place[1], CODES[place[0].str]) for name, place in places.items())
    step = POINT.itemsize
    return CloudRecord(
        fields, len(records), 1, step, step * len(records), False, records.view(np.uint8), stamp
    )
