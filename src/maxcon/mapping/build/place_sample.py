# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PlaceSample: all points of some places, with their times, so that passes can be compared there."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["PLACE_EDGE", "PlaceSample"]

PLACE_EDGE = 0.5
"""Of the cubes that are the places, m: a piece of wall, seen in one pass by some hundred points."""
MOST_POINTS = 500_000
"""14 MB."""

RECORD = np.dtype([("place", "<u8"), ("inside", "<f4", 3), ("time", "<f8")])
"""One point: the number of its place, where it lies from the place's middle (m), and its time (s)."""


class PlaceSample:
    """Takes points in any order and keeps those of an even sample of the places; memory does not grow with the input.

    Parameters
    ----------
    most_points : int
        Kept at most. While there are more, every other place is forgotten: which ones is a matter of where
        they are, and neither of the order of the points nor of the files.
    """

    def __init__(self, most_points: int = MOST_POINTS) -> None:
        self._most_points = most_points
        self._n_halvings = 0
        self._parts: list[NDArray[np.void]] = []
        self._n_points = 0

    def add(self, points: NDArray[np.float64], times: NDArray[np.float64] | None) -> None:
        """Take points with their times; points without a finite time are left out.

        Parameters
        ----------
        points : array, shape (n, 3)
            Local frame, finite, m.
        times : array, shape (n,), or None
            On any clock that all points share, s.
        """
        if times is None or not len(points):
            return
        from maxcon.mapping.build.pass_kernels import place_keys

        keys = np.empty(len(points), np.uint64)
        place_keys(np.ascontiguousarray(points), PLACE_EDGE, keys)
        chosen = np.flatnonzero(self._is_chosen(keys) & np.isfinite(times))
        records = np.empty(len(chosen), RECORD)
        records["place"], records["time"] = keys[chosen], times[chosen]
        records["inside"] = points[chosen] % PLACE_EDGE - 0.5 * PLACE_EDGE
        self._parts.append(records)
        self._n_points += len(records)
        while self._n_points > self._most_points:
            self._n_halvings += 1
            self._parts = [part[self._is_chosen(part["place"])] for part in self._parts]
            self._n_points = sum(map(len, self._parts))

    def records(self) -> NDArray[np.void]:
        """Return the points that are kept (`RECORD`), place by place, in the order of their times."""
        records = np.concatenate([np.empty(0, RECORD), *self._parts])
        return records[np.lexsort((records["time"], records["place"]))]

    def _is_chosen(self, places: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Whether a place belongs to the sample: half of them for each halving."""
        chosen: NDArray[np.bool_] = (places & np.uint64((1 << self._n_halvings) - 1)) == 0
        return chosen
