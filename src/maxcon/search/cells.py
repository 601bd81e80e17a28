# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Cells of a search space in bulk: windows of them, a number for each of a window, and lists of candidates."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.search.objectives import Scores
from maxcon.search.space import SearchSpace

__all__ = ["Candidates", "CellGrid", "Window"]


class Window(NamedTuple):
    """A rectangle of cells, the same at all headings, by the offsets of its first and last ones.

    Parameters
    ----------
    x_first, x_last, y_first, y_last : int
        Offsets, in voxels of the map; the last ones belong to it.
    """

    x_first: int
    x_last: int
    y_first: int
    y_last: int

    @classmethod
    def of(cls, space: SearchSpace) -> "Window":
        """All offsets of a space."""
        _, ny, nx = space.shape
        return cls(-(nx // 2), nx - 1 - nx // 2, -(ny // 2), ny - 1 - ny // 2)

    @classmethod
    def around(cls, cells: NDArray[np.int64], space: SearchSpace) -> "Window":
        """Return the smallest window that holds some cells (n, 3) of a space."""
        whole = cls.of(space)
        (y_first, x_first), (y_last, x_last) = cells[:, 1:].min(axis=0), cells[:, 1:].max(axis=0)
        return cls(
            whole.x_first + int(x_first),
            whole.x_first + int(x_last),
            whole.y_first + int(y_first),
            whole.y_first + int(y_last),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """How many cells there are, (ny, nx)."""
        return self.y_last - self.y_first + 1, self.x_last - self.x_first + 1

    def first_cell(self, space: SearchSpace) -> tuple[int, int]:
        """Index (y, x) of its first cell in a space."""
        whole = Window.of(space)
        return self.y_first - whole.y_first, self.x_first - whole.x_first

    def bands(self, most_cells: int) -> Iterator["Window"]:
        """Yield bands of whole rows that make up this window, in order, each of at most `most_cells` or of one row."""
        _, nx = self.shape
        n_rows = max(1, most_cells // nx)
        for y_first in range(self.y_first, self.y_last + 1, n_rows):
            yield self._replace(y_first=y_first, y_last=min(y_first + n_rows - 1, self.y_last))


@dataclass(frozen=True, slots=True)
class CellGrid:
    """One number for each cell of a window at some headings, and which cells have high ones.

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
    def of(cls, space: SearchSpace, headings: NDArray[np.int64], window: Window, numbers: NDArray[Any]) -> "CellGrid":
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
        highest = self.numbers.max() if lowest is None else self.numbers.max(where=~is_reached, initial=lowest)
        return cells, float(highest)

    def highest(self, n_cells: int) -> NDArray[np.int64]:
        """The cells (n, 3) of the highest numbers."""
        highest_of_rows = self.numbers.max(axis=2)
        n_rows = min(n_cells, highest_of_rows.size)
        rows = np.unravel_index(np.argpartition(highest_of_rows, -n_rows, axis=None)[-n_rows:], highest_of_rows.shape)
        candidates = self.numbers[rows]
        n_cells = min(n_cells, candidates.size)
        numbers, x = np.divmod(np.argpartition(candidates, -n_cells, axis=None)[-n_cells:], candidates.shape[1])
        return self._cells((rows[0][numbers], rows[1][numbers], x))

    def first_highest(self) -> NDArray[np.int64]:
        """Return the cell (1, 3) of the highest number, the first in index order at ties (D8)."""
        place = np.unravel_index(np.argmax(self.numbers), self.numbers.shape)
        return self._cells(tuple(np.atleast_1d(index) for index in place))

    def _cells(self, places: tuple[NDArray[np.int64], ...]) -> NDArray[np.int64]:
        """Cells (n, 3) of the space, from places in the grid."""
        heading, y, x = places
        return np.stack([self.headings[heading], y + self.first_cell[0], x + self.first_cell[1]], axis=1)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Cells (n, 3) that are not ruled out, and the most that each scores, (n,): a bound, or its score."""

    cells: NDArray[np.int64]
    upper: Scores

    @classmethod
    def none(cls) -> "Candidates":
        """No cell."""
        return cls(np.empty((0, 3), np.int64), np.empty(0))

    def joined(self, other: "Candidates") -> "Candidates":
        """These and others."""
        return Candidates(np.concatenate([self.cells, other.cells]), np.concatenate([self.upper, other.upper]))

    def below(self, upper: Scores) -> "Candidates":
        """The same cells, each with the lower one of two bounds."""
        return Candidates(self.cells, np.minimum(self.upper, upper))

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.int64]) -> "Candidates":
        return Candidates(self.cells[which], self.upper[which])
