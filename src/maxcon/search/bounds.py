# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How an objective is bounded: by the count of matches, or by N along two axes (design section 3, facts 1 and 2).

A *bound* is the most that a cell can score. It is made of a *sum*: the most that the matches of the cell can add up to.
Voxels that add little are left out of sums; the most that these could add is the *slack*, part of every bound.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maxcon.search.axis import Axis
from maxcon.search.cells import CellGrid, Window
from maxcon.search.found import Standing
from maxcon.search.limits import Limits
from maxcon.search.objectives import Bounded, BoundedByAxes, BoundedByCount, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan

__all__ = ["Bounding", "ByAxes", "ByCount", "CellSums", "Summand", "bounding_of"]

FINEST_UNIT = 2.0**-14
"""What matches add is rounded up to a multiple of this; finer would not fit into the sums of a scan."""

ROUNDING = 2e-6
"""Axes are unit vectors at right angles up to float32, weights and products of normals are float32: what that can
amount to, of the sum over all points. Some twenty roundings of 2^-24 add up to less."""


@dataclass(frozen=True, slots=True)
class Summand:
    """The single number that a match adds to the sum of its cell.

    Parameters
    ----------
    axis : Axis, optional
        Along it: a match adds w (n . u)^2, its part of N along the axis u. Without one it adds 1.
    least : float
        Voxels with a (n . u)^2, times how often the voxel counts, of no more than this are left out; the slack has this
        much for each scan point instead, as none falls in more than one voxel at one cell.
    """

    axis: Axis | None = None
    least: float = 0.0

    @property
    def vector(self) -> tuple[np.float32, np.float32]:
        """Unit vector (x, y) of the axis; zeros where a match adds 1."""
        return (np.float32(0.0), np.float32(0.0)) if self.axis is None else self.axis.vector


@dataclass(frozen=True, slots=True)
class CellSums:
    """What the matches of each cell of a window at some headings add up to at most.

    Parameters
    ----------
    summand : Summand
        What was summed.
    units : CellGrid
        The sums over the voxels that were not left out, in whole units.
    unit : float
        One unit.
    slack : float
        Most that rounding, and the voxels that were left out, add to any sum.
    """

    summand: Summand
    units: CellGrid
    unit: float
    slack: float

    def __len__(self) -> int:
        return self.units.numbers.size

    def at(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Sums of some cells (n, 3) of the window."""
        sums: NDArray[np.float64] = self.units.at(cells).astype(np.float64) * self.unit + self.slack
        return sums

    def count_reaching(self, least: float) -> int:
        """How many cells have a sum of at least this."""
        return int(np.count_nonzero(self.units.numbers >= (least - self.slack) / self.unit))

    def reaching(self, least: float) -> tuple[NDArray[np.int64], float]:
        """Cells (n, 3), in index order, of a sum of at least this; and the highest sum of the others, 0 for none."""
        cells, highest = self.units.reaching((least - self.slack) / self.unit)
        return cells, 0.0 if highest is None else highest * self.unit + self.slack

    def highest(self, n_cells: int) -> NDArray[np.int64]:
        """The cells (n, 3) of the highest sums."""
        return self.units.highest(n_cells)


@dataclass(frozen=True)
class Bounding(ABC):
    """A kind of bound: what is summed over the matches of a cell, and the most that a cell with such sums scores.

    A new kind of bound is a class with the five abstract methods; `bounding_of` chooses it.

    Parameters
    ----------
    prepared : PreparedScan
        The scan points that take part.
    """

    prepared: PreparedScan

    @property
    @abstractmethod
    def total_weight(self) -> float:
        """Sum over all points of the largest weight that a match of each can have."""

    @property
    @abstractmethod
    def weighed_normals(self) -> NDArray[np.float32]:
        """Normal of each point, and what is added to the weight of its matches, shape (n, 4)."""

    @abstractmethod
    def summand(self, leader: Standing | None, asked: float, limits: Limits) -> Summand:
        """What to sum next, given the best cell so far and the score that cells must reach."""

    @abstractmethod
    def across(self, summand: Summand) -> Summand | None:
        """What to sum after that, if a second sum makes the bound lower."""

    @abstractmethod
    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells score whose matches add at most this, and at most that across."""

    @cached_property
    def fullest(self) -> int:
        """Map points in the fullest voxel, where a voxel counts as often as it has points, otherwise 1."""
        tiles = () if self.prepared.is_once else self.prepared.tiles.values()
        return max((tile.fullest for tile, _ in tiles), default=1)

    @property
    def most(self) -> float:
        """The sum of a cell at which every point matches, at most."""
        return self.total_weight * self.fullest * (1.0 + ROUNDING)

    @property
    def unit(self) -> float:
        """Unit of the sums, a power of two: they stay below 2^30 (2^62 for counts), and what is added below 2^22."""
        largest = 2.0**30 / max(1, self.prepared.n_points) if self.prepared.is_once else 2.0**22
        return max(FINEST_UNIT, math.ldexp(1.0, math.ceil(math.log2((self.fullest + 2.0) / largest))))

    def upper_along(self, sums: Scores) -> Scores:
        """Most that cells score whose matches add at most this, whatever they add across."""
        return self.upper(sums, np.full_like(sums, self.most))

    def least_sum(self, asked: float, n_steps: int) -> float:
        """Least sum with which a cell can reach a score, to be found in so many steps."""
        steps = np.linspace(0.0, self.most, n_steps)
        is_open = self.upper_along(steps) >= asked
        first_open = int(np.argmax(is_open)) if is_open.any() else n_steps
        return float(steps[max(first_open - 1, 0)])

    def sum_up(self, headings: Headings, window: Window, summand: Summand, n_threads: int = 1) -> "CellSums":
        """Sum up what the matches of all cells of a window at some headings add at most."""
        units = self.prepared.largest_sums(
            headings, window, self.weighed_normals, summand.vector, summand.least, self.unit, n_threads
        )
        grid = CellGrid.of(self.prepared.space, headings, window, units)
        slack = self.most * ROUNDING + self.total_weight * summand.least * (1.0 + ROUNDING)
        return CellSums(summand, grid, self.unit * (1.0 + ROUNDING), slack)


@dataclass(frozen=True)
class ByCount(Bounding):
    """Bounds by the number of matches: one sum, in which each match adds 1.

    Parameters
    ----------
    prepared : PreparedScan
        All points of the scan.
    objective : BoundedByCount
        What a cell is worth.
    """

    objective: BoundedByCount

    @cached_property
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
class ByAxes(Bounding):
    """Bounds by N along two axes at right angles: first the axis that is determined least, then the one across it.

    Parameters
    ----------
    prepared : PreparedScan
        The points that add to N.
    objective : BoundedByAxes
        What a cell is worth.
    """

    objective: BoundedByAxes

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


def bounding_of(objective: Bounded, prepared: PreparedScan) -> Bounding:
    """Return the kind of bound that an objective has, for a prepared scan."""
    if isinstance(objective, BoundedByCount):
        return ByCount(prepared, objective)
    return ByAxes(prepared.constraining(), objective)


def _weak_azimuth(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """Azimuth of the eigenvector of the smaller eigenvalue of a matrix, rad, and that eigenvalue."""
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    return azimuth, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
