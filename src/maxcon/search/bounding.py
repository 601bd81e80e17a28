# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How an objective is bounded: by the count of matches, or by N along two axes (design section 3, facts 1 and 2)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import BoundedByAxes, BoundedByCount, Scores
from maxcon.search.axis import Axis
from maxcon.search.found import Standing
from maxcon.search.limits import Limits
from maxcon.search.prepared_scan import PreparedScan

__all__ = ["Bounding", "ByAxes", "ByCount", "Summand", "bounding_of"]


@dataclass(frozen=True, slots=True)
class Summand:
    """The single number that a match adds to the sum of its cell.

    Parameters
    ----------
    axis : Axis, optional
        Along it: a match adds w (n . u)^2, its part of N along the axis u. Without one it adds 1.
    least : float
        Voxels with a (n . u)^2 of no more than this are not looked at; each scan point is charged with it instead.
    """

    axis: Axis | None = None
    least: float = 0.0

    @property
    def vector(self) -> tuple[np.float32, np.float32]:
        """Unit vector (x, y) of the axis; zeros where a match adds 1."""
        return (np.float32(0.0), np.float32(0.0)) if self.axis is None else self.axis.vector


class Bounding(Protocol):
    """What is summed over the matches of a cell, and what the cell scores at most for such sums.

    A new kind of bound is a class with these methods; `bounding_of` chooses it.
    """

    @property
    def prepared(self) -> PreparedScan:
        """The scan points that take part."""
        ...

    @property
    def total_weight(self) -> float:
        """Sum over all points of the largest weight that a match of each can have."""
        ...

    @property
    def weighed_normals(self) -> NDArray[np.float32]:
        """Normal of each point, and what is added to the weight of its matches, shape (n, 4)."""
        ...

    def summand(self, leader: Standing | None, asked: float, limits: Limits) -> Summand:
        """What to sum next, given the best cell so far and the score that cells must reach."""
        ...

    def across(self, summand: Summand) -> Summand | None:
        """What to sum after that, if a second sum makes the bound lower."""
        ...

    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells score whose matches add at most this, and at most that across."""
        ...


def bounding_of(objective: BoundedByCount | BoundedByAxes, prepared: PreparedScan) -> Bounding:
    """Return how an objective is bounded on a scan."""
    if isinstance(objective, BoundedByCount):
        return ByCount(objective, prepared)
    return ByAxes(objective, prepared.constraining())


@dataclass(frozen=True)
class ByCount:
    """Bounds by the number of matches: one sum, in which each match adds 1.

    Parameters
    ----------
    objective : BoundedByCount
        What a cell is worth.
    prepared : PreparedScan
        All points of the scan.
    """

    objective: BoundedByCount
    prepared: PreparedScan

    @property
    def total_weight(self) -> float:
        """The number of points."""
        return float(self.prepared.n_points)

    @cached_property
    def weighed_normals(self) -> NDArray[np.float32]:
        """No normals, shape (n, 4), and a weight of 1."""
        normals = np.zeros((self.prepared.n_points, 4), np.float32)
        normals[:, 3] = 1.0
        return normals

    def summand(self, leader: Standing | None, asked: float, limits: Limits) -> Summand:
        """Matches, whatever was found so far."""
        return Summand()

    def across(self, summand: Summand) -> None:
        """Nothing: the count has no second bound."""

    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells with at most so many matches score."""
        return self.objective.bound_by_count(sums)


@dataclass(frozen=True)
class ByAxes:
    """Bounds by N along two axes at right angles: first the axis that is determined least, then the one across it.

    Parameters
    ----------
    objective : BoundedByAxes
        What a cell is worth.
    prepared : PreparedScan
        The points that add to N.
    """

    objective: BoundedByAxes
    prepared: PreparedScan

    @cached_property
    def total_weight(self) -> float:
        """Length of the longest normal, at least 1, for each point with a normal; `without_normal` for each other."""
        squares = (self.prepared.normals * self.prepared.normals).sum(axis=0)
        n_without = int(np.count_nonzero(squares == 0.0))
        longest = math.sqrt(squares.max(initial=1.0))
        return (len(squares) - n_without) * longest + n_without * self.prepared.without_normal

    @cached_property
    def weighed_normals(self) -> NDArray[np.float32]:
        """Normals, shape (n, 4), and the weight of a match without one."""
        prepared = self.prepared
        normals = np.zeros((prepared.n_points, 4), np.float32)
        normals[:, :3] = prepared.normals.T
        normals[:, 3] = np.where(prepared.normals.any(axis=0), 0.0, prepared.without_normal)
        return normals

    def summand(self, leader: Standing | None, asked: float, limits: Limits) -> Summand:
        """N along the axis that the best cell so far determines least; before there is one, that of the scan."""
        if leader is not None and leader.score > 0.0:
            _, xx, xy, yy = leader.moments
            azimuth, _ = _weak_azimuth(xx, xy, yy)
            left_out = limits.left_out * asked
        else:
            azimuth, eigenvalue = _weak_azimuth(*self.prepared.spread.tolist())
            azimuth += self.prepared.prior.heading
            left_out = limits.left_out_of_scan * eigenvalue
        return Summand(Axis.near(azimuth), left_out / max(1.0, self.total_weight))

    def across(self, summand: Summand) -> Summand | None:
        """N along the other axis."""
        return None if summand.axis is None else Summand(summand.axis.across, summand.least)

    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells score which have at most this along the axes."""
        return self.objective.bound_by_axes(sums, sums_across)


def _weak_azimuth(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """Azimuth of the eigenvector of the smaller eigenvalue of a matrix, rad, and that eigenvalue."""
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    return azimuth, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
