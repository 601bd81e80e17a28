# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Logs of GNSS receivers in NMEA 0183: GGA or GNS for positions, RMC or ZDA for dates, GST, HDT and PASHR if there."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import open_regular
from maxcon.errors import FileError, TrajectoryError
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.fixes import Fixes, Heights, Orientations, is_place
from maxcon.io.text import parse_float
from maxcon.scan.trajectory import Trajectory

__all__ = ["NmeaLog", "is_nmea", "read_nmea"]

SUFFIXES = (".nmea", ".log")
SENTENCE = re.compile(rb"\$([A-Z]{5}),([ -#%-)+-~]{0,200})(?:\*([0-9A-Fa-f]{2}))?")
"""Wherever in a line: other protocols stand between sentences, and before the first of a line."""
BEGINNING = 2**16
BLOCK, LONGEST = 2**20, 256
DAY = 86400.0
SIGMAS_OF_ONE = {1: 5.0, 2: 2.0, 3: 2.0, 4: 0.05, 5: 0.5}
"""Standard deviation of east, and of north, m, that a HDOP of 1 is taken to mean, by GGA's quality: single,
differential, PPS, RTK fixed, RTK float (decision 26). Others, such as dead reckoning, state nothing."""
GNS_QUALITY = (("R", 4), ("F", 5), ("D", 2), ("P", 3), ("A", 1), ("E", 6))


class _Position(NamedTuple):
    """What GGA or GNS says: where in the log, s of the day, degrees, m; NaN where empty."""

    order: int
    time_of_day: float
    latitude: float
    longitude: float
    altitude: float
    geoid: float
    quality: int
    hdop: float


class _Turn(NamedTuple):
    """What HDT or PASHR says, rad: azimuth, roll to starboard, nose up, and the heading's standard deviation."""

    order: int
    time_of_day: float
    azimuth: float
    roll: float = 0.0
    nose_up: float = 0.0
    sigma: float = math.nan


@dataclass(slots=True)
class _Sentences:
    """What has been read so far."""

    positions: list[_Position] = field(default_factory=list)
    turns: dict[str, list[_Turn]] = field(default_factory=lambda: {"HDT": [], "PASHR": []})
    dates: list[tuple[int, float]] = field(default_factory=list)
    sigmas: dict[int, tuple[float, float]] = field(default_factory=dict)
    early_sigmas: tuple[float, tuple[float, float]] | None = None
    timed: list[tuple[int, float]] = field(default_factory=list)
    n_sentences: int = 0
    n_broken: int = 0
    n_without_fix: int = 0


class NmeaLog(NamedTuple):
    """Positions and orientations of a log, and what is to be said of them."""

    fixes: Fixes
    orientations: Orientations | None
    words: str


def is_nmea(file: Path) -> bool:
    """Whether a file is a log of NMEA sentences: by its suffix, or .txt with such a sentence near its beginning."""
    suffix = file.suffix.lower()
    if suffix != ".txt":
        return suffix in SUFFIXES
    try:
        with open_regular(file) as stream:
            beginning = stream.read(BEGINNING)
    except OSError:
        return False  # said where it is read
    return re.search(rb"(?:^|[\r\n])[$!][A-Z]{5},", beginning) is not None


def read_nmea(file: Path) -> NmeaLog:
    """Return what a receiver logged; sentences with a wrong checksum, or without, are passed over and counted.

    Parameters
    ----------
    file : Path
        The log; other lines and protocols between sentences are passed over.

    Returns
    -------
    NmeaLog
        Times are UTC, seconds since 1970. Heights are ellipsoidal: the altitude and the receiver's own geoid height
        are added; or above the geoid, if it never states the latter.

    Raises
    ------
    FileError
        If it cannot be read, or holds no sentences.
    TrajectoryError
        If there is no position with a height, or no date.
    """
    read = _Sentences()
    try:
        with open_regular(file) as stream:
            for order, (kind, texts) in enumerate(_sentences(stream, read)):
                _take(read, order, kind, texts)
    except FileNotFoundError as error:
        raise FileError(f"Expected a log of NMEA sentences at {file}, got no such file. Check the path.") from error
    except OSError as error:
        raise FileError(f"Expected to be able to read {file}, got: {error.strerror}. Check the path.") from error
    if not read.n_sentences:
        broken = f"{read.n_broken} with a wrong checksum, or without" if read.n_broken else "none"
        raise FileError(f"Expected NMEA sentences in {file}, got {broken}. Is it the right file?")
    chosen, heights = _with_heights(file, read)
    if not read.dates:
        raise TrajectoryError(
            f"{file}: Expected a date (RMC or ZDA) beside the positions, got times of a day alone. Log RMC too, or give"
            " the positions as a CSV with times."
        )
    return _log(file, read, chosen, heights)


