"""Rough poses from positions in latitude and longitude, of tables and NMEA logs of receivers, in a map's coordinates.

Of NMEA 0183 GGA or GNS are positions, RMC or ZDA dates; GST, HDT and PASHR are used if there. pynmeagps was tried: it
drops a position for a letter in the name of its base station, and takes ten times as long.
"""

import math
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import reduce
from mmap import ACCESS_READ, mmap
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import CrsError, FileError, TrajectoryError
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Heights, Orientations, ReceiverLog, RecordedPoses, covariances_of, is_place, place_fixes
from maxcon.io.text import UNCLEAR_HEADINGS, PoseTable, numbered_lines, parse_float, read_pose_table, reading
from maxcon.scan.trajectory import Trajectory, first_fault

HEIGHT_COLUMNS = {  # the first that is there counts
    "ellipsoidal_height": Heights.ELLIPSOIDAL, "orthometric_height": Heights.ORTHOMETRIC, "height": Heights.ELLIPSOIDAL,
}  # fmt: skip
UNCLEAR_HEIGHTS = ("altitude", "alt", "elevation", "z", "h")
SIGMAS = (("sigma_east", "sigma_north"), ("sigma_x", "sigma_y"))
NMEA_SUFFIXES = (".nmea", ".log")
SENTENCE = re.compile(rb"\$([A-Z]{5},[ -#%-)+-~]{0,200})(?:\*([0-9A-Fa-f]{2}))?")
"""Wherever in a line: other protocols stand between sentences, and before the first of a line."""
BEGINNING = 2**16
DAY = 86400.0
SIGMAS_OF_ONE = {1: 5.0, 2: 2.0, 3: 2.0, 4: 0.05, 5: 0.5}
"""Sigmas of east and north, m, for a HDOP of 1, by GGA's quality: single, differential, PPS, RTK fixed, float."""
GNS_QUALITY = (("R", 4), ("F", 5), ("D", 2), ("P", 3), ("A", 1), ("E", 6))
N_COLUMNS = {"no fix": 2, "time": 2, "date": 2, "sigmas": 4, "position": 7, "HDT": 6, "PASHR": 6}
"""Of what is kept: place in the log, time of the day, s (a date: s since 1970), and numbers, NaN where not said: of
sigmas m; latitude, longitude, altitude, geoid, assumed sigma; azimuth, roll to starboard, nose up, its sigma, deg."""
TIMED = ("GGA", "GNS", "RMC", "ZDA", "GST", "PASHR")  # sentences that begin with a time of the day


def is_geographic(path: Path) -> bool:
    """Whether a prior is a log of NMEA sentences, or a table with a column latitude; FileError if it is no text."""
    if is_nmea(path):
        return True
    if path.suffix.lower() != ".csv":
        return False
    header = next((line for _, line in numbered_lines(path, "a trajectory") if not line.startswith("#")), "")
    return "latitude" in [name.strip().lower() for name in header.split(",")]


def read_geographic_prior(
    path: Path, crs: str | None, geoid_height: float | None = None, *, are_sure: bool = False
) -> RecordedPoses:
    """Return the poses in a log of NMEA sentences, or a table with a column latitude; the rest as of `place_fixes`."""
    if crs is None:
        raise CrsError(
            f"Expected a map with a CRS, to place {path}, which is in latitude and longitude; got one without. Build"
            " it with --crs."
        )
    log = read_nmea(path) if is_nmea(path) else read_geographic_csv(path)
    words = f"positions from {path.name}" + (f" (NMEA); {log.words}" if log.words else "")
    return place_fixes(replace(log, words=words), GeographicFrame(crs), geoid_height, str(path), are_sure=are_sure)


