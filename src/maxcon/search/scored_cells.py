# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScoredCells: the cells scored so far, and which of them a search is to find."""

import math
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import Moments
from maxcon.search.cells import Candidates, CellGrid, Window
from maxcon.search.found import Found, Standing, Wanted
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search_space import Cell

__all__ = ["ScoredCells"]

SMALLEST = float(np.nextafter(0.0, 1.0))


class ScoredCells:
    """Scores cells, by themselves or all of a window, and remembers which stand out.

    Parameters
    ----------
    prepared : PreparedScan
        The scan and the tiles around.
    wanted : Wanted
        What is to be found. A guarded cell is scored at once.
    """

    def __init__(self, prepared: PreparedScan, wanted: Wanted) -> None:
        self._prepared = prepared
        self._wanted = wanted
        self._best = -math.inf
        self._cell: Cell = (0, 0, 0)
        # Score and moments of each cell that was scored by itself, and of the best of each window.
        self._singles: dict[Cell, tuple[float, Moments]] = {}
        self._of_windows = Candidates.none()
        self._n_in_windows = 0
        if wanted.guarded is not None:
            self.score(np.array([wanted.guarded]))

    @property
    def best(self) -> float:
        """Score from which on a cell is the best one, or as good: the highest so far, or that of the incumbent."""
        standing = self._wanted.standing
        return self._best if standing is None else max(self._best, standing.score)

    @property
    def asked(self) -> float:
        """Score from which on a cell is looked for: a share of the best, or of the guarded one; and what stands."""
        guarded, standing = self._wanted.guarded, self._wanted.standing
        asked = self._wanted.share * (self._best if guarded is None else self._singles[guarded][0])
        return asked if standing is None else max(asked, standing.score)

    @property
    def leader(self) -> Standing | None:
        """The best cell so far, of this height or of others; none before any is scored."""
        standing = self._wanted.standing
        if not self._singles or (standing is not None and standing.score >= self._best):
            return standing
        return Standing(self._best, self._singles[self._cell][1])

    @property
    def n_in_windows(self) -> int:
        """Number of cells in windows that were scored as a whole."""
        return self._n_in_windows

    def score(self, cells: NDArray[np.int64]) -> None:
        """Score cells (n, 3) by themselves, those that are not yet."""
        new: dict[int, list[Cell]] = defaultdict(list)
        for heading, y, x in dict.fromkeys(map(tuple, cells.tolist())):
            if (heading, y, x) not in self._singles:
                new[heading].append((heading, y, x))
        for heading, mine in new.items():
            moments = self._prepared.moments_of_cells(heading, np.array(mine, np.int64))
            scores = self._wanted.objective.score(moments).tolist()
            for cell, score, four in zip(mine, scores, moments, strict=True):
                self._note(cell, score, four)

    def score_window(self, headings: Headings, window: Window, n_threads: int) -> float:
        """Score all cells of a window at some headings, and keep those that reach what is asked.

        Returns the highest score that is not kept, of this window or an earlier one; 0 for none.
        """
        moments = self._prepared.moments_of_window(headings, window, n_threads)
        space = self._prepared.space
        scores = CellGrid.of(space, headings, window, self._wanted.objective.score(moments))
        highest = scores.first_highest()
        heading, y, x = highest[0].tolist()
        four = CellGrid.of(space, headings, window, moments).at(highest)[0]
        self._note((heading, y, x), float(scores.at(highest)[0]), four)
        self._n_in_windows += scores.numbers.size
        cells, highest_below = scores.reaching(max(self.asked, SMALLEST))
        kept = self._of_windows.joined(Candidates(cells, scores.at(cells)))
        is_kept = kept.upper >= self.asked
        self._of_windows = kept[is_kept]
        return float(kept.upper.max(where=~is_kept, initial=max(highest_below or 0.0, 0.0)))

    def _note(self, cell: Cell, score: float, moments: Moments) -> None:
        """Remember what a cell scores, and whether it is the best; at ties the first in index order is (D8)."""
        self._singles[cell] = score, moments
        if (-score, cell) < (-self._best, self._cell):
            self._best, self._cell = score, cell

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one, or else from the best."""
        offsets = cells[:, 1:] - np.array((self._wanted.guarded or self._cell)[1:])
        distances = np.hypot(offsets[:, 0], offsets[:, 1]) * self._prepared.space.cell_edge
        return np.asarray(distances > self._wanted.guard_radius)

    def highest_of(self, cells: NDArray[np.int64]) -> float:
        """Highest score of some cells that were scored by themselves."""
        return max(self._singles[heading, y, x][0] for heading, y, x in cells.tolist())

    def runner_up(self) -> float:
        """Highest score beyond the guard radius among the cells scored so far; 0 for none."""
        scored = self._scored()
        return float(scored.upper.max(where=self.is_beyond(scored.cells), initial=0.0))

    def reaching(self) -> Candidates:
        """Cells scored so far that reach what is asked, and their scores."""
        scored = self._scored()
        return scored[scored.upper >= self.asked]

    def _scored(self) -> Candidates:
        """Cells that were scored by themselves, and those kept of windows, which may be the same."""
        cells = np.array(list(self._singles), np.int64).reshape(-1, 3)
        scores = np.array([score for score, _ in self._singles.values()])
        return self._of_windows.joined(Candidates(cells, scores))

    def found(self, rest: float) -> Found:
        """Answer with the best cell; no other beyond the guard radius scores more than `rest`."""
        if not self._singles:  # no bound reaches the incumbent
            return Found(self._cell, -math.inf, np.zeros(4), self.best, rest, 0)
        _, moments = self._singles[self._cell]
        return Found(
            self._cell,
            self._best,
            moments.copy(),
            self.best,
            rest,
            len(self._singles) + self._n_in_windows,
            reaching=self.reaching() if self._wanted.lists_all else Candidates.none(),
        )
