# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Priors in latitude, longitude and height, from tables and logs of receivers, in the coordinates of a map."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, TrajectoryError
from maxcon.geometry.quaternions import quaternions_from_angles
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Fixes, Heights, Orientations, PlacedFixes, is_place, place_fixes
from maxcon.io.nmea import is_nmea, read_nmea
from maxcon.io.pose_tables import UNCLEAR_HEADINGS, PoseTable, TableColumn, read_pose_table
from maxcon.io.text import numbered_lines
from maxcon.scan.trajectory import Trajectory

HEIGHT_COLUMNS = {
    "ellipsoidal_height": Heights.ELLIPSOIDAL,
    "orthometric_height": Heights.ORTHOMETRIC,
    "height": Heights.ELLIPSOIDAL,
}
"""What each name means; the first that is there counts."""
UNCLEAR_HEIGHTS = ("altitude", "alt", "elevation", "z", "h")
SIGMAS = (("sigma_east", "sigma_north"), ("sigma_x", "sigma_y"))


@dataclass(frozen=True, slots=True, eq=False)
class GeographicPrior:
    """Rough poses from positions in latitude, longitude and height.

    placed: in the coordinates of the map.
    words: where they come from, what headings and heights are, in a line.
    left_out: what is wrong with rows that are no positions.
    """

    placed: PlacedFixes
    words: str
    left_out: tuple[str, ...] = ()


class GeographicRows(NamedTuple):
    """Positions and orientations of a table, and what is wrong with rows that are no positions."""

    fixes: Fixes
    orientations: Orientations | None
    left_out: tuple[str, ...]


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
) -> GeographicPrior:
    """Return the poses in a log of NMEA sentences, or in a table with a column latitude.

    path: the file: see `read_nmea`, `read_geographic_csv`.
    crs: of the map, WKT or a code.
    geoid_height: of the geoid above the ellipsoid, m: subtracted from ellipsoidal heights.
    are_sure: whether headings are believed even if they are nothing like the course over ground.
    """
    if crs is None:
        raise CrsError(
            f"Expected a map with a CRS, to place {path}, which is in latitude and longitude; got one without. Build"
            " it with --crs."
        )
    frame = GeographicFrame(crs)
    if is_nmea(path):
        log = read_nmea(path)
        placed = place_fixes(log.fixes, log.orientations, frame, geoid_height, str(path), are_sure=are_sure)
        return GeographicPrior(placed, f"positions from {path.name} (NMEA); {log.words}; {placed.words}")
    rows = read_geographic_csv(path)
    placed = place_fixes(rows.fixes, rows.orientations, frame, geoid_height, str(path), are_sure=are_sure)
    return GeographicPrior(placed, f"positions from {path.name}; {placed.words}", rows.left_out)


def read_geographic_csv(file: Path) -> GeographicRows:
    """Return positions and orientations in a table.

    file: with a header: time (s), latitude, longitude (degrees), and ellipsoidal_height, orthometric_height or height
        (m; ellipsoidal). Then, where they are known, roll, pitch (rad; or roll_deg, pitch_deg), heading (rad,
        counter-clockwise from true east; or heading_deg) or azimuth_deg (clockwise from true north; or azimuth, rad),
        sigma_east, sigma_north (m), and sigma_heading (rad; or sigma_heading_deg). Rows without a latitude are left
        out.
    """
    table = read_pose_table(file, "positions")
    if not table.names:
        raise _no_position(file)
    height = _height_column(table)
    heading, is_compass = _heading(table)
    east, north = next((pair for pair in SIGMAS if any(name in table.names for name in pair)), SIGMAS[0])
    columns = {name: table.find(name) for name in ("time", "latitude", "longitude", height)}
    for name, column in columns.items():
        if column is None:
            table.refuse(f"Expected columns time, latitude, longitude and a height, got no {name!r}. Add it.")
    others = {name: table.find(name) for name in ("roll", "pitch", east, north, "sigma_heading")}
    for one, other in (("roll", "pitch"), (east, north)):
        if (others[one] is None) != (others[other] is None):
            table.refuse(f"Expected both {one} and {other}, or neither, got one. Add the other, or remove it.")

    n_rows = len(table.rows)
    table.keep(table.texts("latitude"))
    n_empty = n_rows - len(table.rows)
    places = np.column_stack([table.numbers([column], name) for name, column in columns.items()])
    sigmas = _optional(table, [others[east], others[north], others["sigma_heading"]])
    angles = _optional(table, [others["roll"], others["pitch"], heading])
    if is_compass:
        angles[:, 2] = math.pi / 2.0 - angles[:, 2]
    _check_rows(table, places, angles, sigmas)
    times, places, angles, sigmas = table.good(places[:, 0], places[:, 1:], angles, sigmas)
    left_out = table.told_faults()
    if len(left_out) > len(times):
        raise TrajectoryError(left_out[0])
    if not len(times):
        raise _no_position(file)
    late = np.flatnonzero(times[1:] <= times[:-1])
    if len(late):
        at = int(late[0]) + 1
        table.refuse(
            f"Expected times that increase, got {times[at]:.6f} s after {times[at - 1]:.6f} s. Sort the rows by time"
            " and keep one of each time.",
            table.lines[at],
        )
    covariances = np.zeros((len(times), 2, 2))
    covariances[:, [0, 1], [0, 1]] = sigmas[:, :2] ** 2
    covariances[np.isnan(sigmas[:, :2]).any(axis=1)] = np.nan
    fixes = Fixes(times, places, covariances, n_empty, HEIGHT_COLUMNS[height])
    return GeographicRows(fixes, _orientations(file.name, times, angles, sigmas[:, 2]), tuple(left_out))


