# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses from positions in latitude and longitude, and orientations of an IMU where there are any."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.geometry.pose import wrap_angle
from maxcon.geometry.quaternions import angles_from_quaternions, quaternions_from_angles
from maxcon.io.crs import GeographicFrame
from maxcon.scan.trajectory import Trajectory, first_fault

BASELINE = 5.0
"""A course over ground is that between two positions so far apart, m."""
ALIKE = math.radians(30.0)
"""An IMU whose headings are farther from the course over ground, in the median, does not know where north is."""
COMPASS_ALIKE = math.radians(10.0)
"""Headings that are as near to it as this when bearings are read as headings, or the other way round, are such."""
ASSUMED_SIGMA = math.radians(2.0)
"""Of an IMU's heading, where it states none, rad."""
MAX_GAP = 0.5
"""Between two orientations to interpolate across, s."""
COURSE = "headings: course over ground"


class Heights(Enum):
    """What heights are counted from."""

    ELLIPSOIDAL = "ellipsoidal"
    ORTHOMETRIC = "above the geoid"


@dataclass(frozen=True, slots=True, eq=False)
class Fixes:
    """Positions of a receiver.

    times: shape (n,); s, strictly increasing.
    places: shape (n, 3); latitude, longitude (degrees), height (m).
    covariances: shape (n, 2, 2); of east and north, m^2; NaN where none is stated.
    n_left_out: messages without a fix.
    heights: what the heights are counted from.
    frame: name of the antenna's frame, where there are such.
    """

    times: NDArray[np.float64]
    places: NDArray[np.float64]
    covariances: NDArray[np.float64]
    n_left_out: int
    heights: Heights = Heights.ELLIPSOIDAL
    frame: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Orientations:
    """Orientations of an IMU towards east, north and up.

    topic: where they come from.
    trajectory: at the origin.
    sigmas: shape (n,); standard deviations of the heading, rad; NaN where none is stated.
    frame: name of the IMU's frame, where there are such.
    """

    topic: str
    trajectory: Trajectory
    sigmas: NDArray[np.float64]
    frame: str = ""


def is_place(place: list[float]) -> bool:
    """Whether latitude, longitude (degrees) and height (m) are a place; receivers without a fix say 0, 0."""
    return all(map(math.isfinite, place)) and abs(place[0]) <= 90.0 and abs(place[1]) <= 360.0 and place[:2] != [0, 0]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedFixes:
    """Poses in the coordinates of a map.

    trajectory: with covariances, where they are stated.
    words: what headings and heights are, in a line.
    heights: what heights are counted from that are taken as they are, though the map's CRS does not say what its own
        are.
    has_orientations: whether headings are measured; if not, they are the course over ground.
    """

    trajectory: Trajectory
    words: str
    heights: Heights | None
    has_orientations: bool


