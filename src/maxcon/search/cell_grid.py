# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""CellGrid: one number for each cell of a window, and which cells have high ones."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.search.window import Window
from maxcon.search_space import SearchSpace

__all__ = ["CellGrid"]


@dataclass(frozen=True, slots=True)
class CellGrid:
    """One number for each cell of a window at some headings.

    Parameters
    ----------
    headings : array, shape (h,)
        Their numbers in the search space, in order.
    first_cell : tuple of 2 int
        Index (y, x) in the search space of the window's first cell.
    numbers : array, shape (h, ny, nx)
        The numbers.
    """

    headings: NDArray[np.int64]
    first_cell: tuple[int, int]
    numbers: NDArray[Any]

    @classmethod
    def of(
        cls, space: SearchSpace, headings: NDArray[np.int64], window: Window, numbers: NDArray[Any]
    ) -> "CellGrid":
        """Numbers of a window of a space at some of its headings."""
        return cls(headings, window.first_cell(space), numbers)

    def at(self, cells: NDArray[np.int64]) -> NDArray[Any]:
        """Numbers of some cells (n, 3) that are there."""
        y, x = (cells[:, 1:] - self.first_cell).T
        numbers: NDArray[Any] = self.numbers[np.searchsorted(self.headings, cells[:, 0]), y, x]
        return numbers

    def reaching(self, least: float) -> tuple[NDArray[np.int64], float | None]:
        """Cells (n, 3), in index order, whose number reaches `least`; and the highest of the others, if any."""
        is_reached = self.numbers >= least
        cells = self._cells(np.nonzero(is_reached))
        if len(cells) == self.numbers.size:
            return cells, None
        lowest = self.numbers.min() if len(cells) else None
        highest = (
            self.numbers.max() if lowest is None else self.numbers.max(where=~is_reached, initial=lowest)
        )
        return cells, float(highest)

    def highest(self, n_cells: int) -> NDArray[np.int64]:
        """The cells (n, 3) of the highest numbers."""
        highest_of_rows = self.numbers.max(axis=2)
        n_rows = min(n_cells, highest_of_rows.size)
        rows = np.unravel_index(
            np.argpartition(highest_of_rows, -n_rows, axis=None)[-n_rows:], highest_of_rows.shape
        )
        candidates = self.numbers[rows]
        n_cells = min(n_cells, candidates.size)
        numbers, x = np.divmod(
            np.argpartition(candidates, -n_cells, axis=None)[-n_cells:], candidates.shape[1]
        )
        return self._cells((rows[0][numbers], rows[1][numbers], x))

    def first_highest(self) -> NDArray[np.int64]:
        """Return the cell (1, 3) of the highest number, the first in index order at ties (D8)."""
        place = np.unravel_index(np.argmax(self.numbers), self.numbers.shape)
        return self._cells(tuple(np.atleast_1d(index) for index in place))

    def _cells(self, places: tuple[NDArray[np.int64], ...]) -> NDArray[np.int64]:
        """Cells (n, 3) of the space, from places in the grid."""
        heading, y, x = places
        return np.stack([self.headings[heading], y + self.first_cell[0], x + self.first_cell[1]], axis=1)
