"""Scans of a drive, wherever they come from, the returns of each, and scans that are deskewed or merged of others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, OptionError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.io.point_records import CloudPoints
from maxcon.scan.deskew import deskew, times_of_turn
from maxcon.scan.scan import Viewpoints
from maxcon.scan.trajectory import Trajectory

LONELY_GAP = 0.1  # where the first scanner has a single scan: largest distance in time to scans of the others, s


@dataclass(frozen=True, slots=True, eq=False)
class RawScan:
    """The points of one epoch as they stand in a file, without those that are no returns or out of range.

    - points: shape (n, 3), float64; sensor frame, m. May be empty.
    - time: time of the scan, s. name: of the file. n_returns: points in it.
    - n_dropped_invalid: points at (0, 0, 0) (no return) or with NaN or infinite coordinates.
    - n_dropped_range: points nearer than the smallest or farther than the largest range.
    - n_dropped_duplicates: points with the same coordinates as another; only those of recordings are checked.
    - point_times: shape (n,); when each point was measured, s after `time`; None where that is not known.
    - viewpoints: of several scanners, whose points are in the vehicle's frame: where each was measured from.
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

    def __repr__(self) -> str:
        return f"RawScan({self.name}, {len(self.points)} points, time={self.time!r})"


class Scans(ABC):
    """Scans of one drive in order of time; each is read when asked for."""

    __slots__ = ()

    times: NDArray[np.float64]
    """Times of the scans, shape (n,), s, strictly increasing."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} scans)"

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
    """OptionError if not 0 <= min_range < max_range (m)."""
    if not 0.0 <= min_range < max_range:
        raise OptionError(f"Expected 0 <= min_range < max_range, got {min_range} m and {max_range} m. Usual: 1, 120 m.")


def scan_within(cloud: CloudPoints, stamp: float, time: float, name: str, *limits: float) -> RawScan:
    """Return the returns of a cloud within limits of range (m) as a scan at `time`; its own time is `stamp`, s."""
    min_range, max_range = limits
    check_range(min_range, max_range)
    x, y, z = cloud.points.T
    with np.errstate(over="ignore"):
        ranges = np.sqrt(x * x + y * y + z * z)
    kept, offsets = np.flatnonzero((ranges >= min_range) & (ranges <= max_range)), cloud.times.offsets
    counts = cloud.n_points, cloud.n_invalid, len(cloud.points) - len(kept), cloud.n_duplicates
    point_times = None if offsets is None else offsets.take(kept) - (time - stamp)
    return RawScan(cloud.points.take(kept, axis=0), time, name, *counts, point_times)


def nearest_in_time(times: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the increasing time nearest to each wanted one, shape (n,); at ties the earlier."""
    after = np.searchsorted(times, wanted).clip(max=len(times) - 1)
    before = (after - 1).clip(min=0)
    return np.where(wanted - times[before] <= times[after] - wanted, before, after)


class DeskewedScans(Scans):
    """Scans whose points have times, deskewed by a motion, T_fixed_sensor in any fixed frame, when they are read.

    turn_time: s, of scans without such times, clockwise seen from above; their time is the middle, which looks forward.
    """

    def __init__(self, scans: Scans, motion: Trajectory, max_gap: float = 0.5, turn_time: float | None = None) -> None:
        self._scans, self._motion, self._max_gap, self._turn_time = scans, motion, max_gap, turn_time
        self.times = scans.times

    def name(self, i: int) -> str:
        """Return the name of scan number `i`."""
        return self._scans.name(i)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`, deskewed; range limits apply to the ranges as measured."""
        raw = self._scans.read(i, min_range, max_range)
        offsets = raw.point_times
        if offsets is None and self._turn_time is not None:
            offsets = times_of_turn(raw.points, self._turn_time)
        if offsets is None:
            raise FileError(
                f"Expected a time for each point of {raw.name}, to deskew it, got none that is understood"
                " (maxcon scans info). If it is a turn of a spinning scanner, say how long that takes: --turn-time."
            )
        try:
            points = deskew(raw.points, offsets + raw.time, self._motion, raw.time, self._max_gap)
        except TrajectoryError as error:
            raise FileError(f"{raw.name}: {error}") from error
        return replace(raw, points=points, point_times=offsets)


class MergedScans(Scans):
    """Scans of several scanners at T_vehicle_sensor, in the vehicle's frame: each of the first with the nearest."""

    def __init__(self, scanners: Sequence[Scans], poses: Sequence[Pose], names: Sequence[str]) -> None:
        self.scanners, self.poses, self.names = tuple(scanners), tuple(poses), tuple(names)

    @property
    def times(self) -> NDArray[np.float64]:  # type: ignore[override]
        """Times of the first scanner's scans, shape (n,), s, strictly increasing."""
        return self.scanners[0].times

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        """Which scan of each scanner belongs to each epoch, shape (n, n_scanners); -1 where none does."""
        times = self.times
        reach = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else LONELY_GAP
        rows = np.empty((len(times), len(self.scanners)), dtype=np.int64)
        for number, scans in enumerate(self.scanners):
            own = scans.times
            nearest = nearest_in_time(own, times)
            rows[:, number] = np.where(np.abs(own[nearest] - times) <= reach, nearest, -1)
            if (rows[:, number] < 0).all():
                raise FileError(
                    f"Expected scans of the scanner {self.names[number]} within {reach:.3f} s of those of"
                    f" {self.names[0]}, got none: {own[0]:.3f} to {own[-1]:.3f} s and {times[0]:.3f} to"
                    f" {times[-1]:.3f} s. Do both use the same clock?"
                )
        return rows

    @property
    def words(self) -> str:
        """How many scans of each scanner were matched, and how far apart they are, in a line."""
        parts = []
        for number, (name, scans) in enumerate(zip(self.names, self.scanners, strict=True)):
            rows = self._rows[:, number]
            apart = np.abs(scans.times[rows[rows >= 0]] - self.times[rows >= 0]).max()
            parts.append(f"{name} in {np.count_nonzero(rows >= 0)} epochs, up to {1e3 * apart:.1f} ms off")
        return f"scans of {len(parts)} scanners: " + "; ".join(parts)

    def name(self, i: int) -> str:
        """Return the names of the scans of epoch number `i`."""
        own = zip(self.scanners, self._rows[i].tolist(), strict=True)
        return " + ".join(scans.name(row) for scans, row in own if row >= 0)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return epoch number `i`, in the frame of the vehicle; ranges are those of each scanner."""
        time = float(self.times[i])
        numbers = np.flatnonzero(self._rows[i] >= 0)
        raws = [self.scanners[number].read(int(self._rows[i, number]), min_range, max_range) for number in numbers]
        sizes = [len(raw.points) for raw in raws]
        offsets = [
            (np.zeros(size) if raw.point_times is None else raw.point_times) + (raw.time - time)
            for raw, size in zip(raws, sizes, strict=True)
        ]
        is_known = any(raw.point_times is not None or raw.time != time for raw in raws)
        points = np.concatenate([self.poses[k].apply(raw.points) for k, raw in zip(numbers, raws, strict=True)])
        counts = (
            sum(raw.n_returns for raw in raws), sum(raw.n_dropped_invalid for raw in raws),
            sum(raw.n_dropped_range for raw in raws), sum(raw.n_dropped_duplicates for raw in raws),
        )  # fmt: skip
        times, viewpoints = np.concatenate(offsets), Viewpoints(np.repeat(numbers, sizes), self.poses)
        return RawScan(points, time, self.name(i), *counts, times if is_known else None, viewpoints)
