# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Bounds: the most that cells can score, by the count of matches or by N along two axes (design section 3).

A *bound* is the most that a cell can score. It is made of a *sum*: the most that the matches of the cell can add up to.
Voxels that add little are left out of sums; the most that these could add is the *slack*, part of every bound.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maxcon.search.objectives import Bounded, BoundedByAxes, BoundedByCount, Moments, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search.scored_cells import CellGrid
from maxcon.search.space import Window

N_AXES = 64
"""The nearest of 64 axes is at most 1.4 degrees off, which hardly loosens a bound: (sin 1.4 deg)^2 is 0.0006."""

FINEST_UNIT = 2.0**-14
"""What matches add is rounded up to a multiple of this; finer would not fit into the sums of a scan."""

ROUNDING = 2e-6
"""Axes are unit vectors at right angles up to float32, weights and products of normals are float32: what that can
amount to, of the sum over all points. Some twenty roundings of 2^-24 add up to less."""


@dataclass(frozen=True, slots=True)
class Summand:
    """The single number that a match adds to the sum of its cell.

    axis: number of the axis u, of azimuth axis * pi / N_AXES: a match adds w (n . u)^2, its part of N along u. Without
        one it adds 1.
    least: voxels with a (n . u)^2, times how often the voxel counts, of no more than this are left out; the slack has
        this much for each scan point instead, as none falls in more than one voxel at one cell.
    """

    axis: int | None = None
    least: float = 0.0

    @property
    def vector(self) -> tuple[np.float32, np.float32]:
        """Unit vector (x, y) of the axis; zeros where a match adds 1."""
        if self.axis is None:
            return np.float32(0.0), np.float32(0.0)
        azimuth = self.axis * math.pi / N_AXES
        return np.float32(math.cos(azimuth)), np.float32(math.sin(azimuth))


@dataclass(frozen=True, slots=True, eq=False)
class CellSums:
    """What the matches of each cell of a window add up to at most: whole units of one size, and slack for all.

    summand: what was summed.
    units: the sums over the voxels that were not left out, in units.
    unit: one unit.
    slack: most that rounding, and the voxels that were left out, add to any sum.
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


@dataclass(frozen=True, eq=False)
class Bounding(ABC):
    """A kind of bound: what is summed over the matches of a cell, and the most that a cell with such sums scores.

    A new kind is a class with the five abstract methods; `bounding_of` chooses it.
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
    def summand(self, best: Moments | None, least_left_out: float, left_out_of_scan: float) -> Summand:
        """What to sum next, given the moments of the best cell so far, if any.

        All voxels left out together add less than `least_left_out` to a sum; or, before there is a best cell, than
        that fraction of what all points could add along the axis that they determine least.
        """

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

    def sum_up(self, headings: Headings, window: Window, summand: Summand, n_threads: int = 1) -> CellSums:
        """Sum up what the matches of all cells of a window at some headings add at most."""
        units = self.prepared.largest_sums(
            headings, window, self.weighed_normals, summand.vector, summand.least, self.unit, n_threads
        )
        grid = CellGrid(headings, window.first_cell(self.prepared.space), units)
        slack = self.most * ROUNDING + self.total_weight * summand.least * (1.0 + ROUNDING)
        return CellSums(summand, grid, self.unit * (1.0 + ROUNDING), slack)


@dataclass(frozen=True, eq=False)
class ByCount(Bounding):
    """Bounds by the number of matches of all points: one sum, in which each match adds 1."""

    objective: BoundedByCount

    @cached_property
    def total_weight(self) -> float:
        """The number of points."""
        return float(self.prepared.n_points)

    @cached_property
    def weighed_normals(self) -> NDArray[np.float32]:
        """No normals, and a weight of 1."""
        return np.tile(np.array([0.0, 0.0, 0.0, 1.0], np.float32), (self.prepared.n_points, 1))

    def summand(self, best: Moments | None, least_left_out: float, left_out_of_scan: float) -> Summand:
        """Matches, whatever was found so far."""
        return Summand()

    def across(self, summand: Summand) -> None:
        """Nothing: the count has no second bound."""

    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells with at most so many matches score."""
        return self.objective.bound_by_count(sums)


@dataclass(frozen=True, eq=False)
class ByAxes(Bounding):
    """Bounds by N along two axes at right angles, of the points that add to N.

    First the axis that is determined least, then the one across it.
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
        """Normals, and the weight of a match without one."""
        prepared = self.prepared
        normals = np.zeros((prepared.n_points, 4), np.float32)
        normals[:, :3] = prepared.normals.T
        normals[:, 3] = np.where(prepared.normals.any(axis=0), 0.0, prepared.without_normal)
        return normals

    def summand(self, best: Moments | None, least_left_out: float, left_out_of_scan: float) -> Summand:
        """N along the axis that the best cell so far determines least; before there is one, that of the scan."""
        if best is not None:
            _, xx, xy, yy = best
            azimuth, _ = _weak_azimuth(xx, xy, yy)
        else:
            azimuth, eigenvalue = _weak_azimuth(*self.prepared.spread.tolist())
            azimuth += self.prepared.prior.heading
            least_left_out = left_out_of_scan * eigenvalue
        return Summand(nearest_axis(azimuth), least_left_out / max(1.0, self.total_weight))

    def across(self, summand: Summand) -> Summand | None:
        """N along the other axis."""
        return None if summand.axis is None else Summand((summand.axis + N_AXES // 2) % N_AXES, summand.least)

    def upper(self, sums: Scores, sums_across: Scores) -> Scores:
        """Most that cells score which have at most this along the axes."""
        return self.objective.bound_by_axes(sums, sums_across)


def bounding_of(objective: Bounded, prepared: PreparedScan) -> Bounding:
    """Return the kind of bound that an objective has, for a prepared scan."""
    if isinstance(objective, BoundedByCount):
        return ByCount(prepared, objective)
    return ByAxes(prepared.constraining(), objective)


def nearest_axis(azimuth: float) -> int:
    """Return the number of the axis nearest to an azimuth, rad."""
    return round(azimuth / math.pi * N_AXES) % N_AXES


def _weak_azimuth(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """Azimuth of the eigenvector of the smaller eigenvalue of a matrix, rad, and that eigenvalue."""
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    return azimuth, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
