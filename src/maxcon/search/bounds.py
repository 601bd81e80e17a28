"""Bounds: the most that cells can score, by the count of matches or by N along two axes (design section 3).

A *bound* is the most that a cell can score. It is made of a *sum*: the most that the matches of the cell can add up to.
Voxels that add little are left out of sums; the most that these could add is the *slack*, part of every bound.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from maxcon.search.objectives import Bounded, BoundedByAxes, BoundedByCount, Moments, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan

N_AXES = 64
"""The nearest of 64 axes is at most 1.4 degrees off, which hardly loosens a bound: (sin 1.4 deg)^2 is 0.0006."""

FINEST_UNIT = 2.0**-14
"""What matches add is rounded up to a multiple of this; finer would not fit into the sums of a scan."""

FLOAT32_ERRORS = 2e-6
"""Axes are unit vectors at right angles up to float32, weights and products of normals are float32: what that can
amount to, of the sum over all points. Some twenty roundings of 2^-24 add up to less."""

LEFT_OUT, LEFT_OUT_OF_SCAN = 0.1, 0.01
"""Voxels are left out of sums if all of them add less than this fraction of the asked score; or, before any cell is
scored, of what all points could add along the axis that they determine least."""

SUM_STEPS = 4096  # steps in which the least sum is sought with which a cell can reach the asked score


@dataclass(frozen=True, slots=True)
class Summand:
    """What a match adds to its cell's sum: w (n . u)^2, u of azimuth axis * pi / N_AXES, or 1 without an axis.

    Voxels with no more than `least`, times how often they count, are left out; the slack has this for each scan point.
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
    """What the matches of each cell at some headings add up to at most: whole units of one size, and slack for all."""

    summand: Summand
    headings: Headings  # (h,), in order
    units: NDArray[np.signedinteger]  # (h, ny, nx), over the voxels that were not left out
    unit: float
    slack: float  # most that rounding, and what was left out, add to any sum

    def at(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Sums of some cells (n, 3) of these headings."""
        units = self.units[np.searchsorted(self.headings, cells[:, 0]), cells[:, 1], cells[:, 2]]
        sums: NDArray[np.float64] = units.astype(np.float64) * self.unit + self.slack
        return sums

    def reaching(self, least: float) -> tuple[NDArray[np.int64], float]:
        """Cells (n, 3), in index order, of a sum of at least this; and the highest sum of the others, 0 for none."""
        is_reached = self.units >= (least - self.slack) / self.unit
        cells = self._cells(np.nonzero(is_reached))
        if len(cells) == self.units.size:
            return cells, 0.0
        highest = self.units.max(where=~is_reached, initial=0) if len(cells) else self.units.max()
        return cells, float(highest) * self.unit + self.slack

    def highest(self, n_cells: int) -> NDArray[np.int64]:
        """The cells (n, 3) of the highest sums; from the rows that have the highest ones."""
        highest_of_rows = self.units.max(axis=2)
        n_rows = min(n_cells, highest_of_rows.size)
        rows = np.unravel_index(np.argpartition(highest_of_rows, -n_rows, axis=None)[-n_rows:], highest_of_rows.shape)
        units = self.units[rows]
        n_cells = min(n_cells, units.size)
        numbers, x = np.divmod(np.argpartition(units, -n_cells, axis=None)[-n_cells:], units.shape[1])
        return self._cells((rows[0][numbers], rows[1][numbers], x))

    def _cells(self, index: tuple[NDArray[np.int64], ...]) -> NDArray[np.int64]:
        """Cells (n, 3) of the space, from their index in `units`."""
        heading, y, x = index
        return np.stack([self.headings[heading], y, x], axis=1)


@dataclass(frozen=True, eq=False)
class Bounding(ABC):
    """What is summed over the matches of a cell, and the most that a cell scores; `bounding_of` chooses the kind."""

    prepared: PreparedScan
    weight: ClassVar[float | None] = None
    """Of all matches; None for that of their normals."""

    @property
    @abstractmethod
    def total_weight(self) -> float:
        """Sum over all points of the largest weight that a match of each can have."""

    @abstractmethod
    def summand(self, best: Moments | None, asked: float) -> Summand:
        """What to sum next, given the moments of the best cell so far, if any, and the score that is asked for."""

    @abstractmethod
    def upper(self, sums: Scores) -> Scores:
        """Most that cells score whose matches add at most this."""

    @cached_property
    def fullest(self) -> int:
        """Map points in the fullest voxel, where a voxel counts as often as it has points, otherwise 1."""
        tiles = () if self.prepared.is_once else self.prepared.tiles.values()
        return max((tile.fullest for tile in tiles), default=1)

    @property
    def most(self) -> float:
        """The sum of a cell at which every point matches, at most."""
        return self.total_weight * self.fullest * (1.0 + FLOAT32_ERRORS)

    @property
    def unit(self) -> float:
        """Unit of the sums, a power of two: they stay below 2^30 (2^62 for counts), and what is added below 2^22."""
        largest = 2.0**30 / max(1, self.prepared.n_points) if self.prepared.is_once else 2.0**22
        return max(FINEST_UNIT, math.ldexp(1.0, math.ceil(math.log2((self.fullest + 2.0) / largest))))

    def least_sum(self, asked: float) -> float:
        """Least sum with which a cell can reach a score, or a little less."""
        steps = np.linspace(0.0, self.most, SUM_STEPS)
        is_open = self.upper(steps) >= asked
        first_open = int(np.argmax(is_open)) if is_open.any() else SUM_STEPS
        return float(steps[max(first_open - 1, 0)])

    def sum_up(self, headings: Headings, summand: Summand, n_threads: int = 1) -> CellSums:
        """Sum up what the matches of all cells at some headings add at most."""
        units = self.prepared.largest_sums(headings, self.weight, summand.vector, summand.least, self.unit, n_threads)
        slack = self.most * FLOAT32_ERRORS + self.total_weight * summand.least * (1.0 + FLOAT32_ERRORS)
        return CellSums(summand, headings, units, self.unit * (1.0 + FLOAT32_ERRORS), slack)


@dataclass(frozen=True, eq=False)
class ByCount(Bounding):
    """Bounds by the number of matches of all points: one sum, in which each match adds 1."""

    objective: BoundedByCount
    weight: ClassVar[float | None] = 1.0

    @cached_property
    def total_weight(self) -> float:
        """The number of points."""
        return float(self.prepared.n_points)

    def summand(self, best: Moments | None, asked: float) -> Summand:
        """Matches, whatever was found so far."""
        return Summand()

    def upper(self, sums: Scores) -> Scores:
        """Most that cells with at most so many matches score."""
        return self.objective.bound_by_count(sums)


@dataclass(frozen=True, eq=False)
class ByAxes(Bounding):
    """Bounds by N along the least determined axis; across it, all that the points could add is taken to be there."""

    objective: BoundedByAxes

    @cached_property
    def total_weight(self) -> float:
        """Length of the longest normal, at least 1, for each point with a normal; `without_normal` for each other."""
        squares = (self.prepared.normals * self.prepared.normals).sum(axis=0)
        n_without = int(np.count_nonzero(squares == 0.0))
        longest = math.sqrt(squares.max(initial=1.0))
        return (len(squares) - n_without) * longest + n_without * self.prepared.without_normal

    def summand(self, best: Moments | None, asked: float) -> Summand:
        """N along the axis that the best cell so far determines least; before there is one, that of the scan."""
        left_out = LEFT_OUT * asked
        if best is not None:
            _, xx, xy, yy = best
            azimuth, _ = _weak_azimuth(xx, xy, yy)
        else:
            azimuth, eigenvalue = _weak_azimuth(*self.prepared.spread.tolist())
            azimuth += self.prepared.prior.heading
            left_out = LEFT_OUT_OF_SCAN * eigenvalue
        return Summand(nearest_axis(azimuth), left_out / max(1.0, self.total_weight))

    def upper(self, sums: Scores) -> Scores:
        """Most that cells score which have at most this along the axis."""
        return self.objective.bound_by_axes(sums, np.full_like(sums, self.most))


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
