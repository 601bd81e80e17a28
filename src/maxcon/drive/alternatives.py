# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""When no epoch of a drive is localized: would it be, were prior or scans meant otherwise? The usual slips."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.localize import MAP_MARGIN, EpochEstimate, Method
from maxcon.errors import FileError
from maxcon.estimate import Status
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import angles_from_quaternions, quaternions_from_angles
from maxcon.io.scans import Scans
from maxcon.map import PointMap
from maxcon.scan import Scan

__all__ = ["ALTERNATIVES", "Alternative", "alternative_that_fits"]

MOST_TRIED = 3
"""Epochs; all of them must be localized."""
WITHOUT_SEARCH = (Status.UNREADABLE, Status.NO_PRIOR, Status.OUTSIDE_MAP)

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Alternative:
    """Something that may be meant otherwise.

    Parameters
    ----------
    words : str
        What, and what to do about it, behind "it would be, ".
    prior : callable
        The prior, local frame, if it is meant so.
    points : callable
        The points of the scan, sensor frame, from those that were read, the prior and where the map's local frame lies
        in global coordinates.
    """

    words: str
    prior: Callable[[Pose], Pose] = lambda prior: prior
    points: Callable[[Points, Pose, Points], Points] = lambda points, prior, origin: points


def _scalar_first(prior: Pose) -> Pose:
    x, y, z, w = quaternions_from_angles(prior.roll, prior.pitch, prior.heading).tolist()
    roll, pitch, heading = angles_from_quaternions(np.array([y, z, w, x])).tolist()
    return replace(prior, roll=roll, pitch=pitch, heading=heading)


def _of_degrees(prior: Pose) -> Pose:
    roll, pitch, heading = (math.radians(angle) for angle in (prior.roll, prior.pitch, prior.heading))
    return replace(prior, roll=roll, pitch=pitch, heading=heading)


def _of_compass(prior: Pose) -> Pose:
    return replace(prior, heading=math.pi / 2.0 - prior.heading)


def _turned(roll_deg: float, heading_deg: float) -> Callable[[Pose], Pose]:
    turn = Pose(0.0, 0.0, 0.0, math.radians(roll_deg), 0.0, math.radians(heading_deg))
    return lambda prior: prior @ turn


def _turn(words: str, roll_deg: float, heading_deg: float) -> Alternative:
    return Alternative(
        f"were the sensor {words}: put that turn into the prior, T_map_sensor", _turned(roll_deg, heading_deg)
    )


ALTERNATIVES = (
    Alternative("were the quaternions of the prior qw qx qy qz: write them as qx qy qz qw", _scalar_first),
    Alternative(
        "were the headings of the prior those of a compass: a heading is 90 degrees less a bearing", _of_compass
    ),
    Alternative(
        "were the angles of the prior in degrees: name their columns roll_deg, pitch_deg, heading_deg", _of_degrees
    ),
    _turn("turned by 90 degrees to the left", 0.0, 90.0),
    _turn("turned by 90 degrees to the right", 0.0, -90.0),
    _turn("turned by 180 degrees", 0.0, 180.0),
    _turn("upside down", 180.0, 0.0),
    _turn("upside down and turned by 180 degrees", 180.0, 180.0),
    Alternative(
        "were the scans in global coordinates: write them in the sensor's frame",
        points=lambda points, prior, origin: prior.inverse.apply(points - origin),
    ),
    Alternative(
        "were the scans in the map's local frame: write them in the sensor's frame",
        points=lambda points, prior, origin: prior.inverse.apply(points),
    ),
)


def alternative_that_fits(
    point_map: PointMap,
    scans: Scans,
    epochs: Sequence[EpochEstimate],
    method: Method,
    min_range: float,
    max_range: float,
) -> str:
    """Return in words which alternative localizes all epochs that are tried; empty if there is none to try.

    Parameters
    ----------
    point_map, scans, method
        As the drive was localized with.
    epochs : sequence of EpochEstimate
        None of them localized.
    min_range, max_range : float
        Points nearer or farther than this are left out, m.
    """
    searched = [epoch for epoch in epochs if epoch.prior is not None and epoch.status not in WITHOUT_SEARCH]
    if not searched:
        return ""
    numbers = np.unique(np.linspace(0, len(searched) - 1, MOST_TRIED).round().astype(int))
    read = []
    for number in numbers.tolist():
        epoch = searched[number]
        try:
            read.append((epoch, scans.read(epoch.epoch, 0.0, math.inf)))
        except FileError:
            continue
    if not read:
        return ""
    for alternative in ALTERNATIVES:
        if all(
            _is_localized(alternative, raw.points, epoch.prior, raw.time, point_map, method, min_range, max_range)
            for epoch, raw in read
            if epoch.prior is not None
        ):
            return f"{len(read)} of {len(read)} tried would be localized {alternative.words}"
    return "meant otherwise (axes, angles, frames) they are not localized either"


def _is_localized(
    alternative: Alternative,
    points: Points,
    prior: Pose,
    time: float,
    point_map: PointMap,
    method: Method,
    min_range: float,
    max_range: float,
) -> bool:
    meant = alternative.prior(prior)
    points_sensor = alternative.points(points, prior, np.array(point_map.frame.origin))
    ranges = np.linalg.norm(points_sensor, axis=1)
    kept = points_sensor[(ranges >= min_range) & (ranges <= max_range)]
    if not (len(kept) and point_map.covers(meant.x, meant.y, MAP_MARGIN)):
        return False
    return method.localize(Scan(kept, time=time), point_map, meant).is_localized
