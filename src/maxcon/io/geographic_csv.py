# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tables with columns latitude, longitude and a height: positions, and orientations towards true north if given."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import TrajectoryError
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.fixes import Fixes, Heights, Orientations, is_place
from maxcon.io.text import numbered_lines
from maxcon.io.trajectory_csv import OTHER_NAMES, cells_of
from maxcon.io.trajectory_rows import Row, numbers_of, parsed, refuse, words_of_line
from maxcon.scan.trajectory import Trajectory

__all__ = ["GeographicRows", "has_geographic_header", "read_geographic_csv"]

HEIGHT_COLUMNS = {
    "ellipsoidal_height": Heights.ELLIPSOIDAL,
    "orthometric_height": Heights.ORTHOMETRIC,
    "height": Heights.ELLIPSOIDAL,
}
"""What each name means; the first that is there counts."""
UNCLEAR_HEIGHTS = ("altitude", "alt", "elevation", "z", "h")
SIGMAS = (("sigma_east", "sigma_north"), ("sigma_x", "sigma_y"))
N_COLUMNS = 10
"""Of a row: time, latitude, longitude, height, roll, pitch, azimuth, sigmas of east, north and heading."""


class GeographicRows(NamedTuple):
    """What such a table holds."""

    fixes: Fixes
    orientations: Orientations | None
    left_out: tuple[str, ...]


class _Column(NamedTuple):
    """Where a number stands in a line, and what makes it s, degrees of position, m, rad; or a heading of a compass."""

    place: int
    scale: float = 1.0
    is_compass: bool = False


Header = list[_Column | None]


def has_geographic_header(file: Path) -> bool:
    """Whether the first line of a table that is no comment names a latitude.

    Raises
    ------
    FileError
        If it cannot be read as text.
    """
    for number, line in numbered_lines(file, "a trajectory"):
        if not line.startswith("#"):
            return "latitude" in [name.strip().lower() for name in line.split(",")] and number > 0
    return False


def read_geographic_csv(file: Path) -> GeographicRows:
    """Return positions and orientations in a table.

    Parameters
    ----------
    file : Path
        With a header: time (s), latitude, longitude (degrees), and ellipsoidal_height, orthometric_height or height
        (m; ellipsoidal). Then, where they are known, roll, pitch (rad; or roll_deg, pitch_deg), heading (rad,
        counter-clockwise from true east; or heading_deg) or azimuth_deg (clockwise from true north; or azimuth, rad),
        sigma_east, sigma_north (m), and sigma_heading (rad; or sigma_heading_deg). Rows without a latitude are
        left out.

    Raises
    ------
    FileError
        If it cannot be read.
    TrajectoryError
        If columns are missing or unclear, most rows are no positions, or there is none.
    """
    header: Header = []
    names: list[str] = []
    rows: list[Row] = []
    left_out: list[str] = []
    kind = Heights.ELLIPSOIDAL
    n_empty = 0
    for number, line in _lines(file):
        texts = cells_of(file, number, line)
        if not header:
            names = [text.lower() for text in texts]
            kind, header = _columns(file, number, names)
            continue
        row = parsed(left_out, _row, file, number, texts, names, header)
        n_empty += row == []
        if row:
            rows.append((number, row))
    if len(left_out) > len(rows):
        raise TrajectoryError(left_out[0])
    if not rows:
        raise TrajectoryError(f"{file}: Expected at least one position, got none. Was it written to its end?")
    values: NDArray[np.float64] = np.array([row for _, row in rows])
    _check_order(file, rows, values[:, 0])
    variances = values[:, [7, 8]] ** 2
    covariances = np.zeros((len(rows), 2, 2))
    covariances[:, 0, 0], covariances[:, 1, 1] = variances.T
    covariances[np.isnan(variances).any(axis=1)] = np.nan
    fixes = Fixes(values[:, 0], values[:, 1:4], covariances, n_empty, kind)
    return GeographicRows(fixes, _orientations(file, values), tuple(left_out))


def _lines(file: Path) -> Iterable[tuple[int, str]]:
    return ((number, line) for number, line in numbered_lines(file, "positions") if not line.startswith("#"))


def _check_order(file: Path, rows: list[Row], times: NDArray[np.float64]) -> None:
    late = np.flatnonzero(times[1:] <= times[:-1])
    if len(late):
        at = int(late[0]) + 1
        words = (
            f"Expected times that increase, got {times[at]:.6f} s after {times[at - 1]:.6f} s. Sort the rows by time"
            " and keep one of each time."
        )
        raise TrajectoryError(words_of_line(file, rows[at][0], words))


