# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rough poses from positions in latitude and longitude, of tables and logs of receivers, in a map's coordinates."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, TrajectoryError
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.crs import GeographicFrame
from maxcon.io.fixes import Heights, Orientations, ReceiverLog, RecordedPoses, covariances_of, is_place, place_fixes
from maxcon.io.nmea import is_nmea, read_nmea
from maxcon.io.text import UNCLEAR_HEADINGS, PoseTable, numbered_lines, read_pose_table
from maxcon.scan.trajectory import Trajectory, first_fault

HEIGHT_COLUMNS = {
    "ellipsoidal_height": Heights.ELLIPSOIDAL,
    "orthometric_height": Heights.ORTHOMETRIC,
    "height": Heights.ELLIPSOIDAL,
}
"""What each name means; the first that is there counts."""
UNCLEAR_HEIGHTS = ("altitude", "alt", "elevation", "z", "h")
SIGMAS = (("sigma_east", "sigma_north"), ("sigma_x", "sigma_y"))


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
    log = read_nmea(path) if is_nmea(path) else read_geographic_csv(path)
    words = f"positions from {path.name}" + (f" (NMEA); {log.words}" if log.words else "")
    return place_fixes(replace(log, words=words), GeographicFrame(crs), geoid_height, str(path), are_sure=are_sure)


def read_geographic_csv(file: Path) -> ReceiverLog:
    """Return positions and orientations in a table.

    file: with a header: time (s), latitude, longitude (degrees), and ellipsoidal_height, orthometric_height or height
        (m; ellipsoidal). Then, where they are known, roll, pitch (rad; or roll_deg, pitch_deg), heading (rad,
        counter-clockwise from true east; or heading_deg) or azimuth_deg (clockwise from true north; or azimuth, rad),
        sigma_east, sigma_north (m), and sigma_heading (rad; or sigma_heading_deg). Rows without a latitude are left
        out.
    """
    table = read_pose_table(file, "positions")
    if not table.names:
        raise TrajectoryError(f"{file}: Expected at least one position, got none. Was it written to its end?")
    sigma_names = next((pair for pair in SIGMAS if any(name in table.names for name in pair)), SIGMAS[0])
    height, heading = _check_header(table, sigma_names)
    n_rows = len(table.rows)
    table.keep(table.texts("latitude"))
    n_empty = n_rows - len(table.rows)
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
