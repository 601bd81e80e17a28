# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rounds: the drives of the mapping vehicle, which points belong to each, and where it measured when."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.progress import Progress
from maxcon.errors import FileError, OptionError
from maxcon.io.clouds import CloudHeader, open_cloud
from maxcon.io.clouds.las import LasReader, positions_of

__all__ = ["ROUNDS_BY", "Round", "RoundPoints", "Rounds", "read_rounds", "survey"]

ROUNDS_BY = ("time", "source", "file")
"""What tells rounds apart: pauses in gps_time, point source ids, or files."""
MOST_SECONDS = 2_000_000
"""Three weeks of mapping; more different seconds cannot be times, and would fill the memory."""
MOST_ROUNDS = 1000
CHUNK = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """One drive of the mapping vehicle.

    Parameters
    ----------
    name : str
        "round 1"; or the name of its file; or "source 1", by its point source id.
    times : array, shape (k,)
        Middles of the seconds in which it measured, s, rising; a single 0 without times.
    middles : array, shape (k, 3)
        Mean of the points of each of these seconds, global, m.
    n_points : int
        How many points it has.
    centre : array, shape (3,)
        Mean of all of them, global, m.
    """

    name: str
    times: NDArray[np.float64]
    middles: NDArray[np.float64]
    n_points: int
    centre: NDArray[np.float64]

    @property
    def start(self) -> float:
        """Begin of its first second, s."""
        return float(self.times[0]) - 0.5

    @property
    def end(self) -> float:
        """End of its last second, s."""
        return float(self.times[-1]) + 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Rounds:
    """All rounds of a campaign, in order of their starts.

    Parameters
    ----------
    by : str
        What tells them apart, one of `ROUNDS_BY`.
    rounds : tuple of Round
        At least one.
    keys : array, shape (n,), int64
        Point source id of each round, or number of its file; not used for rounds by time.
    """

    by: str
    rounds: tuple[Round, ...]
    keys: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.rounds)

    def of_points(self, times: NDArray[np.float64], source_ids: NDArray[np.integer], file: int) -> NDArray[np.int16]:
        """Number of the round of each point, shape (n,).

        Parameters
        ----------
        times : array, shape (n,)
            s.
        source_ids : array, shape (n,)
            Point source ids.
        file : int
            Number of the file that they are in.
        """
        if self.by == "time":
            return self.at(times)
        wanted = source_ids if self.by == "source" else np.full(len(times), file)
        order = np.argsort(self.keys)
        return order[np.searchsorted(self.keys[order], wanted)].astype(np.int16)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.int16]:
        """Number of the round under way at each time (s), shape (n,), or of the nearest one; for rounds by time."""
        ends = np.array([each.end for each in self.rounds[:-1]])
        starts = np.array([each.start for each in self.rounds[1:]])
        return np.searchsorted(0.5 * (ends + starts), times, side="right").astype(np.int16)

    @property
    def are_apart(self) -> bool:
        """Whether no two rounds were under way at the same time, so that a time tells the round."""
        starts, ends = ([getattr(each, name) for each in self.rounds] for name in ("start", "end"))
        return all(start >= end for start, end in zip(starts[1:], ends[:-1], strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class RoundPoints:
    """A chunk of the points of a file.

    Parameters
    ----------
    record : PackedPointRecord
        All fields of the points, as laspy reads them.
    points : array, shape (n, 3)
        Global, m.
    times : array, shape (n,)
        s; zeros where the file has none.
    source_ids : array, shape (n,)
        Point source ids.
    classes : array, shape (n,), uint8
        Classification codes.
    is_withheld : array, shape (n,), bool
        Points that the file marks as deleted.
    """

    record: Any
    points: NDArray[np.float64]
    times: NDArray[np.float64]
    source_ids: NDArray[np.integer]
    classes: NDArray[np.uint8]
    is_withheld: NDArray[np.bool_]


def read_rounds(header: CloudHeader) -> Iterator[RoundPoints]:
    """Yield the points of a LAS or LAZ file, a million at a time, with all their fields.

    Raises
    ------
    FileError
        If it is of another kind, broken, or a time or coordinate in it is not finite.
    """
    with open_cloud(header.path) as reader:
        if not isinstance(reader, LasReader):
            raise FileError(
                f"Expected LAS or LAZ files, whose points tell when they were measured, got {header.path}. Convert it."
            )
        for record in reader.records(CHUNK):
            points = positions_of(record)
            times = np.zeros(len(points))
            if header.has_times:
                times = np.array(record["gps_time"], dtype=np.float64)
            if not (np.isfinite(times).all() and np.isfinite(points).all()):
                raise FileError(
                    f"Expected finite times and coordinates in {header.path}, got others. Leave out those points."
                )
            yield RoundPoints(
                record, points, times, np.array(record["point_source_id"]),
                np.array(record["classification"], np.uint8), np.array(record["withheld"], bool),
            )  # fmt: skip


class _Seconds:
    """Count and sum of the points of each second, by source id or file; grows with time, not with points."""

    def __init__(self) -> None:
        self._sums: defaultdict[tuple[int, int], NDArray[np.float64]] = defaultdict(lambda: np.zeros(4))

    def add(self, keys: NDArray[np.int64], part: RoundPoints, origin: NDArray[np.float64]) -> None:
        """Add points with the key of each, shape (n,): its source id, or number of its file."""
        seconds = np.floor(part.times).astype(np.int64)
        order = np.lexsort((seconds, keys))
        is_first = np.ones(len(order), bool)
        is_first[1:] = (np.diff(keys[order]) != 0) | (np.diff(seconds[order]) != 0)
        starts = np.flatnonzero(is_first)
        sums = np.add.reduceat((part.points - origin)[order], starts, axis=0)
        counts = np.diff(starts, append=len(order))
        for row, start in enumerate(order[starts].tolist()):
            self._sums[int(keys[start]), int(seconds[start])] += (counts[row], *sums[row])

    def __len__(self) -> int:
        return len(self._sums)

    def rows(self, origin: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(key, second), shape (k, 2), sorted, and of each the count and the mean, global, m, shape (k, 4)."""
        places = sorted(self._sums)
        sums = np.array([self._sums[place] for place in places])
        sums[:, 1:] = sums[:, 1:] / sums[:, :1] + origin
        return np.array(places, np.int64), sums


def survey(headers: Sequence[CloudHeader], by: str, pause: float, report: Progress) -> Rounds:
    """Read all clouds once, and tell their rounds apart.

    Parameters
    ----------
    headers : sequence of CloudHeader
        Headers of the clouds.
    by : str
        One of `ROUNDS_BY`.
    pause : float
        Seconds without a point that separate two rounds by time.
    report : callable
        Called with (step, done, of how many).

    Raises
    ------
    OptionError
        If there are no times to tell rounds apart by, or far too many seconds or rounds.
    FileError
        If a cloud cannot be read.
    """
    if by not in ROUNDS_BY:
        raise OptionError(f"Expected rounds by {', '.join(ROUNDS_BY)}, got {by!r}.")
    seconds, origin, n_done = _Seconds(), np.zeros(3), 0
    n_total = sum(header.n_points for header in headers)
    for file, header in enumerate(headers):
        for part in read_rounds(header):
            if n_done == 0:
                origin = np.floor(part.points[0])
            if by == "time" and not part.times.any():
                raise OptionError(
                    f"Expected gps_time in {header.path}, to tell rounds apart by their pauses, got none. Say"
                    " --rounds file where each file is a round, or --rounds source."
                )
            keys = np.full(len(part.times), {"time": 0, "file": file, "source": -1}[by], np.int64)
            seconds.add(part.source_ids.astype(np.int64) if by == "source" else keys, part, origin)
            n_done += len(part.times)
            report("finding rounds", n_done, n_total)
            if len(seconds) > MOST_SECONDS:
                raise OptionError(
                    f"Expected gps_time in seconds, got points of more than {MOST_SECONDS:,} different ones, the last"
                    f" in {header.path}. Are these times? If not, say --rounds file."
                )
    return _rounds(by, headers, *seconds.rows(origin), pause)


def _rounds(
    by: str, headers: Sequence[CloudHeader], places: NDArray[np.int64], sums: NDArray[np.float64], pause: float
) -> Rounds:
    is_new = np.diff(places[:, 0], prepend=places[0, 0] - 1) != 0
    if by == "time":
        is_new |= np.diff(places[:, 1], prepend=places[0, 1]) > pause
    groups = np.split(np.arange(len(places)), np.flatnonzero(is_new)[1:])
    if len(groups) > MOST_ROUNDS:
        raise OptionError(f"Expected at most {MOST_ROUNDS} rounds, got {len(groups):,}. Is --pause too short?")
    keys = places[[rows[0] for rows in groups], 0]
    order = sorted(range(len(groups)), key=lambda number: (places[groups[number][0], 1], keys[number]))
    rounds = []
    for number, group in enumerate(order):
        rows, key = groups[group], int(keys[group])
        name = {"time": f"round {number + 1}", "source": f"source {key}"}.get(by) or headers[key].path.name
        counts = sums[rows, 0]
        centre = np.average(sums[rows, 1:], axis=0, weights=counts)
        rounds.append(Round(name, places[rows, 1] + 0.5, sums[rows, 1:], int(counts.sum()), np.asarray(centre)))
    return Rounds(by, tuple(rounds), keys[order])
