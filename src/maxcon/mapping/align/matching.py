# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Matching: the pose of one visit to a place relative to another, by the adjustment of `refine`, and how sure it is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.mapping.align.corrections import Corrections, rotated
from maxcon.mapping.align.visits import Visit
from maxcon.refine import Refined, covariance, refine

__all__ = ["Tie", "match_visits", "motion"]

LEAST_PAUSE = 60.0
"""Visits of one round are matched if so much time, s, lies between them: until then errors hardly change."""
MATCH_FLOOR = 0.001
"""Smallest standard deviation of a match, m: two visits see different points of rough walls."""
LEAST_POINTS_ON_PLANES = 150
LEAST_SHARE = 0.3
"""Number and share of a visit's points that must lie on planes of the other: with fewer the match may be wrong."""
NORMAL_NOISE = math.radians(2.0)
"""Of fitted normals, rad. Such noise alone lets thousands of points on walls along a street seem to fix a position
along it."""
LEAST_OVER_NOISE = 5.0
"""A direction counts as not determined if the points give less than so many times the information of such noise."""
OPEN_SIGMA, OPEN_ARM = 1.0, 10.0
"""Standard deviation along such a direction, m: ten times a usual prior's. That of turns holds at this arm, m."""
FARTHEST = 0.6
"""Largest distance of a partner in the adjustment, m."""
MOST_VISITS = 8
"""All pairs of up to so many visits to a place are matched; of more visits, each with the next four."""


@dataclass(frozen=True, slots=True, eq=False)
class Tie:
    """The measured pose of one visit to a place relative to another: an edge of the pose graph.

    Parameters
    ----------
    place : array, shape (3,)
        Middle of the place, global, m.
    rounds : tuple of 2 int
        Numbers of the rounds.
    times : tuple of 2 float
        Of the visits, s.
    pose : Pose
        T_first_second, axes of the map, origin in the middle of the place: it moves points of the second visit onto
        surfaces of the first, both uncorrected.
    covariance : array, shape (6, 6)
        Of its x, y, z, roll, pitch and heading, m^2, m rad and rad^2.
    share : float
        Share of the second visit's points that lie on planes of the first.
    fault : str
        Why the match is not used; empty if it is.
    """

    place: NDArray[np.float64]
    rounds: tuple[int, int]
    times: tuple[float, float]
    pose: Pose
    covariance: NDArray[np.float64]
    share: float
    fault: str = ""


def match_visits(middle: NDArray[np.float64], visits: Sequence[Visit], corrections: Corrections) -> list[Tie]:
    """Match the visits to a place with each other.

    Parameters
    ----------
    middle : array, shape (3,)
        Of the place, global, m.
    visits : sequence of Visit
        In order of rounds and times.
    corrections : Corrections
        Corrections found so far: each match starts from poses corrected by them.

    Notes
    -----
    k visits have k (k - 1) / 2 pairs, but only k - 1 independent differences: covariances are made k / 2 times as
    large, so that all pairs together weigh as much as the independent ones.
    """
    pairs = _pairs(visits)
    matched = sorted({number for pair in pairs for number in pair})
    repetition = max(1.0, len(pairs) / max(1, len(matched) - 1))
    motions = {
        number: motion(corrections.twist_at(middle, visits[number].time, visits[number].round)) for number in matched
    }
    maps = {number: visits[number].point_map for number in sorted({one for one, _ in pairs})}
    scans = {number: visits[number].scan for number in sorted({other for _, other in pairs})}
    ties = []
    for one, other in pairs:
        start = motions[one].inverse @ motions[other]
        refined = refine(scans[other], maps[one], start)
        share = refined.n_planes / len(scans[other])
        known = repetition * covariance(refined, MATCH_FLOOR) + _open_covariance(refined)
        first, second = visits[one], visits[other]
        rounds, times = (first.round, second.round), (first.time, second.time)
        ties.append(Tie(middle, rounds, times, refined.pose, known, share, _fault(refined, share)))
    return ties


def motion(twist: NDArray[np.float64]) -> Pose:
    """The rigid motion of a shift (m) and a rotation vector (rad), shape (6,)."""
    return Pose.from_rotation(twist[:3], rotated(np.eye(3), np.tile(twist[3:], (3, 1))).T)


def _open_covariance(refined: Refined) -> NDArray[np.float64]:
    """Covariance (6, 6) to be added along directions that only the noise of normals seems to determine.

    A point on a plane of normal n adds n n' to the information on a shift; where n has noise of s (rad), on average
    n n' + s^2 (I - n n'). A direction in which the sum over all points hardly exceeds that of the second term is open.
    """
    from scipy.linalg import eigh

    rows = np.flatnonzero(refined.weights)
    if len(rows) < LEAST_POINTS_ON_PLANES:
        return np.zeros((6, 6))
    arms = refined.points[rows] @ refined.pose.rotation.T
    motions = np.zeros((len(rows), 3, 6))  # derivatives of each point by a shift and a turn
    motions[:, [0, 1, 2], [0, 1, 2]] = 1.0
    x, y, z = arms.T
    motions[:, 0, 4], motions[:, 0, 5] = z, -y
    motions[:, 1, 3], motions[:, 1, 5] = -z, x
    motions[:, 2, 3], motions[:, 2, 4] = y, -x
    roots = np.sqrt(refined.weights[rows])
    along = roots[:, None] * np.einsum("ni,nij->nj", refined.planes[rows, :3], motions)
    anyhow = (roots[:, None, None] * motions).reshape(-1, 6)
    noise = NORMAL_NOISE**2 * (anyhow.T @ anyhow - along.T @ along)
    over_noise, directions = eigh(along.T @ along, noise)
    opened = directions[:, over_noise < LEAST_OVER_NOISE]
    opened = opened / np.linalg.norm(opened * np.repeat([1.0, OPEN_ARM], 3)[:, None], axis=0)
    return np.asarray(OPEN_SIGMA**2 * opened @ opened.T)


def _pairs(visits: Sequence[Visit]) -> list[tuple[int, int]]:
    reach = len(visits) if len(visits) <= MOST_VISITS else MOST_VISITS // 2
    return [
        (one, other)
        for one in range(len(visits))
        for other in range(one + 1, min(one + 1 + reach, len(visits)))
        if visits[one].round != visits[other].round or visits[other].time - visits[one].time > LEAST_PAUSE
    ]


def _fault(refined: Refined, share: float) -> str:
    """Why a match is not used, in words; empty if it is."""
    if refined.n_planes < LEAST_POINTS_ON_PLANES or share < LEAST_SHARE:
        return "too few points of one lie on planes of the other"
    if refined.moved > FARTHEST:
        return "they lie farther apart than was looked"
    return ""
