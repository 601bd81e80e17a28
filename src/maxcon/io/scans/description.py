# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Describes scans by the first few of them: fields, times of points, rings, rate, extent, normals."""

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.raw_scan import returns_in_range
from maxcon.io.recordings.clouds import (
    CLOUD,
    VELODYNE,
    RecordedCloud,
    TopicOfClouds,
    chosen_topic,
    open_clouds,
    topics_of_capture,
)
from maxcon.io.recordings.recording import CAPTURE_SUFFIX, Topic, is_recording, open_recording
from maxcon.io.scans.folder import ScanFolder, open_scan_folder
from maxcon.scan import Scan

N_SCANS = 10
"""Scans of each scanner that are read for it."""


@dataclass(frozen=True, slots=True)
class ScansDescription:
    """The scans of one scanner.

    source: their topic, or the folder.
    n_scans, n_seen: how many there are, and how many of them were read: the first ones.
    fields, times, rings: what is stored of each point; how the times of points were understood, and why; layers of the
        scanner.
    rate: scans in a second.
    n_points, n_invalid, n_duplicates: in all scans that were read: points, those of them without a return, and those
        that come twice.
    ranges: nearest, median and farthest of their returns, m.
    low, high: least and largest x, y, z, sensor frame, m.
    fraction_with_normal: of the points between 1 m and 120 m in the first scan with points, those with a normal.
    problem: why one of these scans cannot be read; empty if all can.
    """

    source: str
    n_scans: int
    n_seen: int
    fields: str
    times: str
    rings: str
    rate: float | None
    n_points: int
    n_invalid: int
    n_duplicates: int
    ranges: tuple[float, ...] | None
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None
    fraction_with_normal: float | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class RecordingDescription:
    """Topics and notes of a recording (none for folders of scans), and its scanners."""

    topics: tuple[Topic, ...]
    notes: tuple[str, ...]
    scanners: tuple[ScansDescription, ...]


class _Seen(NamedTuple):
    """One scan that was read."""

    points: NDArray[np.float64]
    time: float
    counts: tuple[int, int, int]
    fields: str
    times: str
    rings: NDArray[np.int64] | None = None


def describe(path: str | os.PathLike[str], topic: str | None = None) -> RecordingDescription:
    """Describe scans or a recording; of each scanner the first ten scans are read.

    A recording without clouds has no scanners. Errors as of `open_scans`.

    path: as `open_scans` takes it.
    topic: the only topic to describe; all with clouds if None.
    """
    if not is_recording(path):
        scans = open_scan_folder(path)
        reads = (partial(_seen_in_folder, scans, i) for i in range(len(scans)))
        return RecordingDescription((), (), (_described(str(path), len(scans), reads),))
    if Path(path).suffix.lower() == CAPTURE_SUFFIX:
        with closing(open_clouds(path)) as source:
            n_turns = sum(1 for _ in source.clouds())
            scanner = _described(source.label, n_turns, (partial(_seen, cloud) for cloud in source.clouds()))
        return RecordingDescription(topics_of_capture(Path(path)), (), (scanner,))
    with open_recording(path) as recording:
        chosen = recording.of_type(CLOUD, VELODYNE) if topic is None else [chosen_topic(recording, topic)]
        scanners = []
        for found in chosen:
            clouds = TopicOfClouds(recording, found).clouds()
            scanners.append(_described(found.name, found.n_messages, (partial(_seen, cloud) for cloud in clouds)))
        return RecordingDescription(recording.topics, recording.notes, tuple(scanners))


def _seen(cloud: RecordedCloud) -> _Seen:
    found = cloud.points()
    fields = "" if isinstance(cloud.record, FileError) else cloud.record.words
    counts = found.n_points, found.n_invalid, found.n_duplicates
    return _Seen(found.points, cloud.stamp * 1e-9, counts, fields, found.times.words, found.rings)


def _seen_in_folder(scans: ScanFolder, i: int) -> _Seen:
    raw, words = scans.read(i, 0.0, np.inf), scans.words(i) if i == 0 else ("", "")
    return _Seen(raw.points, raw.time, (raw.n_returns, raw.n_dropped_invalid, 0), *words)


def _described(source: str, n_scans: int, reads: Iterator[Callable[[], _Seen]]) -> ScansDescription:
    """The description of the first scans that can be read."""
    seen: list[_Seen] = []
    problems: list[str] = []
    for read in islice(reads, N_SCANS):
        try:
            seen.append(read())
        except FileError as error:
            problems.append(str(error))
    full = [scan.points for scan in seen if len(scan.points)]
    points = np.concatenate(full) if full else np.empty((0, 3))
    times = sorted(scan.time for scan in seen)
    ranges = np.linalg.norm(points, axis=1)
    n_points, n_invalid, n_duplicates = np.sum([(0, 0, 0), *(scan.counts for scan in seen)], axis=0).tolist()
    rings = np.unique(np.concatenate([np.empty(0, np.int64), *(s.rings for s in seen if s.rings is not None)]))
    near = full[0][returns_in_range(full[0], 1.0, 120.0)[0]] if full else points
    return ScansDescription(
        source=source,
        n_scans=n_scans,
        n_seen=len(seen) + len(problems),
        fields=(seen[0].fields if seen else "") or "x, y, z",
        times=(seen[0].times if seen else "") or "the points of these files have no times",
        rings=f"{len(rings)} ({rings[0]} to {rings[-1]})" if len(rings) else "not stored",
        rate=(len(times) - 1) / (times[-1] - times[0]) if times and times[-1] > times[0] else None,
        n_points=n_points,
        n_invalid=n_invalid,
        n_duplicates=n_duplicates,
        ranges=(float(ranges.min()), float(np.median(ranges)), float(ranges.max())) if full else None,
        low=tuple(points.min(axis=0).tolist()) if full else None,
        high=tuple(points.max(axis=0).tolist()) if full else None,
        fraction_with_normal=float(Scan(near).normals.any(axis=1).mean()) if len(near) else None,
        problem=problems[0] if problems else "",
    )
