# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Cells that a search has scored: in bulk, one by one, the candidates that are left, and what was found of them."""

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.search.objectives import Moments, Objective, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search.space import Cell, Window

FIRST_OF_ALL: Cell = (0, 0, 0)
SMALLEST = float(np.nextafter(0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """One number for each cell of a window at some headings.

    headings: shape (h,); their numbers in the search space, in order.
    first_cell: index (y, x) in the search space of the window's first cell.
    numbers: shape (h, ny, nx); the numbers.
    """

    headings: NDArray[np.int64]
    first_cell: tuple[int, int]
    numbers: NDArray[Any]

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
        """The cells (n, 3) of the highest numbers; from the rows that have the highest ones."""
        highest_of_rows = self.numbers.max(axis=2)
        n_rows = min(n_cells, highest_of_rows.size)
        rows = np.unravel_index(np.argpartition(highest_of_rows, -n_rows, axis=None)[-n_rows:], highest_of_rows.shape)
        candidates = self.numbers[rows]
        n_cells = min(n_cells, candidates.size)
        numbers, x = np.divmod(np.argpartition(candidates, -n_cells, axis=None)[-n_cells:], candidates.shape[1])
        return self._cells((rows[0][numbers], rows[1][numbers], x))

    def first_highest(self) -> NDArray[np.int64]:
        """Return the cell (1, 3) of the highest number, the first in index order at ties (D8)."""
        index = np.unravel_index(np.argmax(self.numbers), self.numbers.shape)
        return self._cells(tuple(np.atleast_1d(each) for each in index))

    def _cells(self, index: tuple[NDArray[np.int64], ...]) -> NDArray[np.int64]:
        """Cells (n, 3) of the space, from their index in the grid."""
        heading, y, x = index
        return np.stack([self.headings[heading], y + self.first_cell[0], x + self.first_cell[1]], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
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


@dataclass(frozen=True, slots=True, eq=False)
class Incumbent:
    """What a search has to reach: the score of the best cell of another height or pose, or a fraction of it.

    score: the least score of interest; no cell need have it.
    moments: shape (4,); moments of that best cell: they give the axis to bound along.
    """

    score: float
    moments: Moments


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The best cell of a search space, and what was proved of the others.

    Parameters
    ----------
    cell : tuple of 3 int
        (heading, y, x) of the best cell, the first in index order at ties (D8).
    score : float
        Its score.
    moments : array, shape (4,)
        Its count, Nxx, Nxy and Nyy.
    bound : float
        Proved: no cell scores higher. It is the score, or that of the incumbent, if that is higher.
    rest : float
        Proved: no cell farther than the guard radius from the guarded one, at any heading, scores higher. Exact if that
        reaches the asked ratio to the best score; otherwise an upper limit below it.
    n_scored : int
        Cells whose moments were computed, a few of them twice; all others were only bounded.
    height : int
        Number of the height of the best cell, see `SearchSpace.raised`; at others nothing is proved of the rest.
    reaching : Candidates
        If asked for: every cell that reaches the asked ratio, at the height of the best cell, and its score. A few may
        be there twice.
    """

    cell: Cell
    score: float
    moments: Moments
    bound: float
    rest: float
    n_scored: int
    height: int = 0
    reaching: Candidates = field(default_factory=Candidates.none)


class ScoredCells:
    """Scores cells, by themselves or all of a window, and remembers which stand out.

    Its parameters are those of `branch_and_bound`; `n_in_windows` is the number of cells scored in windows.
    """

    def __init__(
        self,
        prepared: PreparedScan,
        objective: Objective,
        share: float = 1.0,
        guard_radius: float = 0.3,
        guarded: Cell | None = None,
        lists_all: bool = False,
        incumbent: Incumbent | None = None,
    ) -> None:
        self.prepared, self.objective = prepared, objective
        self.share, self.guard_radius, self.guarded = share, guard_radius, guarded
        self.lists_all, self.incumbent = lists_all, incumbent
        self.n_in_windows = 0
        self._best, self._cell = -math.inf, FIRST_OF_ALL
        self._moments: Moments = np.zeros(4)
        self._singles: dict[Cell, float] = {}  # scores of the cells that were scored by themselves
        self._of_windows = Candidates.none()  # cells of windows that reach what is asked
        if guarded is not None:
            self.score(np.array([guarded]))

    @property
    def best(self) -> float:
        """Score from which on a cell is the best one, or as good: the highest so far, or that of the incumbent."""
        return self._best if self.incumbent is None else max(self._best, self.incumbent.score)

    @property
    def asked(self) -> float:
        """Score from which on a cell is sought: a fraction of the best or the guarded one's, or the incumbent's."""
        asked = self.share * (self._best if self.guarded is None else self._singles[self.guarded])
        return asked if self.incumbent is None else max(asked, self.incumbent.score)

    @property
    def leader(self) -> Incumbent | None:
        """The best cell so far, or what it has to reach if that is more; none before any is scored."""
        if self._best == -math.inf or (self.incumbent is not None and self.incumbent.score >= self._best):
            return self.incumbent
        return Incumbent(self._best, self._moments)

    def score(self, cells: NDArray[np.int64]) -> None:
        """Score cells (n, 3) by themselves, those that are not yet."""
        new: dict[int, list[Cell]] = defaultdict(list)
        for heading, y, x in dict.fromkeys(map(tuple, cells.tolist())):
            if (heading, y, x) not in self._singles:
                new[heading].append((heading, y, x))
        for heading, mine in new.items():
            moments = self.prepared.moments_of_cells(heading, np.array(mine, np.int64))
            for cell, score, four in zip(mine, self.objective.score(moments).tolist(), moments, strict=True):
                self._singles[cell] = score
                self._note(cell, score, four)

    def score_window(self, headings: Headings, window: Window, n_threads: int, cells_per_pass: int) -> float:
        """Score all cells of a window at some headings, and keep those that reach what is asked.

        Returns the highest score that is not kept, of this window or an earlier one; 0 for none.
        """
        n_passes = min(-(-len(headings) * math.prod(window.shape) // cells_per_pass), len(headings))
        return max(self._score_pass(some, window, n_threads) for some in np.array_split(headings, n_passes))

    def _score_pass(self, headings: Headings, window: Window, n_threads: int) -> float:
        """Score a window at as many headings as memory allows at a time, see `score_window`."""
        moments = self.prepared.moments_of_window(headings, window, n_threads)
        first_cell = window.first_cell(self.prepared.space)
        scores = CellGrid(headings, first_cell, self.objective.score(moments))
        highest = scores.first_highest()
        heading, y, x = highest[0].tolist()
        four = CellGrid(headings, first_cell, moments).at(highest)[0]
        self._note((heading, y, x), float(scores.at(highest)[0]), four)
        self.n_in_windows += scores.numbers.size
        cells, highest_below = scores.reaching(max(self.asked, SMALLEST))
        kept = self._of_windows.joined(Candidates(cells, scores.at(cells)))
        is_kept = kept.upper >= self.asked
        self._of_windows = kept[is_kept]
        return float(kept.upper.max(where=~is_kept, initial=max(highest_below or 0.0, 0.0)))

    def _note(self, cell: Cell, score: float, moments: Moments) -> None:
        """Remember a cell if it is the best so far; at ties the first in index order is (D8)."""
        if (-score, cell) < (-self._best, self._cell):
            self._best, self._cell, self._moments = score, cell, moments

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one, or else from the best."""
        offsets = cells[:, 1:] - np.array((self.guarded or self._cell)[1:])
        distances = np.hypot(offsets[:, 0], offsets[:, 1]) * self.prepared.space.cell_edge
        return np.asarray(distances > self.guard_radius)

    def highest_of(self, cells: NDArray[np.int64]) -> float:
        """Highest score of some cells that were scored by themselves."""
        return max(self._singles[heading, y, x] for heading, y, x in cells.tolist())

    def runner_up(self) -> float:
        """Highest score beyond the guard radius among the cells scored so far; 0 for none."""
        scored = self._scored()
        return float(scored.upper.max(where=self.is_beyond(scored.cells), initial=0.0))

    def _scored(self) -> Candidates:
        """Cells that were scored by themselves, and those kept of windows, which may be the same."""
        cells = np.array(list(self._singles), np.int64).reshape(-1, 3)
        return self._of_windows.joined(Candidates(cells, np.array(list(self._singles.values()))))

    def found(self, rest: float) -> Found:
        """Answer with the best cell; no other beyond the guard radius scores more than `rest`."""
        n_scored, reaching = len(self._singles) + self.n_in_windows, Candidates.none()
        if self.lists_all:
            scored = self._scored()
            reaching = scored[scored.upper >= self.asked]
        moments = self._moments.copy()
        return Found(self._cell, self._best, moments, self.best, rest, n_scored, reaching=reaching)