def read_geographic_csv(file: Path) -> ReceiverLog:
    """Return positions and orientations in a table (docs/priors.md); rows without a latitude are left out."""
    table = read_pose_table(file, "positions")
    if not table.names:
        raise TrajectoryError(f"{file}: Expected at least one position, got none. Was it written to its end?")
    sigma_names = next((pair for pair in SIGMAS if any(name in table.names for name in pair)), SIGMAS[0])
    height, heading = _check_header(table, sigma_names)
    n_empty = len(table.rows)
    n_empty -= len(table.keep(table.texts("latitude")))
    places = table.numbers(["time", "latitude", "longitude", height])
    sigmas = table.numbers([*sigma_names, "sigma_heading"], may_be_empty=True)
    angles = table.numbers(["roll", "pitch", heading], may_be_empty=True)
    if heading == "azimuth":
        angles[:, 2] = math.pi / 2.0 - angles[:, 2]
    for row, place in enumerate(places[:, 1:].tolist()):
        if not is_place(place):
            table.add_fault(row, f"Expected degrees as latitude and longitude, got {place[0]:g}, {place[1]:g}.")
    places, angles, sigmas = table.good([places, angles, sigmas], may_leave_out=True)
    times = places[:, 0]
    fault = first_fault(times, places[:, 1:], np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1)))
    if fault is not None:
        table.refuse(fault.words, table.lines[fault.row])
    orientations = _orientations(file.name, times, angles, sigmas[:, 2])
    return ReceiverLog(
        times, places[:, 1:], covariances_of(sigmas[:, :2]), n_empty, HEIGHT_COLUMNS[height], orientations,
        left_out=table.told_faults(),
    )  # fmt: skip


def _check_header(table: PoseTable, sigma_names: tuple[str, str]) -> tuple[str, str]:
    """Quantities of heights and of headings; columns that leave open what they are counted from are refused."""
    height = next((name for name in HEIGHT_COLUMNS if name in table.names), None)
    heading, azimuth = table.name_of("heading"), table.name_of("azimuth")
    unclear_height = next((name for name in UNCLEAR_HEIGHTS if name in table.names), None)
    unclear_heading = next((name for name in UNCLEAR_HEADINGS if name in table.names), None)
    if height is None:
        got = "none" if unclear_height is None else f"{unclear_height!r}, which may be either"
        table.refuse(
            f"Expected heights as ellipsoidal_height or orthometric_height (above the geoid), got {got}. Name the"
            " column so."
        )
    if (heading and azimuth) or (not heading and not azimuth and unclear_heading):
        got = "both" if heading else f"{unclear_heading!r}, which may be either"
        table.refuse(
            f"Expected headings as azimuth_deg (clockwise from true north) or heading_deg (counter-clockwise from true"
            f" east), got {got}. Rename or remove it."
        )
    for name in ("time", "latitude", "longitude", height):
        if table.name_of(name) is None:
            table.refuse(f"Expected columns time, latitude, longitude and a height, got no {name!r}. Add it.")
    for one, other in (("roll", "pitch"), sigma_names):
        if (table.name_of(one) is None) != (table.name_of(other) is None):
            table.refuse(f"Expected both {one} and {other}, or neither, got one. Add the other, or remove it.")
    return height, "azimuth" if azimuth else "heading"