def _no_position(file: Path) -> TrajectoryError:
    return TrajectoryError(f"{file}: Expected at least one position, got none. Was it written to its end?")


def _height_column(table: PoseTable) -> str:
    """Name of the column of heights; one that leaves open what they are counted from is refused."""
    height = next((name for name in HEIGHT_COLUMNS if name in table.names), None)
    if height is None:
        unclear = next((name for name in UNCLEAR_HEIGHTS if name in table.names), None)
        got = "none" if unclear is None else f"{unclear!r}, which may be either"
        table.refuse(
            f"Expected heights as ellipsoidal_height or orthometric_height (above the geoid), got {got}. Name the"
            " column so."
        )
    return height


def _heading(table: PoseTable) -> tuple[TableColumn | None, bool]:
    """The column of headings, and whether a compass counts them; names that leave that open are refused."""
    heading, azimuth = table.find("heading"), table.find("azimuth")
    if heading is not None and azimuth is not None:
        table.refuse("Expected either heading or azimuth, got both. Remove one.")
    unclear = next((name for name in UNCLEAR_HEADINGS if name in table.names), None)
    if heading is None and azimuth is None and unclear is not None:
        table.refuse(
            f"Expected headings as azimuth_deg (clockwise from true north) or heading_deg (counter-clockwise from true"
            f" east), got {unclear!r}, which may be either. Rename it."
        )
    return heading or azimuth, azimuth is not None


def _optional(table: PoseTable, columns: list[TableColumn | None]) -> NDArray[np.float64]:
    """Numbers of columns, a row each; NaN where a cell is empty or the column is not there."""
    names = [None if column is None else table.names[column.place] for column in columns]
    missing = np.full((len(table.rows), 1), np.nan)
    found = [
        missing if name is None else table.numbers([column], name, may_be_empty=True)
        for name, column in zip(names, columns, strict=True)
    ]
    return np.column_stack(found)


def _check_rows(
    table: PoseTable, places: NDArray[np.float64], angles: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> None:
    """Tell of rows that are no places, whose angles are degrees, or whose sigmas are negative."""
    is_wrong = np.array([not is_place(place) for place in places[:, 1:].tolist()], dtype=bool)
    table.add_faults(
        is_wrong,
        lambda row: (
            "Expected a latitude and a longitude in degrees, got"
            f" {places[row, 1]:g}, {places[row, 2]:g}. Correct this line."
        ),
    )
    table.add_faults(
        np.any(np.abs(angles) > 2.5 * math.pi + 1e-6, axis=1),
        "Expected angles within one turn. Are they degrees? Then name them roll_deg, pitch_deg, heading_deg.",
    )
    table.add_faults(
        np.any(sigmas < 0.0, axis=1), "Expected standard deviations >= 0, got a negative one. Correct or empty it."
    )


def _orientations(
    name: str, times: NDArray[np.float64], angles: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> Orientations | None:
    """Orientations of the rows that have a heading; roll and pitch that are not known are 0."""
    is_known = ~np.isnan(angles[:, 2])
    if not is_known.any():
        return None
    quaternions = quaternions_from_angles(*np.nan_to_num(angles[is_known]).T)
    zeros = np.zeros((len(quaternions), 3))
    return Orientations(name, Trajectory(times[is_known], zeros, quaternions), sigmas[is_known])