def _sentences(stream: BinaryIO, read: _Sentences) -> Iterator[tuple[str, list[str]]]:
    """Yield kind and fields of every sentence with a right checksum, a block of the file at a time."""
    rest = b""
    while True:
        block = stream.read(BLOCK)
        data = rest + block
        end = (data.rfind(b"\n") + 1 or max(0, len(data) - LONGEST)) if block else len(data)
        for match in SENTENCE.finditer(data[:end]):
            name, body, checksum = match.groups()
            computed = reduce(xor, name + b"," + body)
            if checksum is None or int(checksum, 16) != computed:
                read.n_broken += 1
            else:
                read.n_sentences += 1
                yield name.decode(), body.decode("ascii").split(",")
        rest = data[end:]
        if not block:
            return


def _take(read: _Sentences, order: int, name: str, texts: list[str]) -> None:
    """Keep what a sentence says; one without the fields that it should have says nothing."""
    texts = [*texts, *[""] * 12]
    kind = name if name == "PASHR" else name[2:]
    time = _time_of_day(texts[0])
    if kind in ("GGA", "GNS", "RMC", "ZDA", "GST", "PASHR") and not math.isnan(time):
        read.timed.append((order, time))
    if kind in ("GGA", "GNS"):
        _take_position(read, order, kind, time, texts)
    elif kind == "RMC" and texts[1] == "A":
        _take_date(read, order, time, texts[8][:2], texts[8][2:4], _year(texts[8][4:6]))
    elif kind == "ZDA":
        _take_date(read, order, time, *texts[1:4])
    elif kind == "GST":
        _take_sigmas(read, time, (_number(texts[6]), _number(texts[5])))
    elif kind == "HDT" and not math.isnan(_number(texts[0])):
        read.turns[kind].append(_Turn(order, math.nan, math.radians(_number(texts[0]))))
    elif kind == "PASHR" and texts[2] == "T":
        angles = np.radians([_number(texts[i]) for i in (1, 3, 4, 8)]).tolist()
        if not math.isnan(time + sum(angles[:3])):
            read.turns[kind].append(_Turn(order, time, *angles))


def _take_sigmas(read: _Sentences, time: float, sigmas: tuple[float, float]) -> None:
    """Keep standard deviations of east and north for the positions of the same time, before or after."""
    if not min(sigmas) >= 0.0:
        return
    read.early_sigmas = (time, sigmas)
    for number in range(len(read.positions) - 1, -1, -1):
        if read.positions[number].time_of_day != time:
            break
        read.sigmas[number] = sigmas


def _take_position(read: _Sentences, order: int, kind: str, time: float, texts: list[str]) -> None:
    if kind == "GGA":
        quality, (hdop, altitude, geoid) = (
            int(texts[5]) if texts[5].isdecimal() else 0,
            (texts[7], texts[8], texts[10]),
        )
    else:
        quality = next((number for letter, number in GNS_QUALITY if letter in texts[5]), 0)
        hdop, altitude, geoid = texts[7:10]
    latitude, longitude = _degrees(texts[1], texts[2], "NS"), _degrees(texts[3], texts[4], "EW")
    if not 1 <= quality <= 6 or math.isnan(time) or not is_place([latitude, longitude, 0.0]):
        read.n_without_fix += 1
        return
    if read.early_sigmas is not None and read.early_sigmas[0] == time:
        read.sigmas[len(read.positions)] = read.early_sigmas[1]
    read.positions.append(
        _Position(order, time, latitude, longitude, _number(altitude), _number(geoid), quality, _number(hdop))
    )


def _take_date(read: _Sentences, order: int, time: float, day: str, month: str, year: str) -> None:
    try:
        midnight = datetime(int(year), int(month), int(day), tzinfo=UTC).timestamp()
    except (ValueError, OverflowError):
        return  # empty before the first fix
    if not math.isnan(time):
        read.dates.append((order, midnight + time))


def _year(text: str) -> str:
    return f"{'19' if text >= '80' else '20'}{text}"


def _number(text: str) -> float:
    value = parse_float(text)
    return math.nan if value is None else value


def _time_of_day(text: str) -> float:
    """Return seconds of a day, of hhmmss.ss; NaN where it is none."""
    if not re.fullmatch(r"\d{6}(\.\d*)?", text):
        return math.nan
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    return hours * 3600.0 + minutes * 60.0 + seconds if hours < 24 and minutes < 60 and seconds < 61.0 else math.nan


