# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Describes scans by the first few of them: fields, times of points, rings, rate, extent, normals."""

import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.io.raw_scan import returns_in_range
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording
from maxcon.io.recordings.recording import Topic
from maxcon.scan import Scan

if TYPE_CHECKING:
    from maxcon.io.recordings.point_cloud2 import RecordedCloud

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
    ranges: tuple[float, float, float] | None
    low: tuple[float, float, float] | None
    high: tuple[float, float, float] | None
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
    from maxcon.io.recordings.captures import topics_of_capture
    from maxcon.io.recordings.opening import open_recording
    from maxcon.io.recordings.recorded_scans import CLOUD, VELODYNE, TopicOfClouds, chosen_topic, open_clouds

    if not is_recording(path):
        return RecordingDescription((), (), (_of_folder(path),))
    if Path(path).suffix.lower() == CAPTURE_SUFFIX:
        with closing(open_clouds(path)) as source:
            turns = source.clouds()
            seen = list(_seen(turns))
            scanner = _described(source.label, len(seen) + sum(1 for _ in turns), seen)
        return RecordingDescription(topics_of_capture(Path(path)), (), (scanner,))
    with open_recording(path) as recording:
        chosen = recording.of_type(CLOUD, VELODYNE) if topic is None else [chosen_topic(recording, topic)]
        scanners = tuple(
            _described(found.name, found.n_messages, list(_seen(TopicOfClouds(recording, found).clouds())))
            for found in chosen
        )
        return RecordingDescription(recording.topics, recording.notes, scanners)


def _seen(clouds: "Iterator[RecordedCloud]") -> Iterator[_Seen | FileError]:
    """Read the first clouds."""
    from maxcon.io.recordings.point_cloud2 import fields_in_words

    for cloud in islice(clouds, N_SCANS):
        try:
            found = cloud.points()
        except FileError as error:
            yield error
        else:
            counts = found.n_points, found.n_invalid, found.n_duplicates
            fields = fields_in_words(cloud.fields)
            yield _Seen(found.points, cloud.stamp * 1e-9, counts, fields, found.times.words, found.rings)


def _of_folder(path: str | os.PathLike[str]) -> ScansDescription:
    from maxcon.io.scans.folder import open_scan_folder

    scans = open_scan_folder(path)
    found: list[_Seen | FileError] = []
    for i in range(min(len(scans), N_SCANS)):
        try:
            raw = scans.read(i, 0.0, np.inf)
            fields, times = scans.words(i) if i == 0 else ("", "")
        except FileError as error:
            found.append(error)
        else:
            found.append(_Seen(raw.points, raw.time, (raw.n_returns, raw.n_dropped_invalid, 0), fields, times))
    return _described(str(path), len(scans), found)


def _described(source: str, n_scans: int, found: list[_Seen | FileError]) -> ScansDescription:
    seen = [scan for scan in found if isinstance(scan, _Seen)]
    problems = [str(scan) for scan in found if isinstance(scan, FileError)]
    full = [scan.points for scan in seen if len(scan.points)]
    points = np.concatenate(full) if full else np.empty((0, 3))
    times = sorted(scan.time for scan in seen)
    ranges = np.linalg.norm(points, axis=1)
    n_points, n_invalid, n_duplicates = np.sum([(0, 0, 0), *(scan.counts for scan in seen)], axis=0).tolist()
    return ScansDescription(
        source=source,
        n_scans=n_scans,
        n_seen=len(found),
        fields=(seen[0].fields if seen else "") or "x, y, z",
        times=(seen[0].times if seen else "") or "the points of these files have no times",
        rings=_rings(seen),
        rate=(len(times) - 1) / (times[-1] - times[0]) if times and times[-1] > times[0] else None,
        n_points=n_points,
        n_invalid=n_invalid,
        n_duplicates=n_duplicates,
        ranges=(float(ranges.min()), float(np.median(ranges)), float(ranges.max())) if full else None,
        low=_triple(points.min(axis=0)) if full else None,
        high=_triple(points.max(axis=0)) if full else None,
        fraction_with_normal=_fraction_with_normal(full[0]) if full else None,
        problem=problems[0] if problems else "",
    )


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _rings(seen: list[_Seen]) -> str:
    rings = [scan.rings for scan in seen if scan.rings is not None and len(scan.rings)]
    if not rings:
        return "not stored"
    different = np.unique(np.concatenate(rings))
    return f"{len(different)} ({different[0]} to {different[-1]})"


def _fraction_with_normal(points: NDArray[np.float64]) -> float | None:
    near = points[returns_in_range(points, 1.0, 120.0)[0]]
    return float(Scan(near).normals.any(axis=1).mean()) if len(near) else None
