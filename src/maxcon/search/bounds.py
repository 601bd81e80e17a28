# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Upper bounds of what the matches of each cell add up to: all cells of a window at once (design section 3, fact 2)."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.search.bounding import Bounding, Summand
from maxcon.search.cell_grid import CellGrid
from maxcon.search.limits import Limits
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.window import Window

if TYPE_CHECKING:
    from maxcon.search.visit_kernels import Planned

__all__ = ["Bounds", "CellBounds", "HeadingPass", "Part"]

Part = tuple[NDArray[np.int64], Window]
"""Cells of a search space: those of a window at some headings, by number."""

FINEST_UNIT = 2.0**-14
"""What matches add is rounded up to a multiple of this; finer would not fit into the sums of a scan."""

SLACK = 2e-6
"""Axes are unit vectors at right angles up to float32, weights and products of normals are float32: what that can
amount to, of the sum over all points. Some twenty roundings of 2^-24 add up to less."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Upper bounds of the sums over the matches of each cell.

    Parameters
    ----------
    bounding : Bounding
        What is summed, and the points that take part.
    fullest : int
        Map points in the fullest voxel, where a voxel counts as often as it has points, otherwise 1.
    """

    bounding: Bounding
    fullest: int

    @classmethod
    def of(cls, bounding: Bounding) -> "Bounds":
        """Bounds for the points that take part."""
        fullest = 1
        if not bounding.prepared.is_once:
            fullest = max((tile.fullest for tile, _ in bounding.prepared.tiles.values()), default=1)
        return cls(bounding, fullest)

    @property
    def prepared(self) -> PreparedScan:
        """The points that take part, and the tiles around."""
        return self.bounding.prepared

    @property
    def most(self) -> float:
        """The sum of a cell at which every point matches, at most."""
        return self.bounding.total_weight * self.fullest * (1.0 + SLACK)

    def left_out(self, summand: Summand) -> float:
        """Most that rounding, and the voxels which the summand leaves out, can add to a cell."""
        return self.most * SLACK + self.bounding.total_weight * summand.least * (1.0 + SLACK)

    def parts(self, limits: Limits) -> list[Part]:
        """Headings and windows that make up the space, as large as memory allows, from those near the prior on."""
        space = self.prepared.space
        n_headings, ny, nx = space.shape
        most_headings = max(1, min(limits.headings_per_pass, limits.cells_per_pass // (ny * nx)))
        parts = np.array_split(np.arange(n_headings), -(-n_headings // most_headings))
        bands = list(Window.of(space).bands(limits.cells_per_pass))
        parts.sort(key=lambda headings: abs(headings.mean() - (n_headings - 1) / 2))
        bands.sort(key=lambda window: abs(window.y_first + window.y_last))
        return [(headings, window) for headings in parts for window in bands]

    def heading_pass(self, headings: NDArray[np.int64], window: Window) -> "HeadingPass":
        """Get a window at some headings, by number, ready for the bounds of its cells."""
        columns = self.prepared.voxels_at(headings)
        return HeadingPass(self, headings, window, columns, self.prepared.planned(columns))

    @property
    def unit(self) -> float:
        """Unit of the sums, a power of two: they stay below 2^30 (2^62 for counts), and what is added below 2^22."""
        largest = 2.0**30 / max(1, self.prepared.n_points) if self.prepared.is_once else 2.0**22
        return max(FINEST_UNIT, math.ldexp(1.0, math.ceil(math.log2((self.fullest + 2.0) / largest))))


@dataclass(frozen=True)
class HeadingPass:
    """A window of cells at some headings, with the points turned by them.

    Parameters
    ----------
    bounds : Bounds
        Of the scan.
    headings : array, shape (h,)
        Their numbers in the search space.
    window : Window
        The offsets of the cells.
    columns : array, shape (h, 2, n)
        Voxels of the points at each heading.
    planned : Planned
        When the points visit the map.
    """

    bounds: Bounds
    headings: NDArray[np.int64]
    window: Window
    columns: NDArray[np.int32]
    planned: "Planned"

    def sum_up(self, summand: Summand, n_threads: int = 1) -> "CellBounds":
        """Bound the sum of each cell.

        Parameters
        ----------
        summand : Summand
            What matches add.
        n_threads : int
            Headings are shared out among them; the bounds do not depend on it.
        """
        from maxcon.search import bound_kernels, visit_kernels

        prepared, rim, unit = self.bounds.prepared, visit_kernels.RIM, self.bounds.unit
        height, width = (n_cells + 2 * rim for n_cells in self.window.shape)
        sums = np.zeros((len(self.headings), height, width), np.int32 if prepared.is_once else np.int64)
        bases = bound_kernels.bases_of_points(self.columns, width, height * width)

        planned = tuple(self.planned)

        def vote(headings: NDArray[np.int64]) -> None:
            within = (int(headings[0]), int(headings[-1]) + 1)
            for met, voxels in prepared.visited(self.planned, self.window):
                bound_kernels.bound_tile(
                    tuple(met), planned, tuple(voxels), bases, self.bounds.bounding.weighed_normals,
                    self._turns, within, summand.vector, tuple(self.window), width, prepared.is_signed,
                    np.float32(summand.least), np.float32(1.0 / unit), sums.reshape(-1),
                )  # fmt: skip

        parts = np.array_split(np.arange(len(self.headings)), min(n_threads, len(self.headings)))
        if len(parts) == 1:
            vote(parts[0])
        else:
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(vote, parts))
        inner = sums[:, rim:-rim, rim:-rim]
        grid = CellGrid.of(prepared.space, self.headings, self.window, inner)
        return CellBounds(summand, grid, unit * (1.0 + SLACK), self.bounds.left_out(summand))

    @cached_property
    def _turns(self) -> NDArray[np.float32]:
        """Cosine and sine of each heading, shape (h, 2)."""
        return self.bounds.prepared.turns(self.headings).astype(np.float32)


@dataclass(frozen=True, slots=True)
class CellBounds:
    """Upper bounds of the sums of all cells of a window at some headings.

    Parameters
    ----------
    summand : Summand
        What was summed.
    sums : CellGrid
        The sums, rounded up, in whole units.
    unit : float
        One unit.
    left_out : float
        Most that rounding, and the voxels that were left out, add to any of them.
    """

    summand: Summand
    sums: CellGrid
    unit: float
    left_out: float

    def __len__(self) -> int:
        return self.sums.numbers.size

    def at(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Bounds of some cells (n, 3) that are there."""
        units: NDArray[np.float64] = self.sums.at(cells).astype(np.float64)
        return units * self.unit + self.left_out

    def count_reaching(self, least: float) -> int:
        """How many cells have a bound that reaches `least`."""
        return int(np.count_nonzero(self.sums.numbers >= (least - self.left_out) / self.unit))

    def reaching(self, least: float) -> tuple[NDArray[np.int64], float]:
        """Cells (n, 3), in index order, whose bound reaches `least`; and the highest of the others, 0 for none."""
        cells, highest = self.sums.reaching((least - self.left_out) / self.unit)
        return cells, 0.0 if highest is None else highest * self.unit + self.left_out

    def highest(self, n_cells: int) -> NDArray[np.int64]:
        """The cells (n, 3) of the highest bounds."""
        return self.sums.highest(n_cells)