def place_fixes(
    fixes: Fixes,
    orientations: Orientations | None,
    frame: GeographicFrame,
    geoid_height: float | None,
    label: str,
    *,
    are_sure: bool = False,
) -> PlacedFixes:
    """Return poses in the map's CRS, and what is to be said of them.

    fixes: the positions.
    orientations: towards true north, where there are any.
    frame: of the map.
    geoid_height: of the geoid above the ellipsoid, m.
    label: where they come from, for messages.
    are_sure: whether orientations are believed even if they are nothing like the course over ground.
    """
    _check_heights(fixes, frame, geoid_height, label)
    positions = _positions(fixes, frame, geoid_height, label)
    courses = _courses(fixes.times, positions)
    turns = None if orientations is None else _of_imu(fixes, orientations, frame, None if are_sure else courses)
    is_course = turns is None or turns.words.startswith(COURSE)
    if turns is None:
        if courses is None:
            raise TrajectoryError(
                f"{label}: Expected orientations beside the positions, or a way of more than {BASELINE:g} m to tell"
                " headings from, got neither. Give the poses as a file: --prior."
            )
        level = quaternions_from_angles(0.0, 0.0, courses)
        turns = _Turns(np.arange(len(courses)), level, _course_sigmas(fixes), f"{COURSE}; roll and pitch 0")
    heights = _words_of_heights(fixes.heights, frame, geoid_height)
    left = f"; {fixes.n_left_out} messages without a fix left out" if fixes.n_left_out else ""
    return PlacedFixes(
        _trajectory(fixes, positions, turns, label),
        f"{turns.words}; heights: {heights}{left}",
        None if frame.has_heights or geoid_height is not None else fixes.heights,
        not is_course,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Turns:
    """Orientations of some of the fixes (rows) towards the axes of the map, sigmas of their headings, and in words."""

    rows: NDArray[np.intp]
    quaternions_xyzw: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    words: str


def _check_heights(fixes: Fixes, frame: GeographicFrame, geoid_height: float | None, label: str) -> None:
    """Refuse heights above the geoid where they would be mixed with ellipsoidal ones."""
    if fixes.heights is not Heights.ORTHOMETRIC:
        return
    if frame.has_ellipsoidal_heights and geoid_height is None:
        raise CrsError(
            f"Expected ellipsoidal heights as the map's CRS has, got heights above the geoid in {label}. Say how high"
            " the geoid is above the ellipsoid there: --geoid-height."
        )
    if geoid_height is not None and not frame.has_ellipsoidal_heights:
        raise OptionError(
            f"Expected --geoid-height with ellipsoidal heights, got it with heights above the geoid in {label}."
            " Leave it out."
        )


def _words_of_heights(kind: Heights, frame: GeographicFrame, geoid_height: float | None) -> str:
    if kind is Heights.ORTHOMETRIC and frame.has_ellipsoidal_heights:
        return f"above the geoid, and {geoid_height:g} m added"
    if kind is Heights.ORTHOMETRIC:
        return "above the geoid, as they are"
    if geoid_height is not None:
        return f"the receiver's (ellipsoidal) less {geoid_height:g} m"
    if frame.has_heights:
        return "the receiver's (ellipsoidal), turned into those of the map's CRS"
    return "the receiver's (ellipsoidal) as they are, for the map's CRS does not say what its own are"


def _positions(fixes: Fixes, frame: GeographicFrame, geoid_height: float | None, label: str) -> NDArray[np.float64]:
    """Return positions in the map's CRS, shape (n, 3), m; refuse such as fit it only the other way round, or not."""
    places, swapped = fixes.places, fixes.places[:, [1, 0]]
    got = f"got latitude {places[0, 0]:.5f}, longitude {places[0, 1]:.5f}"
    if not frame.contains(places).any() and frame.contains(swapped).all():
        raise TrajectoryError(
            f"{label}: Expected positions where the map's CRS is meant for, {got}. Are the two swapped? The other way"
            " round they would be."
        )
    if fixes.heights is Heights.ORTHOMETRIC and frame.has_ellipsoidal_heights:
        positions = frame.to_map(places + [0.0, 0.0, geoid_height or 0.0])
    else:
        positions = frame.to_map(places, 0.0 if fixes.heights is Heights.ORTHOMETRIC else geoid_height)
    if not np.isfinite(positions).all():
        raise TrajectoryError(
            f"{label}: Expected positions where the map's CRS is defined, {got}. Is it the right map?"
        )
    return positions


def _trajectory(fixes: Fixes, positions: NDArray[np.float64], turns: _Turns, label: str) -> Trajectory:
    rows = turns.rows
    covariances = np.zeros((len(rows), 3, 3))
    covariances[:, :2, :2] = fixes.covariances[rows]
    covariances[:, 2, 2] = turns.sigmas**2
    covariances[np.isnan(covariances).any(axis=(1, 2))] = np.nan
    known = None if np.isnan(covariances).all() else covariances
    fault = first_fault(fixes.times[rows], positions[rows], turns.quaternions_xyzw, known)
    if fault is not None:
        raise TrajectoryError(f"{label}, at {fixes.times[rows][fault.row]:.6f} s: {fault.words}")
    return Trajectory(fixes.times[rows], positions[rows], turns.quaternions_xyzw, known)


def _of_imu(
    fixes: Fixes, orientations: Orientations, frame: GeographicFrame, courses: NDArray[np.float64] | None
) -> _Turns | None:
    """What an IMU says; but for headings the course over ground, if these are nothing like it."""
    rows, turns, sigmas = _turns_at(fixes, orientations, frame)
    if not len(rows):
        return None
    if courses is not None:
        roll, pitch, headings = angles_from_quaternions(turns).T
        off = float(np.median(np.abs(wrap_angle(headings - courses[rows]))))
        if off > ALIKE:
            words = (
                f"{COURSE}, for those of {orientations.topic} are {math.degrees(off):.0f} degrees off"
                f" it{_of_a_compass(headings, courses[rows])}; roll and pitch of the latter"
            )
            turned = quaternions_from_angles(roll, pitch, courses[rows])
            return _Turns(rows, turned, _course_sigmas(fixes)[rows], words)
    words = f"orientations of {orientations.topic}"
    if np.isnan(sigmas).any():
        words += f", whose headings state no sigma: {math.degrees(ASSUMED_SIGMA):g} degrees assumed"
    return _Turns(rows, turns, np.where(np.isnan(sigmas), ASSUMED_SIGMA, sigmas), words)


def _of_a_compass(headings: NDArray[np.float64], courses: NDArray[np.float64]) -> str:
    """Say so where headings would be right if they were counted the other way, from the other axis."""
    off = float(np.median(np.abs(wrap_angle(np.pi / 2.0 - headings - courses))))
    if off > COMPASS_ALIKE:
        return ""
    return (
        f" (but {math.degrees(off):.0f} if they are mixed up: bearings count clockwise from north, headings"
        " counter-clockwise from east)"
    )


def _turns_at(
    fixes: Fixes, orientations: Orientations, frame: GeographicFrame
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Which fixes have an orientation; these in the axes of the map; and their sigmas."""
    trajectory = orientations.trajectory
    rows, angles = [], []
    for row, time in enumerate(fixes.times.tolist()):
        try:
            pose = trajectory.at(time, MAX_GAP)
        except TrajectoryError:
            continue
        rows.append(row)
        angles.append((pose.roll, pose.pitch, pose.heading))
    if not rows:
        return np.empty(0, np.intp), np.empty((0, 4)), np.empty(0)
    chosen = np.array(rows)
    turned = frame.quaternions_to_map(fixes.places[chosen], quaternions_from_angles(*np.array(angles).T))
    later = np.searchsorted(trajectory.times, fixes.times[chosen]).clip(max=len(trajectory) - 1)
    return chosen, turned, orientations.sigmas[later]


def _courses(times: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Direction of motion at each time, rad, unwrapped; None where the way is too short to tell."""
    anchors = [0]
    for row in range(1, len(times)):
        if math.dist(positions[row, :2], positions[anchors[-1], :2]) >= BASELINE:
            anchors.append(row)
    if len(anchors) < 2:
        return None
    steps = np.diff(positions[anchors, :2], axis=0)
    middles = (times[anchors][1:] + times[anchors][:-1]) / 2.0
    return np.interp(times, middles, np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))


def _course_sigmas(fixes: Fixes) -> NDArray[np.float64]:
    """Of the direction between two positions that err independently, rad; NaN where no covariance is stated."""
    larger = np.maximum(fixes.covariances[:, 0, 0], fixes.covariances[:, 1, 1])
    return np.sqrt(2.0 * np.maximum(larger, 0.0)) / BASELINE
