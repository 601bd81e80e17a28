# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Turns of a scanner in a packet capture (.pcap): what the readers of all makers share."""

from abc import abstractmethod
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.clouds.base import as_file_error
from maxcon.io.recordings.point_cloud2 import FORMATS, CloudRecord, FieldDescription
from maxcon.io.recordings.recorded_cloud import CloudSource, RecordedCloud

__all__ = ["TurnsOfCapture", "record_of_points"]

CODES = {name: code for code, name in FORMATS.items()}


class TurnsOfCapture(CloudSource):
    """A capture with the packets of one scanner; each cloud is one turn of it.

    Parameters
    ----------
    path : Path
        The .pcap file.
    """

    kind: str
    """What the file should be, in the words of an error."""

    def __init__(self, path: Path) -> None:
        self.path, self.label = path, path.name
        self._running: list[Generator[RecordedCloud]] = []

    @abstractmethod
    def _turns(self) -> Generator[tuple[int, Callable[[], CloudRecord]]]:
        """Yield of each turn when it was captured (ns), and what makes its record: not called for turns left out."""

    @abstractmethod
    def _without_turns(self) -> str:
        """Words of the error about a capture without a single turn."""

    def clouds(self, start: int | None = None) -> Generator[RecordedCloud]:
        """Yield the turns in the order of their capture; those before `start` (ns) are decoded, too, and left out."""
        running = self._clouds(start)
        self._running.append(running)
        return running

    def _clouds(self, start: int | None) -> Generator[RecordedCloud]:
        n_turns = 0
        with as_file_error(self.path, self.kind):
            for captured, make_record in self._turns():
                n_turns += 1
                if start is None or captured >= start:
                    yield RecordedCloud(self.label, captured, captured, make_record())
        if not n_turns:
            raise FileError(self._without_turns())

    def close(self) -> None:
        """End all iterations, which closes the file."""
        while self._running:
            self._running.pop().close()


def record_of_points(points: NDArray[np.void], stamp: int) -> CloudRecord:
    """Return a structured array of points, shape (n,), as a PointCloud2 record of time `stamp` (ns)."""
    places: Any = points.dtype.fields
    fields = tuple(FieldDescription(name, place[1], CODES[place[0].str[1:]]) for name, place in places.items())
    step = points.dtype.itemsize
    data = np.ascontiguousarray(points).view(np.uint8)
    return CloudRecord(fields, len(points), 1, step, step * len(points), False, data, stamp)