def _orientations(file: Path, values: NDArray[np.float64]) -> Orientations | None:
    """Orientations of the rows that have a heading."""
    known = values[~np.isnan(values[:, 6])]
    if not len(known):
        return None
    turns = quaternions_from_angles(*known[:, 4:7].T)
    return Orientations(file.name, Trajectory(known[:, 0], np.zeros((len(known), 3)), turns), known[:, 9])


def _columns(file: Path, number: int, names: list[str]) -> tuple[Heights, Header]:
    """Return what heights are counted from, and the columns; None for those that are not there."""
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if twice is not None:
        refuse(file, number, f"Expected each column once, got {twice!r} more than once. Rename or remove one.")
    height = next((name for name in HEIGHT_COLUMNS if name in names), None)
    if height is None:
        unclear = next((name for name in UNCLEAR_HEIGHTS if name in names), None)
        got = "none" if unclear is None else f"{unclear!r}, which may be either"
        refuse(
            file,
            number,
            f"Expected heights as ellipsoidal_height or orthometric_height (above the geoid), got {got}. Name the"
            " column so.",
        )
    heading = _heading(file, number, names)
    sigmas = next((pair for pair in SIGMAS if any(name in names for name in pair)), SIGMAS[0])
    columns: Header = [
        _named(names, "time") or _named(names, "timestamp"),
        _named(names, "latitude"),
        _named(names, "longitude"),
        _named(names, height),
        _angle(names, "roll"),
        _angle(names, "pitch"),
        heading,
        _named(names, sigmas[0]),
        _named(names, sigmas[1]),
        _angle(names, "sigma_heading"),
    ]
    wanted = ("time", "latitude", "longitude")
    for name, column in zip(wanted, columns, strict=False):
        if column is None:
            refuse(file, number, f"Expected columns {', '.join(wanted)} and a height, got no {name!r}. Add it.")
    for one, other in ((4, 5), (7, 8)):
        if (columns[one] is None) != (columns[other] is None):
            pair = " and ".join(("roll", "pitch") if one == 4 else sigmas)
            refuse(file, number, f"Expected both {pair}, or neither, got one. Add the other, or remove it.")
    return HEIGHT_COLUMNS[height], columns


def _heading(file: Path, number: int, names: list[str]) -> _Column | None:
    """The column of headings, or None; names that leave open from where they count are refused."""
    found = [column for column in (_angle(names, "heading"), _angle(names, "azimuth")) if column is not None]
    if len(found) == 2:
        refuse(file, number, "Expected either heading or azimuth, got both. Remove one.")
    if found:
        return found[0]._replace(is_compass="azimuth" in names[found[0].place])
    unclear = next((name for name in OTHER_NAMES if name in names), None)
    if unclear is not None:
        refuse(
            file,
            number,
            f"Expected headings as azimuth_deg (clockwise from true north) or heading_deg (counter-clockwise from true"
            f" east), got {unclear!r}, which may be either. Rename it.",
        )
    return None


def _named(names: list[str], name: str) -> _Column | None:
    return _Column(names.index(name)) if name in names else None


def _angle(names: list[str], name: str) -> _Column | None:
    in_degrees = f"{name}_deg"
    if in_degrees in names:
        return _Column(names.index(in_degrees), math.pi / 180.0)
    return _named(names, name)


def _row(file: Path, number: int, texts: list[str], names: list[str], header: Header) -> list[float]:
    """Return the numbers of a row, NaN for those not known; none where it has no position."""
    if len(texts) != len(names):
        words = f"Expected {len(names)} columns as in the header, got {len(texts)}. Correct this line."
        refuse(file, number, words)
    latitude = header[1]
    if latitude is None or not texts[latitude.place]:
        return []
    row = [math.nan] * N_COLUMNS
    for entry, column in enumerate(header):
        if column is not None and (texts[column.place] or entry < 4):
            (value,) = numbers_of(file, number, [texts[column.place]], names[column.place])
            row[entry] = value * column.scale
            if column.is_compass:
                row[entry] = math.pi / 2.0 - row[entry]
    if not is_place(row[1:4]):
        words = f"Expected a latitude and a longitude in degrees, got {row[1]:g}, {row[2]:g}. Correct this line."
        refuse(file, number, words)
    if max(abs(angle) for angle in (0.0, *row[4:7]) if not math.isnan(angle)) > 2.5 * math.pi + 1e-6:
        words = "Expected angles within one turn. Are they degrees? Then name them roll_deg, pitch_deg, heading_deg."
        refuse(file, number, words)
    if min((0.0, *(sigma for sigma in row[7:] if not math.isnan(sigma)))) < 0.0:
        refuse(file, number, "Expected standard deviations >= 0, got a negative one. Correct or empty it.")
    row[4:6] = [0.0 if math.isnan(angle) else angle for angle in row[4:6]]
    return row
