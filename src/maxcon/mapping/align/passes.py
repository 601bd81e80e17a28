# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Passes of the mapping vehicle: which points belong to each, and where it measured when."""

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

PASSES_BY = ("time", "source", "file")
"""What tells passes apart: pauses in gps_time, point source ids, or files."""
MOST_SECONDS = 2_000_000
"""Three weeks of mapping; more different seconds cannot be times, and would fill the memory."""
MOST_PASSES = 1000
CHUNK = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """One drive of the mapping vehicle."""

    name: str  # "pass 1"; or the name of its file; or "source 1", by its point source id
    times: NDArray[np.float64]  # (k,): Middles of the seconds in which it measured, s, rising; a single 0 without times
    middles: NDArray[np.float64]  # (k, 3): Mean of the points of each of these seconds, global, m
    n_points: int  # How many points it has
    centre: NDArray[np.float64]  # (3,): Mean of all of them, global, m

    @property
    def start(self) -> float:
        """Begin of its first second, s."""
        return float(self.times[0]) - 0.5

    @property
    def end(self) -> float:
        """End of its last second, s."""
        return float(self.times[-1]) + 0.5

    @property
    def middle_time(self) -> float:
        """Middle of the median second in which it measured, s."""
        return float(self.times[len(self.times) // 2])


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """All passes of a campaign, in order of their starts."""

    by: str  # What tells them apart, one of `PASSES_BY`
    passes: tuple[Pass, ...]  # At least one
    keys: NDArray[np.int64]  # (n,): Point source id of each pass, or number of its file; not used for passes by time

    def __len__(self) -> int:
        return len(self.passes)

    def __iter__(self) -> Iterator[Pass]:
        return iter(self.passes)

    def of_points(self, times: NDArray[np.float64], source_ids: NDArray[np.integer], file: int) -> NDArray[np.int16]:
        """Number of the pass of each point, shape (n,), of times (s) and source ids (n,) each, in one file."""
        if self.by == "time":
            return self.at(times)
        wanted = source_ids if self.by == "source" else np.full(len(times), file)
        order = np.argsort(self.keys)
        return order[np.searchsorted(self.keys[order], wanted)].astype(np.int16)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.int16]:
        """Number of the pass under way at each time (s), shape (n,), or of the nearest one; for passes by time."""
        ends = np.array([each.end for each in self.passes[:-1]])
        starts = np.array([each.start for each in self.passes[1:]])
        return np.searchsorted(0.5 * (ends + starts), times, side="right").astype(np.int16)

    @property
    def are_apart(self) -> bool:
        """Whether no two passes were under way at the same time, so that a time tells the pass."""
        return all(next_.start >= each.end for each, next_ in zip(self.passes, self.passes[1:], strict=False))


@dataclass(frozen=True, slots=True, eq=False)
class PassPoints:
    """A chunk of the points of a file."""

    record: Any  # All fields of the points, as laspy reads them
    points: NDArray[np.float64]  # (n, 3): Global, m
    times: NDArray[np.float64]  # (n,): s; zeros where the file has none
    source_ids: NDArray[np.integer]  # (n,): Point source ids
    classes: NDArray[np.uint8]  # (n,): Classification codes
    is_withheld: NDArray[np.bool_]  # (n,): Points that the file marks as deleted


def read_passes(header: CloudHeader) -> Iterator[PassPoints]:
    """Yield the points of a LAS or LAZ file, a million at a time, with all their fields.

    FileError if it is of another kind, broken, or a time or coordinate in it is not finite.
    """
    with open_cloud(header.path) as reader:
        if not isinstance(reader, LasReader):
            raise FileError(
                f"Expected LAS or LAZ files, whose points tell when they were measured, got {header.path}. Convert it."
            )
        for record in reader.records(CHUNK):
            points = positions_of(record)
            times = np.array(record["gps_time"], np.float64) if header.has_times else np.zeros(len(points))
            if not (np.isfinite(times).all() and np.isfinite(points).all()):
                raise FileError(
                    f"Expected finite times and coordinates in {header.path}, got others. Leave out those points."
                )
            yield PassPoints(
                record, points, times, np.array(record["point_source_id"]),
                np.array(record["classification"], np.uint8), np.array(record["withheld"], bool),
            )  # fmt: skip


def survey(headers: Sequence[CloudHeader], by: str, pause: float, report: Progress) -> Passes:
    """Read all clouds once, and tell their passes apart.

    FileError if a cloud cannot be read; OptionError if there are no times to tell passes apart by, or far too many
    seconds or passes.

    `by`: one of `PASSES_BY`; `pause`: seconds without a point that separate two passes by time.
    """
    if by not in PASSES_BY:
        raise OptionError(f"Expected passes by {', '.join(PASSES_BY)}, got {by!r}.")
    sums: defaultdict[tuple[int, int], NDArray[np.float64]] = defaultdict(lambda: np.zeros(4))
    origin, n_done, n_total = np.zeros(3), 0, sum(header.n_points for header in headers)
    for file, header in enumerate(headers):
        for part in read_passes(header):
            if n_done == 0:
                origin = np.floor(part.points[0])
            if by == "time" and not part.times.any():
                raise OptionError(
                    f"Expected gps_time in {header.path}, to tell passes apart by their pauses, got none. Say"
                    " --rounds file where each file is a pass, or --rounds source."
                )
            keys = np.full(len(part.times), file if by == "file" else 0, np.int64)
            _add_seconds(sums, part.source_ids.astype(np.int64) if by == "source" else keys, part, origin)
            n_done += len(part.times)
            report("finding passes", n_done, n_total)
            if len(sums) > MOST_SECONDS:
                raise OptionError(
                    f"Expected gps_time in seconds, got points of more than {MOST_SECONDS:,} different ones, the last"
                    f" in {header.path}. Are these times? If not, say --rounds file."
                )
    seconds = sorted(sums)
    values = np.array([sums[second] for second in seconds])
    values[:, 1:] = values[:, 1:] / values[:, :1] + origin
    return _passes(by, headers, np.array(seconds, np.int64), values, pause)


def _add_seconds(
    sums: defaultdict[tuple[int, int], NDArray[np.float64]],
    keys: NDArray[np.int64],
    part: PassPoints,
    origin: NDArray[np.float64],
) -> None:
    """Add count and positions of points to the sums of their (key, second)."""
    seconds = np.floor(part.times).astype(np.int64)
    order = np.lexsort((seconds, keys))
    is_first = np.ones(len(order), bool)
    is_first[1:] = (np.diff(keys[order]) != 0) | (np.diff(seconds[order]) != 0)
    starts = np.flatnonzero(is_first)
    positions = np.add.reduceat((part.points - origin)[order], starts, axis=0)
    counts = np.diff(starts, append=len(order))
    for row, start in enumerate(order[starts].tolist()):
        sums[int(keys[start]), int(seconds[start])] += (counts[row], *positions[row])


def _passes(
    by: str, headers: Sequence[CloudHeader], seconds: NDArray[np.int64], values: NDArray[np.float64], pause: float
) -> Passes:
    """Passes of (key, second), shape (k, 2), sorted, and count and mean position, shape (k, 4), of each."""
    is_new = np.diff(seconds[:, 0], prepend=seconds[0, 0] - 1) != 0
    if by == "time":
        is_new |= np.diff(seconds[:, 1], prepend=seconds[0, 1]) > pause
    groups = np.split(np.arange(len(seconds)), np.flatnonzero(is_new)[1:])
    if len(groups) > MOST_PASSES:
        raise OptionError(f"Expected at most {MOST_PASSES} passes, got {len(groups):,}. Is --pause too short?")
    groups.sort(key=lambda rows: (seconds[rows[0], 1], seconds[rows[0], 0]))
    passes, keys = [], [int(seconds[rows[0], 0]) for rows in groups]
    for number, (rows, key) in enumerate(zip(groups, keys, strict=True), 1):
        name = {"time": f"pass {number}", "source": f"source {key}"}.get(by) or headers[key].path.name
        counts = values[rows, 0]
        centre = np.average(values[rows, 1:], axis=0, weights=counts)
        passes.append(Pass(name, seconds[rows, 1] + 0.5, values[rows, 1:], int(counts.sum()), np.asarray(centre)))
    return Passes(by, tuple(passes), np.array(keys, np.int64))
