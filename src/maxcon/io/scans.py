"""Scans of a drive: a folder with one file per epoch, or a recording, the time of each, and what is in them."""

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import check_regular
from maxcon.errors import FileError, OptionError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.base import as_float64
from maxcon.io.clouds.pcd import PcdReader
from maxcon.io.point_records import CloudPoints, PointTimes, are_returns, find_point_times, times_and_rings, words_of
from maxcon.io.raw_scan import RawScan, Scans, check_range, scan_within
from maxcon.io.recordings import clouds as recorded
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording, open_recording
from maxcon.io.recordings.recording import Topic
from maxcon.io.text import NUMBER, SCAN_SUFFIXES, in_natural_order, numbered_lines, parse_float, reading
from maxcon.scan import Scan

__all__ = ["RawScan", "ScanFolder", "Scans", "check_range", "describe", "open_scan_folder", "open_scans"]

MAX_SCAN_POINTS = 5_000_000  # more is a map in the wrong place, and would take over a gigabyte to localize
LEAST, MOST = 1e-9, 1e9  # m; float64 read as float32 has many numbers beyond
BLOCK, N_BLOCKS = 12, 400  # floats that are whole points of three and of four numbers, and how many are compared
LEAST_DIFFERENCE = 0.1
"""Between the distributions of columns: on 149 real scans 0.41 to 1.0, with a wrong count of numbers at most 0.02."""
UNITS_BY_DIGITS = {19: 1e9, 16: 1e6, 13: 1e3}  # of Unix times since 2001 as names: how many make a second
ADVICE = "Write a times.txt with one time in seconds per scan, in the order of the names."
N_SCANS = 10  # scans of each scanner that are read for it
FARTHEST_MEDIAN = 500.0  # m; no scanner of vehicles sees half of its points farther away


def read_scan_file(file: Path, stamp: int = 0) -> CloudPoints:
    """Return the returns of a scan file; points that are there twice are kept; stamp: time of the scan, ns."""
    times, fields = PointTimes(None, "", ""), ""
    columns: dict[str, NDArray[Any]] = {}
    with reading(file, "a scan"):
        check_regular(file)
        if file.suffix.lower() == ".bin":
            points, fields = _read_floats(file)
        else:
            with open_cloud(file) as reader:
                _check_count(file, reader.header.n_points)
                if isinstance(reader, PcdReader):
                    records = reader.records()
                    columns, fields = times_and_rings(records), words_of(records.dtype)
                    points = as_float64(np.stack([records[name] for name in reader.coordinates], axis=1))
                else:
                    points = np.concatenate([chunk.points for chunk in reader.chunks()])
    rows = np.flatnonzero(are_returns(*points.T))
    if columns:
        times = find_point_times({name: values.take(rows) for name, values in columns.items()}, stamp)
    return CloudPoints(points.take(rows, axis=0), times, None, len(points), len(points) - len(rows), 0, fields)


def _check_count(file: Path, n_points: int) -> None:
    if n_points > MAX_SCAN_POINTS:
        raise FileError(
            f"Expected a scan of at most {MAX_SCAN_POINTS:,} points, got {n_points:,} in {file}. Is it a map?"
        )


