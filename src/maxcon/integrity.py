# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether the best cell of a search may be trusted, and in which word it may not."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.estimate import Status
from maxcon.objectives import SINGULAR_RATIO, Scores
from maxcon.search_space import Cell, SearchSpace

__all__ = ["Trust", "highest_beyond", "invert", "runner_up_ratio"]

# Less than one full match in the least determined direction does not fix a position, nor does what a single
# wall's matches add there when their normals are 3 degrees off: sin^2 of that, of each.
LEAST_EIGENVALUE = 1.0
LEAST_EIGENVALUE_RATIO = math.sin(math.radians(3.0)) ** 2


@dataclass(frozen=True, slots=True)
class Trust:
    """From where on an answer is not trusted.

    Parameters
    ----------
    least_share : float
        Of the scan's points, so many must match the map at the best cell, 0 to 1.
    largest_runner_up : float
        Helmert's score of the runner-up over that of the best cell may reach this, 0 to 1; with 1 an
        answer is never ambiguous, unless the runner-up scores higher.
    guard_radius : float
        The runner-up lies farther than this from the best cell, m: a peak that is half a metre wide is a
        matter of precision, not of another place.

    Raises
    ------
    OptionError
        If a value is out of its range.
    """

    least_share: float = 0.05
    largest_runner_up: float = 0.8
    guard_radius: float = 0.5

    def __post_init__(self) -> None:
        for name in ("least_share", "largest_runner_up"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise OptionError(
                    f"Expected `{name}` from 0 to 1, got {value}. The default is {getattr(Trust(), name)}."
                )
        if not 0.0 <= self.guard_radius < math.inf:
            raise OptionError(f"Expected `guard_radius` >= 0 m, got {self.guard_radius}. The default is 0.5.")

    def judge(self, *, is_determined: bool, share: float, is_at_rim: bool, runner_up: float) -> Status:
        """Return the status of a best cell that has matches."""
        if not is_determined:
            return Status.UNDETERMINED
        if share < self.least_share:
            return Status.FEW_MATCHES
        if is_at_rim:
            return Status.AT_RIM
        if runner_up > self.largest_runner_up:
            return Status.AMBIGUOUS
        return Status.LOCALIZED


def invert(normal_matrix: NDArray[np.float64]) -> tuple[bool, NDArray[np.float64]]:
    """Whether N determines x and y, and Q = N^-1 (equation (4)); infinite variances where it is singular."""
    smallest, largest = np.linalg.eigvalsh(normal_matrix)
    if smallest <= SINGULAR_RATIO * largest:
        return False, np.diag([np.inf, np.inf])
    is_determined = smallest >= max(LEAST_EIGENVALUE, LEAST_EIGENVALUE_RATIO * largest)
    return bool(is_determined), np.asarray(np.linalg.inv(normal_matrix), dtype=np.float64)


def runner_up_ratio(scores: Scores, cell: Cell, space: SearchSpace, guard_radius: float) -> float:
    """Score of the second highest place over that of `cell` (design, section 4: peak ratio).

    Parameters
    ----------
    scores : array, shape (headings, ny, nx)
        Scores of all cells, not negative.
    cell : tuple of 3 int
        The best cell.
    space : SearchSpace
        The cells.
    guard_radius : float
        Places nearer to the best cell do not count, m.

    Returns
    -------
    float
        The highest local maximum over all headings, outside the guard radius, over the score of `cell`;
        0 where there is none, infinity where `cell` scores 0.
    """
    if scores[cell] <= 0.0:
        return math.inf
    highest = scores.max(axis=0)
    ny, nx = highest.shape
    padded = np.pad(highest, 1, constant_values=-np.inf)
    around = np.max([padded[y : y + ny, x : x + nx] for y in range(3) for x in range(3)], axis=0)
    is_rival = (highest == around) & _is_beyond(cell, space, guard_radius)
    return float(highest[is_rival].max(initial=0.0) / scores[cell])


def highest_beyond(scores: Scores, cell: Cell, space: SearchSpace, guard_radius: float) -> float:
    """Return the highest score of any cell farther than the guard radius from one, at any heading; 0 for none.

    Parameters
    ----------
    scores : array, shape (headings, ny, nx)
        Scores of all cells.
    cell : tuple of 3 int
        The cell.
    space : SearchSpace
        The cells.
    guard_radius : float
        Places nearer to the cell do not count, m.
    """
    return float(scores.max(axis=0).max(where=_is_beyond(cell, space, guard_radius), initial=0.0))


def _is_beyond(cell: Cell, space: SearchSpace, guard_radius: float) -> NDArray[np.bool_]:
    """Whether each place, shape (ny, nx), lies farther than the guard radius (m) from a cell."""
    _, ny, nx = space.shape
    distance = np.hypot(np.arange(ny)[:, None] - cell[1], np.arange(nx)[None, :] - cell[2]) * space.cell
    return np.asarray(distance > guard_radius)
