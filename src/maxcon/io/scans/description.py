# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A description of scans from the first few of them: fields, times of points, rings, rate, extent, normals."""

import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MaxconError
from maxcon.io.raw_scan import RawScan
from maxcon.io.recordings.base import Topic
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording
from maxcon.scan import Scan

if TYPE_CHECKING:
    from maxcon.io.recordings.recorded_cloud import RecordedCloud

__all__ = ["RecordingDescription", "ScansDescription", "describe"]

N_SCANS = 10
"""Scans of each scanner that are read for it."""


@dataclass(frozen=True, slots=True)
class ScansDescription:
    """The scans of one scanner.

    Parameters
    ----------
    source : str
        Their topic, or the folder.
    n_scans : int
        How many there are.
    n_seen : int
        How many of them were read: the first ones.
    fields : str
        What is stored of each point.
    times : str
        How the times of points were understood, and why.
    rings : str
        Layers of the scanner.
    rate : float or None
        Scans in a second.
    n_points, n_invalid, n_duplicates : int
        In all scans that were read: points, those of them without a return, and those that come twice.
    ranges : tuple of 3 float, or None
        Nearest, median and farthest of their returns, m.
    low, high : tuple of 3 float, or None
        Least and largest x, y, z, sensor frame, m.
    share_with_normal : float or None
        Share of points with a normal, of those between 1 m and 120 m in the first scan with points.
    problem : str
        Why one of these scans cannot be read; empty if all can.
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
    share_with_normal: float | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class RecordingDescription:
    """Topics and notes of a recording (none for folders of scans), and its scanners."""

    topics: tuple[Topic, ...]
    notes: tuple[str, ...]
    scanners: tuple[ScansDescription, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """One scan that was read."""

    points: NDArray[np.float64]
    time: float
    n_points: int
    n_invalid: int
    n_duplicates: int
    rings: NDArray[np.int64] | None = None
    fields: str = ""
    times: str = ""


def describe(path: str | os.PathLike[str], topic: str | None = None) -> RecordingDescription:
    """Describe scans or a recording; of each scanner the first ten scans are read.

    Parameters
    ----------
    path : path
        As `open_scans` takes it.
    topic : str, optional
        The only topic to describe; all with clouds if None.

    Raises
    ------
    MaxconError
        As `open_scans`; a recording with other messages only has no scanners.
    """
    from maxcon.io.recordings.captures import topics_of_capture
    from maxcon.io.recordings.cloud_sources import CLOUD, VELODYNE, TopicOfClouds, chosen_topic, open_clouds
    from maxcon.io.recordings.opening import open_recording

    if not is_recording(path):
        return RecordingDescription((), (), (_of_folder(path),))
    if Path(path).suffix.lower() == CAPTURE_SUFFIX:
        source = open_clouds(path)
        with closing(source):
            turns = source.clouds()
            seen = list(_clouds(turns))
            n_turns = len(seen) + sum(1 for _ in turns)
            scanner = _described(source.label, n_turns, iter(seen))
        return RecordingDescription(topics_of_capture(Path(path)), (), (scanner,))
    with open_recording(path) as recording:
        chosen = recording.of_type(CLOUD, VELODYNE) if topic is None else [chosen_topic(recording, topic)]
        scanners = tuple(
            _described(found.name, found.n_messages, _clouds(TopicOfClouds(recording, found).clouds()))
            for found in chosen
        )
        return RecordingDescription(recording.topics, recording.notes, scanners)


def _clouds(clouds: "Iterator[RecordedCloud]") -> Iterator[_Seen | FileError]:
    """Read the first clouds."""
    from maxcon.io.recordings.point_cloud2 import fields_in_words

    for cloud in islice(clouds, N_SCANS):
        try:
            content = cloud.points()
        except FileError as error:
            yield error
        else:
            yield _Seen(
                points=content.points,
                time=cloud.stamp * 1e-9,
                n_points=content.n_points,
                n_invalid=content.n_invalid,
                n_duplicates=content.n_duplicates,
                rings=content.rings,
                fields=fields_in_words(cloud.fields),
                times=content.times.words,
            )


def _of_folder(path: str | os.PathLike[str]) -> ScansDescription:
    from maxcon.io.scans.folder import open_scan_folder

    scans = open_scan_folder(path)

    def seen() -> Iterator[_Seen | FileError]:
        for i in range(min(len(scans), N_SCANS)):
            try:
                raw: RawScan = scans.read(i, 0.0, np.inf)
                fields, times = scans.words(i) if i == 0 else ("", "")
            except FileError as error:
                yield error
            else:
                counts = raw.n_returns, raw.n_dropped_invalid, 0
                yield _Seen(raw.points, raw.time, *counts, fields=fields, times=times)

    return _described(str(path), len(scans), seen())


def _described(source: str, n_scans: int, scans: Iterator[_Seen | FileError]) -> ScansDescription:
    found = list(scans)
    seen = [scan for scan in found if isinstance(scan, _Seen)]
    problems = [str(scan) for scan in found if isinstance(scan, MaxconError)]
    full = [scan for scan in seen if len(scan.points)]
    points = np.concatenate([scan.points for scan in full]) if full else np.empty((0, 3))
    times = np.array(sorted(scan.time for scan in seen))
    has_rate = len(times) > 1 and times[-1] > times[0]
    ranges = np.linalg.norm(points, axis=1)
    return ScansDescription(
        source=source,
        n_scans=n_scans,
        n_seen=len(found),
        fields=seen[0].fields if seen and seen[0].fields else "x, y, z",
        times=seen[0].times if seen and seen[0].times else "the points of these files have no times",
        rings=_rings(seen),
        rate=float((len(times) - 1) / (times[-1] - times[0])) if has_rate else None,
        n_points=sum(scan.n_points for scan in seen),
        n_invalid=sum(scan.n_invalid for scan in seen),
        n_duplicates=sum(scan.n_duplicates for scan in seen),
        ranges=(float(ranges.min()), float(np.median(ranges)), float(ranges.max())) if len(points) else None,
        low=_triple(points.min(axis=0)) if len(points) else None,
        high=_triple(points.max(axis=0)) if len(points) else None,
        share_with_normal=_share_with_normal(full[0].points) if full else None,
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


def _share_with_normal(points: NDArray[np.float64]) -> float | None:
    from maxcon.io.raw_scan import returns_in_range

    is_near, _ = returns_in_range(points, 1.0, 120.0)
    near = points[is_near]
    return float(Scan(near).normals.any(axis=1).mean()) if len(near) else None
