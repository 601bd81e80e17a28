# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Describes scans by the first few of them: fields, times of points, rings, rate, extent, normals."""

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from maxcon.errors import FileError
from maxcon.io.point_records import CloudPoints
from maxcon.io.recordings.clouds import (
    CLOUD,
    VELODYNE,
    CloudSource,
    TopicOfClouds,
    open_clouds,
    topic_of_clouds,
    topics_of_capture,
)
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording, open_recording
from maxcon.io.recordings.recording import Topic
from maxcon.io.scans.folder import open_scan_folder
from maxcon.scan import Scan

N_SCANS = 10  # scans of each scanner that are read for it
FARTHEST_MEDIAN = 500.0  # m; no scanner of vehicles sees half of its points farther away


class RecordingDescription(NamedTuple):
    """Topics and notes of a recording (none for folders of scans), and a table of words for each of its scanners.

    A table has "scans", "fields", "times" (how those of points were understood, and why), "rings", "points"; and where
    they are known "range", "extent", "normals" and a "problem", why one of the scans cannot be read.
    """

    topics: tuple[Topic, ...]
    notes: tuple[str, ...]
    scanners: tuple[dict[str, str], ...]


def describe(path: str | os.PathLike[str], topic: str | None = None) -> RecordingDescription:
    """Describe scans or a recording; of each scanner the first ten scans are read.

    A recording without clouds has no scanners. Errors as of `open_scans`.

    path: as `open_scans` takes it.
    topic: the only topic to describe; all with clouds if None.
    """
    if not is_recording(path):
        scans = open_scan_folder(path)
        reads = ((float(time), partial(scans.cloud, i)) for i, time in enumerate(scans.times))
        return RecordingDescription((), (), (_described(str(path), len(scans), reads),))
    if Path(path).suffix.lower() == CAPTURE_SUFFIX:
        with closing(open_clouds(path)) as source:
            n_turns = sum(1 for _ in source.clouds())
            scanner = _described(source.label, n_turns, _reads(source))
        return RecordingDescription(topics_of_capture(Path(path)), (), (scanner,))
    with open_recording(path) as recording:
        chosen = recording.of_type(CLOUD, VELODYNE) if topic is None else [topic_of_clouds(recording, topic)]
        scanners = [_described(each.name, each.n_messages, _reads(TopicOfClouds(recording, each))) for each in chosen]
        return RecordingDescription(recording.topics, recording.notes, tuple(scanners))


def _reads(source: CloudSource) -> Iterator[tuple[float, Callable[[], CloudPoints]]]:
    return ((cloud.stamp * 1e-9, cloud.points) for cloud in source.clouds())


def _described(source: str, n_scans: int, reads: Iterator[tuple[float, Callable[[], CloudPoints]]]) -> dict[str, str]:
    """What the first scans say that can be read; of each its time, s, and what reads it."""
    clouds: list[CloudPoints] = []
    times: list[float] = []
    problems: list[str] = []
    for time, read in islice(reads, N_SCANS):
        try:
            clouds.append(read())
            times.append(time)
        except FileError as error:
            problems.append(str(error))
    times.sort()
    rate = f", {(len(times) - 1) / (times[-1] - times[0]):.2f} a second" if times and times[-1] > times[0] else ""
    n_seen = len(clouds) + len(problems)
    n_points, n_invalid, n_duplicates = (
        sum(numbers) for numbers in zip((0, 0, 0), *(cloud[3:6] for cloud in clouds), strict=True)
    )
    rings = np.unique(np.concatenate([np.empty(0, np.int64), *(c.rings for c in clouds if c.rings is not None)]))
    words = {
        "scans": f"{source}: {n_scans:,} scans{rate}; of the first {n_seen}:",
        "fields": (clouds[0].fields if clouds else "") or "x, y, z",
        "times": (clouds[0].times.words if clouds else "") or "the points of these files have no times",
        "rings": f"{len(rings)} ({rings[0]} to {rings[-1]})" if len(rings) else "not stored",
        "points": (
            f"{n_points / max(n_seen, 1):,.0f} a scan; {100.0 * n_invalid / max(n_points, 1):.1f} % no returns,"
            f" {100.0 * n_duplicates / max(n_points, 1):.1f} % come twice"
        ),
    }
    full = [cloud.points for cloud in clouds if len(cloud.points)]
    if full:
        points = np.concatenate(full)
        ranges = np.linalg.norm(points, axis=1)
        median = float(np.median(ranges))
        unit = ": are these millimetres?" if median > FARTHEST_MEDIAN else ""
        words["range"] = f"{ranges.min():.2f} to {ranges.max():.1f} m, median {median:.1f} m{unit}"
        extents = zip("xyz", points.min(axis=0), points.max(axis=0), strict=True)
        words["extent"] = ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, low, high in extents) + " m"
        first = ranges[: len(full[0])]
        near = full[0][(first >= 1.0) & (first <= 120.0)]
        if len(near):
            percent = 100.0 * float(Scan(near).normals.any(axis=1).mean())
            words["normals"] = f"{percent:.0f} % of the points of the first scan have one; 20 % do, others weigh half"
    return words | ({"problem": problems[0]} if problems else {})