def _read_floats(file: Path) -> tuple[NDArray[np.float64], str]:
    n_bytes = file.stat().st_size
    _check_count(file, n_bytes // 16)
    values = np.fromfile(file, dtype="<f4")
    sizes = np.abs(values[np.isfinite(values)])
    if np.count_nonzero((sizes > MOST) | ((sizes > 0.0) & (sizes < LEAST))) > 0.1 * values.size:
        raise FileError(f"Expected float32 x, y, z, reflectance in {file}, got others. Is it float64? Write float32.")
    if n_bytes and n_bytes % 12 == 0 and _are_triples(values):
        return as_float64(values.reshape(-1, 3)), "x float32, y float32, z float32"
    if n_bytes == 0 or n_bytes % 16:
        raise FileError(
            f"Expected float32 x, y, z, reflectance in {file}, 16 bytes per point, got {n_bytes} bytes. Is the file"
            " empty or truncated? Copy it again."
        )
    return as_float64(values.reshape(-1, 4)[:, :3]), ""


def _are_triples(values: NDArray[np.float32]) -> bool:
    """Whether floats are points of three numbers rather than four, by what differs more between their columns."""
    blocks = values[: values.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    if not len(blocks):
        return False
    sample = np.nan_to_num(blocks[:: max(1, len(blocks) // N_BLOCKS)])
    of_three, of_four = (_difference(sample.reshape(-1, width)) for width in (3, 4))
    chance = 2.0 / np.sqrt(sample.size / 3.0)  # columns of few points differ by chance
    return bool(of_three > of_four + LEAST_DIFFERENCE + chance)


def _difference(columns: NDArray[np.float32]) -> float:
    """Largest difference between the distributions of two columns, 0 to 1, at 33 levels (Kolmogorov and Smirnov)."""
    levels = np.quantile(columns, np.linspace(0.02, 0.98, 33))
    return float(max(np.ptp((columns <= level).mean(axis=0)) for level in levels))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ScanFolder(Scans):
    """Scans of one drive, with one file per epoch."""

    paths: tuple[Path, ...]
    times: NDArray[np.float64]  # shape (n,); s, strictly increasing

    def name(self, i: int) -> str:
        """Return the name of the file of scan number `i`; what is no UTF-8 in it, as "?"."""
        return self.paths[i].name.encode(errors="replace").decode()

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`; parameters and errors as of any scans, MissingExtraError besides (PCD)."""
        time = float(self.times[i])
        return scan_within(self.cloud(i), time, time, self.name(i), min_range, max_range)

    def cloud(self, i: int) -> CloudPoints:
        """Return the returns of scan number `i`; errors as of `read`."""
        return read_scan_file(self.paths[i], round(float(self.times[i]) * 1e9))


def open_scans(
    path: str | os.PathLike[str], times: str | os.PathLike[str] | None = None, *, topic: str | None = None,
    at_stamp: bool = False,
) -> Scans:  # fmt: skip
    """Return the scans in a folder, a recording, or the one scan in a file; none is read yet.

    - path: A folder of scans of one kind: .bin (float32 x, y, z, and reflectance as KITTI has it), .pcd, .ply, .npz,
      .las or .laz; or one such file. Files with other suffixes are left alone. Or a recording: .bag, .mcap, .db3,
      .pcap, or the folder of a ROS 2 bag.
    - times: file with one time per line, s. If None: `times.txt` in the folder if there is one, else the names are the
      times: decimals are seconds, integers of 19, 16, 13 digits are ns, us, ms, others seconds.
    - topic: which of several clouds of a recording.
    - at_stamp: whether the time of a recorded scan is that of its message, and not the middle between its first and its
      last point where these have times.

    FileError if there is no scan, scans are of several kinds, times are missing or do not fit the scans, or a recording
    has no cloud, or several and none is asked for; MissingExtraError if it is a recording, and the extra `recordings`
    is not installed; OptionError if times are given for a recording, or a topic for a folder.
    """
    if not is_recording(path):
        if topic is not None or at_stamp:
            raise OptionError(
                f"Expected a topic, or times of messages, to be asked of a recording, got {os.fspath(path)}. Leave"
                " that out."
            )
        return open_scan_folder(path, times)
    if times is not None:
        raise OptionError(f"Expected no times beside the recording {os.fspath(path)}: it has its own. Leave them out.")
    return recorded.RecordedScans(recorded.open_clouds(path, topic), at_stamp=at_stamp)


def open_scan_folder(path: str | os.PathLike[str], times: str | os.PathLike[str] | None = None) -> ScanFolder:
    """Return the scans in a folder, or the one scan in a file; parameters and errors as of `open_scans`."""
    root = Path(path)
    with reading(root, "a folder of scans"):
        root.stat()
        there = sorted(root.iterdir()) if root.is_dir() else [root]
        files = [path for path in there if not path.name.startswith(".") and not path.is_dir()]
    found = [path for path in files if path.suffix.lower() in SCAN_SUFFIXES]
    suffixes = sorted({p.suffix.lower() for p in found})
    if len(suffixes) != 1:
        raise FileError(
            f"Expected scans of one kind ({', '.join(SCAN_SUFFIXES)}) in {root}, got {', '.join(suffixes) or 'none'}."
            " Name a folder with one kind in it."
        )
    paths = tuple(in_natural_order(found))
    if times is None and root / "times.txt" in there:
        times = root / "times.txt"
    return ScanFolder(paths, _times_from_names(paths) if times is None else _times_from_file(Path(times), len(paths)))


def _times_from_file(file: Path, n_scans: int) -> NDArray[np.float64]:
    """Times of a file, shape (n_scans,), s: one per line, increasing; `#` begins a comment."""
    times: list[float] = []
    for number, line in numbered_lines(file, "times of scans"):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        value = parse_float(text)
        if value is None or (times and value <= times[-1]):
            raise FileError(
                f"{file}, line {number}: Expected one time in seconds, later than the one before, got {text[:40]!r}."
                " Correct this line, or put scans and times in order."
            )
        times.append(value)
    if len(times) != n_scans:
        raise FileError(f"Expected {n_scans} times in {file}, one per scan, got {len(times)}. {ADVICE}")
    return np.array(times)


def _times_from_names(paths: tuple[Path, ...]) -> NDArray[np.float64]:
    """Times in the names of files, shape (n,), s, increasing: seconds, or Unix time in ns, us or ms by their digits."""
    are_numbers = [NUMBER.fullmatch(path.stem) is not None for path in paths]
    if not all(are_numbers):
        other = paths[are_numbers.index(False)]
        raise FileError(
            f"Expected a time as the name of each scan, or a times.txt beside them, got {other.name} in"
            f" {other.parent}. {ADVICE}"
        )
    units = [1.0 if "." in path.stem else UNITS_BY_DIGITS.get(len(path.stem.lstrip("-")), 1.0) for path in paths]
    times = np.array([float(path.stem) for path in paths]) / units[0]
    is_wrong = ~(np.diff(times) > 0.0) | (np.diff(units) != 0.0)
    if is_wrong.any():
        first, second = paths[np.argmax(is_wrong)], paths[np.argmax(is_wrong) + 1]
        raise FileError(
            f"Expected names of increasing times of the same unit in {first.parent}, got {first.name} and"
            f" {second.name}. {ADVICE}"
        )
    return times


class ScannerDescription(NamedTuple):
    """What the first scans of a scanner say, in words, and as numbers: m, a second, and ratios of the points."""

    words: dict[str, str]
    facts: dict[str, Any]


class RecordingDescription(NamedTuple):
    """Topics and notes of a recording (none for folders of scans), and what each of its scanners says."""

    topics: tuple[Topic, ...]
    notes: tuple[str, ...]
    scanners: tuple[ScannerDescription, ...]


def describe(path: str | os.PathLike[str], topic: str | None = None) -> RecordingDescription:
    """Describe scans or a recording, all topics with clouds or one; of each scanner the first ten scans are read."""
    if not is_recording(path):
        scans = open_scan_folder(path)
        reads = ((float(time), partial(scans.cloud, i)) for i, time in enumerate(scans.times))
        return RecordingDescription((), (), (_described(str(path), len(scans), reads),))
    if Path(path).suffix.lower() == CAPTURE_SUFFIX:
        with closing(recorded.open_clouds(path)) as source:
            n_turns = sum(1 for _ in source.clouds())
            scanner = _described(source.label, n_turns, _reads(source))
        return RecordingDescription(recorded.topics_of_capture(Path(path)), (), (scanner,))
    with open_recording(path) as recording:
        with_clouds = recording.of_type(*recorded.CLOUDS, recorded.VELODYNE)
        chosen = with_clouds if topic is None else [recorded.topic_of_clouds(recording, topic)]
        sources = [(each, recorded.TopicOfClouds(recording, each)) for each in chosen]
        scanners = [_described(each.name, each.n_messages, _reads(source)) for each, source in sources]
        return RecordingDescription(recording.topics, recording.notes, tuple(scanners))


def _reads(source: recorded.CloudSource) -> Iterator[tuple[float, Callable[[], CloudPoints]]]:
    return ((cloud.stamp * 1e-9, cloud.points) for cloud in source.clouds())


def _described(
    source: str, n_scans: int, reads: Iterator[tuple[float, Callable[[], CloudPoints]]]
) -> ScannerDescription:
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
    rate = (len(times) - 1) / (times[-1] - times[0]) if times and times[-1] > times[0] else None
    n_seen = len(clouds) + len(problems)
    counts = [*map(sum, zip((0, 0, 0), *(cloud[3:6] for cloud in clouds), strict=True))]
    n_points, no_returns, repeated = counts[0] / max(n_seen, 1), *(count / max(counts[0], 1) for count in counts[1:])
    rings = np.unique(np.concatenate([np.empty(0, np.int64), *(c.rings for c in clouds if c.rings is not None)]))
    words = {
        "scans": f"{source}: {n_scans:,} scans{f', {rate:.2f} a second' if rate else ''}; of the first {n_seen}:",
        "fields": (clouds[0].fields if clouds else "") or "x, y, z",
        "times": (clouds[0].times.words if clouds else "") or "the points of these files have no times",
        "rings": f"{len(rings)} ({rings[0]} to {rings[-1]})" if len(rings) else "not stored",
        "points": f"{n_points:,.0f} a scan; {100.0 * no_returns:.1f} % no returns, {100.0 * repeated:.1f} % come twice",
    }
    facts: dict[str, Any] = {
        "source": source, "n_scans": n_scans, "rate": rate, "n_read": n_seen, "rings": rings.tolist(),
        "points_per_scan": n_points, "no_returns": no_returns, "repeated": repeated, "problem": "".join(problems[:1]),
        **{name: words[name] for name in ("fields", "times")},
    }  # fmt: skip
    full = [cloud.points for cloud in clouds if len(cloud.points)]
    if full:
        points = np.concatenate(full)
        ranges = np.linalg.norm(points, axis=1)
        least, median, largest = facts["range"] = [float(of(ranges)) for of in (np.min, np.median, np.max)]
        unit = ": are these millimetres?" if median > FARTHEST_MEDIAN else ""
        words["range"] = f"{least:.2f} to {largest:.1f} m, median {median:.1f} m{unit}"
        facts["extent"] = np.column_stack([points.min(axis=0), points.max(axis=0)]).tolist()
        extents = zip("xyz", facts["extent"], strict=True)
        words["extent"] = ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, (low, high) in extents) + " m"
        first = ranges[: len(full[0])]
        near = full[0][(first >= 1.0) & (first <= 120.0)]
        if len(near):
            facts["with_normals"] = float(Scan(near).normals.any(axis=1).mean())
            percent = f"{100.0 * facts['with_normals']:.0f} %"
            words["normals"] = f"{percent} of the points of the first scan have one; 20 % are enough"
    return ScannerDescription(words | ({"problem": problems[0]} if problems else {}), facts)
