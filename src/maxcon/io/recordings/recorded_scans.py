# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scans of a recording, in order of time."""

import threading
import weakref
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon.errors import FileError
from maxcon.io.raw_scan import RawScan, Scans, scan_within
from maxcon.io.recordings.clouds import CloudSource, RecordedCloud


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
    def _index(self) -> _Index:
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
            if self._progress is not None:
                self._progress("finding times", len(times), max(self.source.n_clouds, len(times)))
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
        with self._lock:
            cloud = self._cloud(int(self._index.rows[i]))
        time = float(self.times[i])
        return scan_within(cloud.points(), cloud.stamp / 1e9, time, self.name(i), min_range, max_range)

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
