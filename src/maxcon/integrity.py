"""Whether an answer may be trusted: thresholds and statuses, reasons to doubt, protection levels."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, fields
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.estimate import Status
from maxcon.geometry import Pose, rotation_matrices
from maxcon.scan import Scan
from maxcon.search.objectives import SINGULAR_RATIO, Moments, Scores
from maxcon.search.space import Cell, SearchSpace

# Less than one full match in the least determined direction does not fix a position, nor does what a single
# wall's matches add there when their normals are 3 degrees off: sin^2 of that, of each.
LEAST_EIGENVALUE = 1.0
LEAST_EIGENVALUE_RATIO = math.sin(math.radians(3.0)) ** 2

# Of real scans of 16 rings at least FEWEST_NORMALS of the points have a normal, and FEWEST_HORIZONTAL of the points
# a horizontal one, within 30 degrees.
FEWEST_POINTS = 500
FEWEST_NORMALS = 0.1
FEWEST_HORIZONTAL = 0.03
HORIZONTAL = math.sin(math.radians(30.0))
# An answer that so few full matches carry along its least determined direction rests on a single small surface.
FEWEST_CARRYING = 10.0
# Trials leave this ratio of wrong answers among those localized possible, with 95 % confidence (D12).
WRONG_PLACE = 0.005

RATIOS = ("least_share", "largest_runner_up", "least_wall_share", "least_confirmed_share")


@dataclass(frozen=True, slots=True)
class Trust:
    """Thresholds that an answer has to meet to be called localized; the status says which it did not meet.

    Parameters
    ----------
    least_share : float
        At least this ratio of the scan's points must match the map at the best cell, 0 to 1; else *few matches*.
    largest_runner_up : float
        Helmert's score of the second best candidate over that of the best cell may be at most this, 0 to 1; else
        *ambiguous*. With 1 an answer is never ambiguous, unless the second best scores higher.
    guard_radius : float
        The second best lies farther than this from the best cell, m: a peak that is half a metre wide is a
        matter of precision, not of another candidate.
    least_wall_share : float
        At least this ratio of the wall points of each orientation bin must lie on walls of the map at the refined pose,
        0 to 1; else a wider search has to find the same pose, or it is *walls missing*.
    least_confirmed_share : float
        The same once a wider search found the same pose.
    fewest_planes : int
        At least so many points must lie on planes of the map at the refined pose; else *not confirmed*.
    farthest_move : float
        The refined pose may lie at most so far from the best cell, m; else *not confirmed*.
    largest_misfit : float
        The worst test of the fit (`maxcon.refine.fit`), over its limit, may be at most this; else *misfit*. With 1 the
        limits are as they were fitted to right answers, with infinity no answer is refused for them.

    Raises
    ------
    OptionError
        If a value is out of its range.
    """

    least_share: float = 0.05
    largest_runner_up: float = 0.8
    guard_radius: float = 0.5
    least_wall_share: float = 0.05
    least_confirmed_share: float = 0.02
    fewest_planes: int = 50
    farthest_move: float = 0.25
    largest_misfit: float = 1.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value, is_ratio = getattr(self, each.name), each.name in RATIOS
            largest = math.inf if each.name == "largest_misfit" else sys.float_info.max
            if not 0.0 <= value <= (1.0 if is_ratio else largest):
                range_ = "from 0 to 1" if is_ratio else ">= 0"
                raise OptionError(f"Expected `{each.name}` {range_}, got {value}. The default is {each.default}.")

    def status_of_cell(self, *, is_determined: bool, share: float, is_at_boundary: bool, runner_up: float) -> Status:
        """Return the status of a best cell that has matches."""
        if not is_determined:
            return Status.UNDETERMINED
        if share < self.least_share:
            return Status.FEW_MATCHES
        if is_at_boundary:
            return Status.AT_RIM
        if runner_up > self.largest_runner_up:
            return Status.AMBIGUOUS
        return Status.LOCALIZED

    def status_of_pose(self, *, n_planes: int, moved: float, wall_share: float | None, is_confirmed: bool) -> Status:
        """Return the status of an answer that is localized so far, after its pose was adjusted to the map.

        `n_planes` points lie on planes of the map, the pose moved by `moved` m from the cell, and `is_confirmed` says
        whether a wider search found the same pose. `wall_share` is the least fraction of wall points found of all
        orientation bins, None where no bin has enough.
        """
        if n_planes < self.fewest_planes or moved > self.farthest_move:
            return Status.NOT_CONFIRMED
        if wall_share is None:
            return Status.LOCALIZED if is_confirmed else Status.WALLS_MISSING
        least = self.least_confirmed_share if is_confirmed else self.least_wall_share
        return Status.LOCALIZED if wall_share >= least else Status.WALLS_MISSING


def reasons_to_doubt_scan(scan: Scan, prior: Pose) -> list[str]:
    """What is unusual about a scan, in words that name the likely cause; nothing for an ordinary one.

    Roll and pitch of the prior say what is horizontal.
    """
    n_points = len(scan)
    if n_points < FEWEST_POINTS:
        return [f"only {n_points} points: is the scan cut, or are range limits too narrow?"]
    from maxcon.scan.normal_kernels import count_normals

    up = rotation_matrices(prior.roll, prior.pitch, 0.0)[2]
    n_normals, n_horizontal = count_normals(scan.sample.normals, up, HORIZONTAL)
    share, horizontal = n_normals / len(scan.sample), n_horizontal / len(scan.sample)
    if share >= FEWEST_NORMALS and horizontal >= FEWEST_HORIZONTAL:
        return []
    level = "none horizontal" if n_horizontal == 0 else f"horizontal ones on {100.0 * horizontal:.1f} %"
    cause = "few walls around, single rings, or a sensor frame that is not z up?"
    return [f"normals on {100.0 * share:.0f} % of the points, {level}: {cause}"]


def reasons_to_doubt_answer(moments: Moments) -> list[str]:
    """Whether few matches fix the position in some direction, in words; from moments, shape (4,), a voxel once."""
    _, nxx, nxy, nyy = (float(moment) for moment in moments)
    (smallest, _), vectors = np.linalg.eigh(np.array([[nxx, nxy], [nxy, nyy]]))
    if not 0.0 < smallest < FEWEST_CARRYING:
        return []
    azimuth = math.degrees(math.atan2(vectors[1, 0], vectors[0, 0])) % 180.0
    return [f"only {smallest:.1f} full matches fix the position along {azimuth:.0f} degrees from +x (of 180)"]


def invert(normal_matrix: NDArray[np.float64]) -> tuple[bool, NDArray[np.float64]]:
    """Whether N determines x and y, and Q = N^-1 (equation (4)); infinite variances where it is singular."""
    smallest, largest = np.linalg.eigvalsh(normal_matrix)
    if smallest <= SINGULAR_RATIO * largest:
        return False, np.diag([np.inf, np.inf])
    is_determined = smallest >= max(LEAST_EIGENVALUE, LEAST_EIGENVALUE_RATIO * largest)
    return bool(is_determined), np.asarray(np.linalg.inv(normal_matrix), dtype=np.float64)


def protection_level(covariance: NDArray[np.float64], heading: float, risk: float) -> tuple[float, float]:
    """How large the error of a localized pose may be, along and across its heading, m, with at most a stated risk.

    Part of the risk is that of a wrong candidate, `WRONG_PLACE`: no level covers that, so that it is infinite
    where the stated risk is smaller. The rest is shared by the two directions, normally distributed. `covariance` is
    that of x, y, z, roll, pitch and heading in map axes, shape (6, 6); `heading` in rad; `risk` above 0 and below 1.
    """
    left = risk - WRONG_PLACE
    if left <= 0.0:
        return math.inf, math.inf
    factor = NormalDist().inv_cdf(1.0 - left / 4.0)  # two directions, two sides
    variance_along, variance_across = np.diag(along_and_across(covariance, heading)).tolist()
    return factor * math.sqrt(variance_along), factor * math.sqrt(variance_across)


def along_and_across(covariance: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """Covariance of the errors along and across a heading (rad), shape (2, 2), from one of x, y, ..., map axes."""
    cosine, sine = math.cos(heading), math.sin(heading)
    axes = np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(axes @ covariance[:2, :2] @ axes.T, dtype=np.float64)


def highest_beyond(scores: Scores, cell: Cell, space: SearchSpace, guard_radius: float) -> float:
    """Return the highest of scores (headings, ny, nx) farther than the guard radius (m) from a cell; 0 for none."""
    return float(scores.max(axis=0).max(where=is_beyond(cell, space, guard_radius), initial=0.0))


def is_beyond(cell: Cell, space: SearchSpace, guard_radius: float) -> NDArray[np.bool_]:
    """Whether each offset, shape (ny, nx), lies farther than the guard radius (m) from a cell."""
    _, ny, nx = space.shape
    distance = np.hypot(np.arange(ny)[:, None] - cell[1], np.arange(nx)[None, :] - cell[2]) * space.cell_edge
    return np.asarray(distance > guard_radius)