def _orientations(
    name: str, times: NDArray[np.float64], angles: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> Orientations | None:
    """Orientations of the rows that have a heading; roll and pitch that are not known are 0."""
    is_known = ~np.isnan(angles[:, 2])
    if not is_known.any():
        return None
    quaternions = quaternions_from_angles(*np.nan_to_num(angles[is_known]).T)
    return Orientations(name, Trajectory(times[is_known], np.zeros((is_known.sum(), 3)), quaternions), sigmas[is_known])


def is_nmea(file: Path) -> bool:
    """Whether a file is a log of NMEA sentences: by its suffix, or .txt with such a sentence near its beginning."""
    suffix = file.suffix.lower()
    if suffix != ".txt":
        return suffix in NMEA_SUFFIXES
    try:
        with open_regular(file) as stream:
            return re.search(rb"(?:^|[\r\n])[$!][A-Z]{5},", stream.read(BEGINNING)) is not None
    except OSError:
        return False  # said where it is read


def read_nmea(file: Path) -> ReceiverLog:
    """Return what a receiver logged; heights are ellipsoidal, or above the geoid if it never states the latter's."""
    rows: dict[str, list[tuple[float, ...]]] = {kind: [] for kind in N_COLUMNS}
    n_sentences = n_broken = 0
    with reading(file, "a log of NMEA sentences"), open_regular(file) as stream:
        log = mmap(stream.fileno(), 0, access=ACCESS_READ) if os.fstat(stream.fileno()).st_size else b""
        for content, checksum in (match.groups() for match in SENTENCE.finditer(log)):
            if checksum is None or int(checksum, 16) != reduce(xor, content):
                n_broken += 1
                continue
            n_sentences += 1
            for kind, time, *values in _said(content.decode("ascii").split(",")):
                if kind == "HDT" or not math.isnan(time):
                    rows[kind].append((n_sentences, time, *values))
    if not n_sentences:
        broken = f"{n_broken} with a wrong checksum, or without" if n_broken else "none"
        raise FileError(f"Expected NMEA sentences in {file}, got {broken}. Is it the right file?")
    said = {kind: np.array(values).reshape(-1, N_COLUMNS[kind]) for kind, values in rows.items()}
    return _finished(file, said, n_broken)


def _said(parts: list[str]) -> Iterator[tuple[Any, ...]]:
    """Yield what a sentence says: a kind of `N_COLUMNS`, a time and its numbers; nothing where fields are missing."""
    kind, texts = parts[0] if parts[0] == "PASHR" else parts[0][2:], parts[1:] + [""] * 12
    time, known = _time_of_day(texts[0]), [parse_float(text) for text in texts]
    numbers = [math.nan if value is None else value for value in known]
    if kind in TIMED:
        yield "time", time
    if kind in ("GGA", "GNS"):
        if kind == "GGA":
            quality = int(texts[5]) if texts[5].isdecimal() else 0
            hdop, altitude, geoid = numbers[7], numbers[8], numbers[10]
        else:
            quality = next((number for letter, number in GNS_QUALITY if letter in texts[5]), 0)
            hdop, altitude, geoid = numbers[7:10]
        latitude, longitude = _degrees(texts[1], texts[2], "NS"), _degrees(texts[3], texts[4], "EW")
        if not 1 <= quality <= 6 or math.isnan(time) or not is_place([latitude, longitude, 0.0]):
            yield "no fix", 0.0
        else:
            yield "position", time, latitude, longitude, altitude, geoid, hdop * SIGMAS_OF_ONE.get(quality, math.nan)
    elif kind == "RMC" and texts[1] == "A":
        day, month, year = (texts[8][i : i + 2] for i in (0, 2, 4))
        yield "date", time + _midnight(day, month, f"{'19' if year >= '80' else '20'}{year}")
    elif kind == "ZDA":
        yield "date", time + _midnight(*texts[1:4])
    elif kind == "GST" and numbers[5] >= 0.0 and numbers[6] >= 0.0:
        yield "sigmas", time, numbers[6], numbers[5]
    elif kind == "HDT" and not math.isnan(numbers[0]):
        yield "HDT", math.nan, numbers[0], 0.0, 0.0, math.nan
    elif kind == "PASHR" and texts[2] == "T" and not math.isnan(numbers[1] + numbers[3] + numbers[4]):
        yield "PASHR", time, numbers[1], numbers[3], numbers[4], numbers[8]


def _finished(file: Path, said: dict[str, NDArray[np.float64]], n_broken: int) -> ReceiverLog:
    """What was read, sorted by time; GGA and GNS of one time are one."""
    positions, dates, stated = said["position"], said["date"], said["sigmas"]
    n_positions, n_without_fix = len(positions), len(said["no fix"])
    kind = Heights.ELLIPSOIDAL if np.isfinite(positions[:, 4] + positions[:, 5]).any() else Heights.ORTHOMETRIC
    heights = positions[:, 4] + (positions[:, 5] if kind is Heights.ELLIPSOIDAL else 0.0)
    positions, heights = positions[np.isfinite(heights)], heights[np.isfinite(heights)]
    if not len(positions):
        got = "positions without heights" if n_positions else f"{n_without_fix} sentences without a fix"
        raise TrajectoryError(f"{file}: Expected positions with heights (GGA or GNS), got {got}. Log GGA with a fix.")
    if not len(dates):
        raise TrajectoryError(
            f"{file}: Expected a date (RMC or ZDA) beside the positions, got times of a day alone. Log RMC too, or give"
            " the positions as a CSV with times."
        )
    times, first = np.unique(_dated(positions, dates), return_index=True)
    positions, heights = positions[first], heights[first]
    of_time = dict(zip(_dated(stated, dates).tolist(), stated[:, 2:].tolist(), strict=True))
    assumed = np.repeat(positions[:, 6:], 2, axis=1).tolist()
    sigmas = np.array([of_time.get(time, beside) for time, beside in zip(times.tolist(), assumed, strict=True)])
    sigmas[~(sigmas.sum(axis=1) > 0.0)] = np.nan
    n_left_out = n_without_fix + n_positions - len(times)
    places = np.column_stack([positions[:, 2:4], heights])
    n_stated = sum(time in of_time for time in times.tolist())
    n_known = int((~np.isnan(sigmas[:, 0])).sum())
    words = f"times: UTC; sigmas: {n_stated} of GST, {n_known - n_stated} of HDOP, {len(times) - n_known} unknown"
    if n_broken:
        words += f"; {n_broken} sentences with a wrong checksum, or without, left out"
    if kind is Heights.ELLIPSOIDAL:
        words += f"; geoid height of the log {np.nanmedian(positions[:, 5]):.2f} m"
    orientations = _turns(file, said, dates)
    return ReceiverLog(times, places, covariances_of(sigmas), n_left_out, kind, orientations, words)


def _dated(rows: NDArray[np.float64], dates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Seconds since 1970, of times of a day: the day nearest to the date said last, or first."""
    said = dates[np.maximum(np.searchsorted(dates[:, 0], rows[:, 0], side="right") - 1, 0), 1]
    return np.asarray(rows[:, 1] + DAY * np.round((said - rows[:, 1]) / DAY), dtype=np.float64)


def _turns(file: Path, said: dict[str, NDArray[np.float64]], dates: NDArray[np.float64]) -> Orientations | None:
    """Orientations of PASHR, which have times of their own, or of HDT, which are of the sentence before with a time."""
    name = "PASHR" if len(said["PASHR"]) else "HDT"
    turns, timed = said[name], said["time"]
    if name == "HDT":
        if not len(turns) or not len(timed):
            return None
        leads = turns[0, 0] < timed[0, 0]  # a receiver that says HDT first in each epoch
        row = np.searchsorted(timed[:, 0], turns[:, 0]) - (0 if leads else 1)
        turns[:, 1] = timed[row.clip(0, len(timed) - 1), 1]
    times, first = np.unique(_dated(turns, dates), return_index=True)
    azimuth, roll, nose_up, sigmas = np.radians(turns[first, 2:]).T
    # NMEA counts clockwise from north and noses up; here it is counter-clockwise from east, and noses down.
    quaternions = quaternions_from_angles(roll, -nose_up, math.pi / 2.0 - azimuth)
    trajectory = Trajectory(times, np.zeros((len(times), 3)), quaternions)
    return Orientations(f"{name} in {file.name}", trajectory, np.where(sigmas > 0.0, sigmas, np.nan))


def _midnight(day: str, month: str, year: str) -> float:
    """Seconds since 1970; NaN where it is no date, as before the first fix."""
    try:
        return datetime(int(year), int(month), int(day), tzinfo=UTC).timestamp()
    except (ValueError, OverflowError):
        return math.nan


def _time_of_day(text: str) -> float:
    """Seconds of a day, of hhmmss.ss; NaN where it is none."""
    if not re.fullmatch(r"\d{6}(\.\d*)?", text):
        return math.nan
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    return hours * 3600.0 + minutes * 60.0 + seconds if hours < 24 and minutes < 60 and seconds < 61.0 else math.nan


def _degrees(text: str, side: str, sides: str) -> float:
    """Degrees, of dddmm.mmmm and a side such as N; NaN where it is none."""
    if not re.fullmatch(r"\d{3,5}(\.\d*)?", text) or side not in tuple(sides):
        return math.nan
    whole, minutes = divmod(float(text), 100.0)
    return (whole + minutes / 60.0) * (1.0 if side == sides[0] else -1.0)
