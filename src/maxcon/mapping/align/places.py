# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Places: the points of all rounds, sorted into squares on disk, so that memory does not grow with the clouds."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.spill import TileFiles

__all__ = ["PLACE_EDGE", "PLACE_RECORD", "PlaceKey", "Places"]

PLACE_EDGE = 24.0
"""Edge of the squares in which rounds are matched, m: both sides of a street fit in."""
PLACE_RECORD = np.dtype([("time", "<f8"), ("round", "<i2"), ("inside", "<f4", 3)])
"""One point: its time (s), the number of its round, and where it lies from the middle of its place (m)."""
MOST_POINTS = 4_000_000
"""Points of a place in memory, 90 MB; of more, every n-th is taken."""
PlaceKey = tuple[int, int]


class Places(TileFiles):
    """Sorts points into places, 22 bytes a point.

    Parameters
    ----------
    folder : Path
        A folder for the files; the caller removes it.
    origin : array, shape (3,)
        Corner of place (0, 0), global, m.
    """

    def __init__(self, folder: Path, origin: NDArray[np.float64]) -> None:
        super().__init__(folder, PLACE_RECORD, "points")
        self._origin = origin

    def middle(self, key: PlaceKey) -> NDArray[np.float64]:
        """Middle of a place at the height of the origin, shape (3,), global, m."""
        return self._origin + [(key[0] + 0.5) * PLACE_EDGE, (key[1] + 0.5) * PLACE_EDGE, 0.0]

    def add(self, points: NDArray[np.float64], times: NDArray[np.float64], rounds: NDArray[np.integer]) -> None:
        """Take points, shape (n, 3), global, m, with their times (s) and the numbers of their rounds, (n,) each."""
        if not len(points):
            return
        inside = points - self._origin
        keys = np.floor(inside[:, :2] / PLACE_EDGE).astype(np.int32)
        inside[:, :2] -= (keys + 0.5) * PLACE_EDGE
        records = np.empty(len(points), PLACE_RECORD)
        records["time"], records["round"], records["inside"] = times, rounds, inside
        self._put(keys, records)

    def points(self, key: PlaceKey) -> NDArray[np.void]:
        """Points of a place (`PLACE_RECORD`) in the order they came; every n-th where there are too many."""
        every = -(-sum(len(part) for part in self.records(key)) // MOST_POINTS)
        parts = self.records(key, every * (MOST_POINTS // every))  # each begins with one that is taken
        return np.concatenate([part[::every] for part in parts])
