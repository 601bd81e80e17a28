"""Poses from positions in latitude and longitude, and orientations of an IMU where there are any."""

import math
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.geometry.pose import angles_from_quaternions, quaternions_from_angles, wrap_angle
from maxcon.io.crs import GeographicFrame, Operation
from maxcon.scan.trajectory import Trajectory, first_fault

BASELINE = 5.0  # a course over ground is that between two positions so far apart, m
ALIKE = math.radians(30.0)  # an IMU farther from the course over ground, in the median, does not know where north is
COMPASS_ALIKE = math.radians(10.0)  # as near to it, bearings that are read as headings are such, and vice versa
ASSUMED_SIGMA = math.radians(2.0)  # of an IMU's heading, where it states none, rad
MAX_GAP = 0.5  # between two orientations to interpolate across, s
COURSE = "headings: course over ground"


class Heights(Enum):
    """What heights are counted from."""

    ELLIPSOIDAL = "ellipsoidal"
    ORTHOMETRIC = "above the geoid"


@dataclass(frozen=True, slots=True, eq=False)
class Orientations:
    """Orientations of an IMU towards east, north and up."""

    topic: str  # where they come from
    trajectory: Trajectory  # at the origin
    sigmas: NDArray[np.float64]  # shape (n,); standard deviations of the heading, rad; NaN where none is stated
    frame: str = ""  # name of the IMU's frame, where there are such


@dataclass(frozen=True, slots=True, eq=False)
class ReceiverLog:
    """What a receiver measured."""

    times: NDArray[np.float64]  # shape (n,); s, strictly increasing
    places: NDArray[np.float64]  # shape (n, 3); latitude, longitude (degrees), height (m)
    covariances: NDArray[np.float64]  # shape (n, 2, 2); of east and north, m^2; NaN where none is stated
    n_left_out: int = 0  # messages without a fix
    heights: Heights = Heights.ELLIPSOIDAL  # what the heights are counted from
    orientations: Orientations | None = None  # of an IMU, where there is one
    words: str = ""  # what is to be said of it
    left_out: tuple[str, ...] = ()  # what is wrong with rows that are no positions


