# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Bounds of all cells: what their matches add along one axis, at most (design section 3, fact 2)."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.search.field import Field
from maxcon.search_space import SearchSpace

__all__ = ["Axis", "Bounds", "HeadingPass"]

# Sums of headings that are made together take so many cells at most, 64 MiB, unless one heading alone takes more.
PASS_HEADINGS, PASS_CELLS = 16, 2**24

FINEST_UNIT = 2.0**-14
"""What matches add is rounded up to a multiple of this; finer would not fit into the sums of a scan."""

SLACK = 1e-6
"""Axes are unit vectors at right angles up to float32, weights and products of normals are float32: what that can
amount to, of the sum over all points. A few times 2^-24 would do."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A horizontal direction, unit vector (x, y) in float32; (0, 0) stands for counting."""

    x: np.float32
    y: np.float32

    @classmethod
    def at(cls, azimuth: float) -> "Axis":
        """Return the axis of an azimuth, rad."""
        return cls(np.float32(math.cos(azimuth)), np.float32(math.sin(azimuth)))

    @classmethod
    def none(cls) -> "Axis":
        """Count matches instead."""
        return cls(np.float32(0.0), np.float32(0.0))

    @property
    def is_none(self) -> bool:
        """Whether matches are counted."""
        return not (self.x or self.y)


@dataclass(frozen=True, slots=True)
class Bounds:
    """What all matches in each cell add along an axis, at most.

    Parameters
    ----------
    field : Field
        The scan and the tiles around.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        The cells.
    fullest : int
        Map points in the fullest voxel, where a voxel counts as often as it has points, otherwise 1.
    """

    field: Field
    prior: Pose
    space: SearchSpace
    fullest: int

    @classmethod
    def of(cls, field: Field, prior: Pose, space: SearchSpace) -> "Bounds":
        """Bounds for a scan in its field."""
        fullest = 1
        if not field.is_once:
            fullest = max((int(tile.counts.max(initial=1)) for tile, _ in field.tiles.values()), default=1)
        return cls(field, prior, space, fullest)

    def most(self, axis: Axis) -> float:
        """What a cell can have along any axis if every point matches."""
        n_points = self.field.points.shape[1]
        if not axis.is_none:
            n_points = int(np.sum(self.field.middles - self.field.starts[:-1]))
        return float(n_points * self.fullest) * (1.0 + SLACK)

    def passes(self) -> Iterator["HeadingPass"]:
        """Yield all headings of the space, as many at a time as memory allows."""
        n_headings, ny, nx = self.space.shape
        most_headings = max(1, min(PASS_HEADINGS, PASS_CELLS // (ny * nx)))
        for first in range(0, n_headings, most_headings):
            yield self.heading_pass(np.arange(first, min(first + most_headings, n_headings)))

    def heading_pass(self, headings: NDArray[np.int64]) -> "HeadingPass":
        """Get some headings, by number, ready for their bounds."""
        from maxcon.search import visit_kernels

        nx = self.space.shape[2]
        columns, turned = self.field.turned(self.prior, self.prior.heading + self.space.headings[headings])
        visits = visit_kernels.plan_visits(self.field.starts, columns)
        return HeadingPass(self, headings, columns, turned, visits, (-(nx // 2), nx - 1 - nx // 2))

    @property
    def unit(self) -> float:
        """Unit of the sums, a power of two: they stay below 2^30 (2^62 for counts), and what is added below 2^22."""
        n_points = max(1, self.field.points.shape[1])
        largest = 2.0**30 / n_points if self.field.is_once else 2.0**22
        return max(FINEST_UNIT, math.ldexp(1.0, math.ceil(math.log2((self.fullest + 2.0) / largest))))


@dataclass(frozen=True, slots=True)
class HeadingPass:
    """Some headings, with the scan turned by them.

    Parameters
    ----------
    bounds : Bounds
        Of the scan.
    headings : array, shape (h,)
        Their numbers in the search space.
    columns, turned : array, shape (h, 2, n) and (h, 3, n)
        Voxels and normals of the points at each heading.
    visits : array, shape (m, 7)
        As `visit_kernels.plan_visits` planned them.
    offsets : tuple of 2 int
        Offset of the first and of the last cell, voxels.
    """

    bounds: Bounds
    headings: NDArray[np.int64]
    columns: NDArray[np.int32]
    turned: NDArray[np.float32]
    visits: NDArray[np.int64]
    offsets: tuple[int, int]

    def along(self, axis: Axis, least: float, every: int = 1) -> NDArray[np.float64]:
        """Bound what matches add along an axis in all cells, shape (h, ny, nx).

        Parameters
        ----------
        axis : Axis
            Along which direction.
        least : float
            Voxels that add no more than this are not looked at; each point is taken to match one of them.
        every : int
            Only every so many-th group of scan points: an idea of the bounds, but none.
        """
        from maxcon.search import bound_kernels, visit_kernels

        field, rim = self.bounds.field, visit_kernels.RIM
        first, last = self.offsets
        n_cells = last - first + 1
        visits = self.visits if every == 1 else self.visits[self.visits[:, 0] % every == 0]
        width, unit = n_cells + 2 * rim, self.bounds.unit
        shape = (len(self.headings), width, width)
        sums = np.zeros(shape, np.int32 if field.is_once else np.int64)
        for numbers, layers, tile in field.visited(visits, first, last):
            bound_kernels.bound_tile(
                numbers, visits, field.starts, field.middles, field.ranks, layers, self.columns, self.turned, *tile,
                (first, n_cells, width), field.is_weighted and not axis.is_none, field.is_signed, (axis.x, axis.y),
                np.float32(least), np.float32(1.0 / unit), sums.reshape(len(self.headings), -1),
            )  # fmt: skip
        bounds: NDArray[np.float64] = sums[:, rim:-rim, rim:-rim] * (unit * (1.0 + SLACK))
        bounds += self.bounds.most(axis) * (SLACK + least / self.bounds.fullest * (1.0 + SLACK))
        return bounds
