# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Places: the points of all rounds, sorted into squares on disk, so that memory does not grow with the clouds."""

from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["PLACE_EDGE", "PLACE_RECORD", "PlaceKey", "Places"]

PLACE_EDGE = 24.0
"""Of the squares in which rounds are matched, m: walls on both sides of a street, ground, and what stands on it."""
PLACE_RECORD = np.dtype([("time", "<f8"), ("round", "<i2"), ("inside", "<f4", 3)])
"""One point: its time (s), the number of its round, and where it lies from the middle of its place (m)."""
MOST_POINTS = 4_000_000
"""Of a place in memory, 90 MB; of more, every n-th is taken."""
BUFFER_BYTES = 128 * 2**20
PlaceKey = tuple[int, int]


class Places:
    """Sorts points into places, a file each, 22 bytes a point.

    Parameters
    ----------
    folder : Path
        An empty folder for the files; the caller removes it.
    origin : array, shape (3,)
        Where places are counted from, global, m.
    """

    def __init__(self, folder: Path, origin: NDArray[np.float64]) -> None:
        self._folder = folder
        self._origin = origin
        self._buffers: dict[PlaceKey, list[NDArray[np.void]]] = defaultdict(list)
        self._buffered_bytes = 0
        self._counts: dict[PlaceKey, int] = defaultdict(int)

    @property
    def keys(self) -> list[PlaceKey]:
        """Places that got points, sorted."""
        return sorted(self._counts)

    def middle(self, key: PlaceKey) -> NDArray[np.float64]:
        """Middle of a place, shape (3,), global, m."""
        return self._origin + [(key[0] + 0.5) * PLACE_EDGE, (key[1] + 0.5) * PLACE_EDGE, 0.0]

    def add(
        self, points: NDArray[np.float64], times: NDArray[np.float64], rounds: NDArray[np.integer]
    ) -> None:
        """Take points, shape (n, 3), global, m, with their times, s, and the numbers of their rounds."""
        if not len(points):
            return
        local = points - self._origin
        keys = np.floor(local[:, :2] / PLACE_EDGE).astype(np.int64)
        order = np.lexsort((keys[:, 1], keys[:, 0]))
        sorted_keys = keys[order]
        is_first = np.ones(len(order), bool)
        is_first[1:] = (sorted_keys[1:] != sorted_keys[:-1]).any(axis=1)
        records = np.empty(len(points), PLACE_RECORD)
        records["time"], records["round"] = times, rounds
        local[:, :2] -= (keys + 0.5) * PLACE_EDGE
        records["inside"] = local
        for group in np.split(order, np.flatnonzero(is_first)[1:]):
            x, y = keys[group[0]].tolist()
            self._buffers[x, y].append(records[group])
        self._buffered_bytes += records.nbytes
        if self._buffered_bytes > BUFFER_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write out what is buffered."""
        for key, parts in self._buffers.items():
            with self._path(key).open("ab") as file:
                for part in parts:
                    file.write(part.tobytes())
                    self._counts[key] += len(part)
        self._buffers.clear()
        self._buffered_bytes = 0

    def records(self, key: PlaceKey) -> NDArray[np.void]:
        """Points of a place (`PLACE_RECORD`), in the order they came; every n-th where there are too many."""
        every = -(-self._counts[key] // MOST_POINTS)
        mapped = np.memmap(self._path(key), PLACE_RECORD, mode="r")
        return np.array(mapped[::every])

    def remove(self) -> None:
        """Delete all files."""
        for key in self._counts:
            self._path(key).unlink()
        self._counts.clear()

    def _path(self, key: PlaceKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.points"