def covariances_of(sigmas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return covariances (n, 2, 2) of standard deviations of east and north, shape (n, 2); NaN where one is NaN."""
    covariances = np.eye(2) * np.square(sigmas)[:, None]
    covariances[np.isnan(sigmas).any(axis=1)] = np.nan
    return covariances


def is_place(place: list[float]) -> bool:
    """Whether latitude, longitude (degrees) and height (m) are a place; receivers without a fix say 0, 0."""
    return all(map(math.isfinite, place)) and abs(place[0]) <= 90.0 and abs(place[1]) <= 360.0 and place[:2] != [0, 0]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPoses:
    """Poses in the coordinates of a map, of a recording, a log or a table, and what is to be said of them.

    - trajectory: with covariances, where they are stated.
    - words: where they come from, what headings and heights are, in a line.
    - heights: what heights are counted from that are taken as they are, though the map's CRS does not say what its own
      are; else None.
    - has_orientations: whether headings are measured; if not, they are the course over ground.
    - position_frame, orientation_frame: names of the frames whose positions and whose orientations these are; empty
      where not told.
    - left_out: what is wrong with rows that are no poses.
    - operation: by which positions came into the map's CRS; None where none was needed.
    """

    trajectory: Trajectory
    words: str = ""
    heights: Heights | None = None
    has_orientations: bool = True
    position_frame: str = ""
    orientation_frame: str = ""
    left_out: tuple[str, ...] = ()
    operation: Operation | None = None


def place_fixes(
    log: ReceiverLog, frame: GeographicFrame, geoid_height: float | None, label: str, *, are_sure: bool = False
) -> RecordedPoses:
    """Return poses in the map's CRS; label: for messages, are_sure: orientations are not held against the course."""
    positions, words_of_heights = _positions(log, frame, geoid_height, label)
    courses = _courses(log.times, positions)
    imu = log.orientations
    measured = None if imu is None else _measured(log, imu, frame)
    others = ""
    if imu is None or measured is None:
        if courses is None:
            raise TrajectoryError(
                f"{label}: Expected orientations beside the positions, or a way of more than {BASELINE:g} m to tell"
                " headings from, got neither. Give the poses as a file: --prior."
            )
        others = f"{COURSE}; roll and pitch 0"
        measured = np.arange(len(courses)), np.tile([0.0, 0.0, 0.0, 1.0], (len(courses), 1)), np.empty(0), ""
    elif courses is not None and not are_sure:
        others = _words_of_others(imu.topic, measured[1], courses[measured[0]])
    rows, quaternions, sigmas, words = measured
    if courses is not None and others:
        roll, pitch, _ = angles_from_quaternions(quaternions).T
        quaternions = quaternions_from_angles(roll, pitch, courses[rows])
        # The sigma of a direction between two positions that err independently.
        larger = np.maximum(log.covariances[rows, 0, 0], log.covariances[rows, 1, 1])
        sigmas = np.sqrt(2.0 * np.maximum(larger, 0.0)) / BASELINE
    covariances = np.zeros((len(rows), 3, 3))
    covariances[:, :2, :2] = log.covariances[rows] + np.eye(2) * frame.shift_sigma**2
    covariances[:, 2, 2] = sigmas**2
    covariances[np.isnan(covariances).any(axis=(1, 2))] = np.nan
    known = None if np.isnan(covariances).all() else covariances
    inexact = "" if frame.operation is None or frame.operation.is_exact else f"; {frame.operation.words}"
    left = f"; {log.n_left_out} messages without a fix left out" if log.n_left_out else ""
    words = f"{log.words}; {others or words}; heights: {words_of_heights}{inexact}{left}"
    heights = None if frame.has_heights or geoid_height is not None else log.heights
    trajectory = checked_trajectory(label, log.times[rows], positions[rows], quaternions, known)
    return RecordedPoses(trajectory, words, heights, not others, left_out=log.left_out, operation=frame.operation)


def checked_trajectory(label: str, times: NDArray[np.float64], *others: Any) -> Trajectory:
    """Return a trajectory; TrajectoryError names where it comes from, and the time of a pose that cannot be used."""
    fault = first_fault(times, *others)
    if fault is not None:
        raise TrajectoryError(f"{label}, at {times[fault.row]:.6f} s: {fault.words}")
    return Trajectory(times, *others)


def _positions(
    log: ReceiverLog, frame: GeographicFrame, geoid_height: float | None, label: str
) -> tuple[NDArray[np.float64], str]:
    """Positions in the map's CRS, shape (n, 3), m, and what their heights are in words."""
    places, swapped = log.places, log.places[:, [1, 0]]
    got = f"got latitude {places[0, 0]:.5f}, longitude {places[0, 1]:.5f}"
    if not frame.contains(places).any() and frame.contains(swapped).all():
        raise TrajectoryError(
            f"{label}: Expected positions where the map's CRS is meant for, {got}. Are the two swapped? The other way"
            " round they would be."
        )
    if log.heights is Heights.ELLIPSOIDAL:
        positions, words = frame.to_map(places, geoid_height), "the receiver's (ellipsoidal)"
        if geoid_height is not None:
            words += f" less {geoid_height:g} m"
        elif frame.has_heights:
            words += ", turned into those of the map's CRS"
        else:
            words += " as they are, for the map's CRS does not say what its own are"
    elif frame.has_ellipsoidal_heights:
        if geoid_height is None:
            raise CrsError(
                f"Expected ellipsoidal heights as the map's CRS has, got heights above the geoid in {label}. Say how"
                " high the geoid is above the ellipsoid there: --geoid-height."
            )
        positions = frame.to_map(places + [0.0, 0.0, geoid_height])
        words = f"above the geoid, and {geoid_height:g} m added"
    else:
        if geoid_height is not None:
            raise OptionError(
                f"Expected --geoid-height with ellipsoidal heights, got it with heights above the geoid in {label}."
                " Leave it out."
            )
        positions, words = frame.to_map(places, 0.0), "above the geoid, as they are"
    if not np.isfinite(positions).all():
        raise TrajectoryError(f"{label}: Expected positions where the map's CRS is defined, {got}. Is this the map?")
    return positions, words


def _words_of_others(topic: str, quaternions_xyzw: NDArray[np.float64], courses: NDArray[np.float64]) -> str:
    """Words that say that headings of an IMU differ from the course over ground, which is used; empty if they agree."""
    headings = angles_from_quaternions(quaternions_xyzw)[:, 2]
    off = float(np.median(np.abs(wrap_angle(headings - courses))))
    if off <= ALIKE:
        return ""
    mixed_up = float(np.median(np.abs(wrap_angle(np.pi / 2.0 - headings - courses))))
    compass = (
        f" (but {math.degrees(mixed_up):.0f} if they are mixed up: bearings count clockwise from north,"
        " headings counter-clockwise from east)"
    )
    return (
        f"{COURSE}, for those of {topic} are {math.degrees(off):.0f} degrees"
        f" off it{compass if mixed_up <= COMPASS_ALIKE else ''}; roll and pitch of the latter"
    )


def _measured(
    log: ReceiverLog, imu: Orientations, frame: GeographicFrame
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], str] | None:
    """Which positions have an orientation; these in the axes of the map; sigmas of their headings; all in words."""
    rows: list[int] = []
    angles = []
    for row, time in enumerate(log.times.tolist()):
        with suppress(TrajectoryError):
            angles.append(imu.trajectory.at(time, MAX_GAP).values[3:])
            rows.append(row)
    if not rows:
        return None
    turned = frame.quaternions_to_map(log.places[rows], quaternions_from_angles(*np.array(angles).T))
    later = np.searchsorted(imu.trajectory.times, log.times[rows]).clip(max=len(imu.trajectory) - 1)
    sigmas, words = imu.sigmas[later], f"orientations of {imu.topic}"
    if np.isnan(sigmas).any():
        words += f", whose headings state no sigma: {math.degrees(ASSUMED_SIGMA):g} degrees assumed"
    return np.array(rows), turned, np.where(np.isnan(sigmas), ASSUMED_SIGMA, sigmas), words


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
