# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Packets of Ouster scanners in packet captures, decoded by ouster-sdk."""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.recordings.captures import metadata_beside
from maxcon.io.recordings.point_cloud2 import CloudRecord
from maxcon.io.recordings.turns import TurnsOfCapture, record_of_points

__all__ = ["OusterCapture"]

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")])
RETURNS = ("RANGE", "RANGE2")


class OusterCapture(TurnsOfCapture):
    """The packets of one Ouster scanner, with its metadata (.json) beside the capture; first and second returns.

    Notes
    -----
    Points are in Ouster's sensor frame, m: x points away from the cable. The time of a turn is that at which its first
    packet was captured; times of points are those of the scanner's clock, which may count from its start.
    """

    kind = "a capture of an Ouster's packets"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        metadata = metadata_beside(path)
        if metadata is None:
            raise FileError(
                f"Expected the metadata of an Ouster beside {path}, {path.stem}.json, got none. Save it from the"
                " scanner, or record its point cloud as a bag or MCAP."
            )
        self._metadata = metadata
        self._sdk()

    def _sdk(self) -> tuple[Any, Any]:
        """Return `open_source`, which opens a capture, and `XYZLut`, which turns ranges into points."""
        try:
            from ouster.sdk import open_source
            from ouster.sdk.core import XYZLut
        except ImportError as error:
            raise MissingExtraError(
                f"Expected the package ouster-sdk to read {self.path}, got none installed. pip install --no-deps"
                " ouster-sdk more-itertools, or convert it to a bag or MCAP"
            ) from error
        return open_source, XYZLut

    def _turns(self) -> Generator[tuple[int, Callable[[], CloudRecord]]]:
        open_source, table = self._sdk()
        source = open_source(str(self.path), meta=[str(self._metadata)], collate=False, index=False)
        to_points = table(source.sensor_info[0], False)
        for turns in source:
            if len(turns) and turns[0] is not None:
                stamp = _stamp(turns[0])
                yield stamp, partial(_as_record, turns[0], to_points, stamp)

    def _without_turns(self) -> str:
        return f"Expected packets that {self._metadata.name} fits in {self.path}, got none. Is it another scanner's?"


def _stamp(turn: Any) -> int:
    """When the first packet of a turn was captured, ns."""
    captured = np.asarray(turn.packet_timestamp)
    return int(captured[captured > 0].min(initial=np.iinfo(np.int64).max)) if captured.any() else 0


def _as_record(turn: Any, to_points: Any, stamp: int) -> CloudRecord:
    """Return the first and second returns of a turn (a LidarScan of ouster-sdk) as one record."""
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
    return record_of_points(records, stamp)
