# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""RawScan: the returns of one epoch; Scans: those of a drive, wherever they come from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.scan.normals import Viewpoints


@dataclass(frozen=True, slots=True, eq=False)
class RawScan:
    """The points of one epoch as they stand in a file, without those that are no returns or out of range.

    Parameters
    ----------
    points : array, shape (n, 3), float64
        Sensor frame, m. May be empty.
    time : float
        Time of the scan, s.
    name : str
        Name of the file.
    n_returns : int
        Points in the file.
    n_dropped_invalid : int
        Points at (0, 0, 0) (no return) or with NaN or infinite coordinates.
    n_dropped_range : int
        Points nearer than the smallest or farther than the largest range.
    n_dropped_duplicates : int
        Points with the same coordinates as another; only those of recordings are checked.
    point_times : array, shape (n,), or None
        When each point was measured, s after `time`; None where that is not known.
    viewpoints : Viewpoints or None
        Where each point was measured from, if there are several scanners; points are in the vehicle's frame then.
    """

    points: NDArray[np.float64]
    time: float
    name: str
    n_returns: int
    n_dropped_invalid: int
    n_dropped_range: int
    n_dropped_duplicates: int = 0
    point_times: NDArray[np.float64] | None = None
    viewpoints: Viewpoints | None = None


class Scans(ABC):
    """Scans of one drive in order of time; each is read when asked for."""

    __slots__ = ()

    times: NDArray[np.float64]
    """Times of the scans, shape (n,), s, strictly increasing."""

    @abstractmethod
    def name(self, i: int) -> str:
        """Return the name of scan number `i`."""

    @abstractmethod
    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`, counted from 0; FileError if it is broken.

        Points nearer than `min_range` or farther than `max_range` (m) are dropped: nearer than 1 m is mostly the
        vehicle. OptionError if not 0 <= min_range < max_range.
        """

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self.times)

    def scans(self, min_range: float = 1.0, max_range: float = 120.0) -> Iterator[RawScan]:
        """Yield all scans in order of time; parameters and errors as of `read`."""
        for i in range(len(self)):
            yield self.read(i, min_range, max_range)


def check_range(min_range: float, max_range: float) -> None:
    """Refuse range limits that leave nothing: OptionError if not 0 <= min_range < max_range (m)."""
    if not 0.0 <= min_range < max_range:
        raise OptionError(
            f"Expected 0 <= min_range < max_range, got {min_range} m and {max_range} m. The defaults are 1 and 120 m."
        )


def returns_in_range(points: NDArray[np.float64], min_range: float, max_range: float) -> tuple[NDArray[np.bool_], int]:
    """Return which points are returns within the range (m), shape (n,), and how many are returns at all.

    A return is finite, and not at (0, 0, 0). OptionError if not 0 <= min_range < max_range.
    """
    check_range(min_range, max_range)
    x, y, z = points.T
    with np.errstate(over="ignore"):
        squared = x * x
        squared += y * y
        squared += z * z
    is_return = (squared > 0.0) & (squared < np.inf)
    # Squares leave the range of float64 before coordinates do: points that seem to be no returns are checked exactly.
    rows = np.flatnonzero(~is_return)
    is_return[rows] = np.isfinite(points[rows]).all(axis=1) & points[rows].any(axis=1)
    ranges = np.sqrt(squared)
    return is_return & (ranges >= min_range) & (ranges <= max_range), int(np.count_nonzero(is_return))


def nearest_in_time(times: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the increasing time nearest to each wanted one, shape (n,); at ties the earlier."""
    after = np.searchsorted(times, wanted).clip(max=len(times) - 1)
    before = (after - 1).clip(min=0)
    return np.where(wanted - times[before] <= times[after] - wanted, before, after)