def _degrees(text: str, side: str, sides: str) -> float:
    """Return degrees, of dddmm.mmmm and a side such as N; NaN where it is none."""
    if not re.fullmatch(r"\d{3,5}(\.\d*)?", text) or side not in tuple(sides):
        return math.nan
    whole, minutes = divmod(float(text), 100.0)
    return (whole + minutes / 60.0) * (1.0 if side == sides[0] else -1.0)


def _with_heights(file: Path, read: _Sentences) -> tuple[list[_Position], Heights]:
    """Return the positions with heights of one kind; GGA and GNS of one time are one."""
    kind = Heights.ELLIPSOIDAL
    chosen = [position for position in read.positions if math.isfinite(position.altitude + position.geoid)]
    if not chosen:
        kind = Heights.ORTHOMETRIC
        chosen = [position for position in read.positions if math.isfinite(position.altitude)]
    if not chosen:
        got = "positions without heights" if read.positions else f"{read.n_without_fix} sentences without a fix"
        raise TrajectoryError(f"{file}: Expected positions with heights (GGA or GNS), got {got}. Log GGA with a fix.")
    return chosen, kind


def _log(file: Path, read: _Sentences, chosen: list[_Position], kind: Heights) -> NmeaLog:
    dates = np.array(read.dates)
    times = _dated(np.array([p.order for p in chosen]), np.array([p.time_of_day for p in chosen]), dates)
    first = np.unique(times, return_index=True)[1]  # sorted, and one of each time
    times, chosen = times[first], [chosen[row] for row in first.tolist()]
    numbers = {position.order: number for number, position in enumerate(read.positions)}
    n_stated, covariances = 0, np.full((len(chosen), 2, 2), np.nan)
    for row, position in enumerate(chosen):
        stated = read.sigmas.get(numbers[position.order])
        n_stated += stated is not None
        assumed = position.hdop * SIGMAS_OF_ONE.get(position.quality, math.nan)
        sigmas = (assumed, assumed) if stated is None else stated
        covariances[row] = np.diag(np.square(sigmas)) if sum(sigmas) > 0.0 else np.nan
    places = np.array(
        [(p.latitude, p.longitude, p.altitude + (p.geoid if kind is Heights.ELLIPSOIDAL else 0.0)) for p in chosen]
    )
    n_known = int((~np.isnan(covariances[:, 0, 0])).sum())
    words = f"times: UTC; sigmas: {n_stated} of GST, {n_known - n_stated} of HDOP, {len(chosen) - n_known} unknown"
    if read.n_broken:
        words += f"; {read.n_broken} sentences with a wrong checksum, or without, left out"
    n_without = read.n_without_fix + len(read.positions) - len(chosen)
    fixes = Fixes(times, places, covariances, n_without, kind)
    return NmeaLog(fixes, _orientations(file, read, dates), words)


def _dated(
    orders: NDArray[np.float64], times_of_day: NDArray[np.float64], dates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return seconds since 1970, of times of a day: the day nearest to the date said last, or first."""
    said = dates[np.maximum(np.searchsorted(dates[:, 0], orders, side="right") - 1, 0), 1]
    return np.asarray(times_of_day + DAY * np.round((said - times_of_day) / DAY), dtype=np.float64)


def _orientations(file: Path, read: _Sentences, dates: NDArray[np.float64]) -> Orientations | None:
    """Orientations of PASHR, which have times of their own, or of HDT, which are of the sentence before with a time."""
    name = "PASHR" if read.turns["PASHR"] else "HDT"
    turns = read.turns[name]
    if not turns or not read.timed:
        return None
    orders = np.array([turn.order for turn in turns], dtype=np.float64)
    times = np.array([turn.time_of_day for turn in turns])
    if name == "HDT":
        timed = np.array(read.timed)
        leads = orders[0] < timed[0, 0]  # a receiver that says HDT first in each epoch
        row = np.searchsorted(timed[:, 0], orders) - (0 if leads else 1)
        times = timed[row.clip(0, len(timed) - 1), 1]
    times, first = np.unique(_dated(orders, times, dates), return_index=True)
    rows = np.array([turn[2:] for turn in turns])[first]
    # NMEA counts clockwise from north and noses up; here it is counter-clockwise from east, and noses down.
    quaternions = quaternions_from_angles(rows[:, 1], -rows[:, 2], math.pi / 2.0 - rows[:, 0])
    sigmas = np.where(rows[:, 3] > 0.0, rows[:, 3], np.nan)
    return Orientations(f"{name} in {file.name}", Trajectory(times, np.zeros((len(times), 3)), quaternions), sigmas)
