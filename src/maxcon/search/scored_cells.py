"""Cells that a search has scored, one by one or all of some headings, and what was found of them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.search.objectives import Moments, Objective, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search.space import Cell

SMALLEST = float(np.nextafter(0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The best cell of a search space, and what was proved of the others.

    Parameters
    ----------
    cell : tuple of 3 int
        (heading, y, x) of the best cell, the first in index order at ties (D8).
    score : float
        Its score. Proved: no cell scores higher.
    moments : array, shape (4,)
        Its count, Nxx, Nxy and Nyy.
    second_best : float
        Proved: no cell farther than the guard radius from the guarded one, at any heading, scores higher. Exact if that
        reaches the asked ratio to the best score; otherwise an upper limit below it.
    n_scored : int
        Cells whose moments were computed, a few of them twice; all others were only bounded.
    height : int
        Number of the height of the best cell, see `SearchSpace.raised`; at others nothing is proved of the second best.
    """

    cell: Cell
    score: float
    moments: Moments
    second_best: float
    n_scored: int
    height: int = 0

    @property
    def bound(self) -> float:
        """No cell scores higher than this: than the best one, that is."""
        return self.score


class ScoredCells:
    """Scores cells of one height; keeps the best and those that reach the asked score. `known`: of other heights."""

    def __init__(
        self,
        prepared: PreparedScan,
        objective: Objective,
        ratio: float,
        guard_radius: float,
        guarded: Cell | None = None,
        known: Found | None = None,
    ) -> None:
        self.prepared, self.objective = prepared, objective
        self.ratio, self.guard_radius, self.guarded, self.known = ratio, guard_radius, guarded, known
        self.n_scored = 0
        self.ruled_out = 0.0
        """Highest score, or bound, of the cells that were discarded."""
        self._best: tuple[float, Cell, Moments] = (-math.inf, (0, 0, 0), np.zeros(4))
        self._cells, self._scores = np.empty((0, 3), np.int64), np.empty(0)
        self._of_guarded = math.nan
        if guarded is not None:
            self.score(np.array([guarded]))
            self._of_guarded = self._best[0]

    @property
    def best(self) -> float:
        """Score from which on a cell is the best one, or as good."""
        return self._best[0] if self.known is None else max(self._best[0], self.known.score)

    @property
    def best_moments(self) -> Moments | None:
        """Moments of the best cell so far, be it of another height; None before any is worth something."""
        if self.best <= 0.0:
            return None
        return self._best[2] if self.known is None or self.known.score < self._best[0] else self.known.moments

    @property
    def asked(self) -> float:
        """Score from which on a cell is sought."""
        asked = self.ratio * (self._best[0] if self.guarded is None else self._of_guarded)
        return asked if self.known is None else max(asked, self.known.score)

    def score(self, cells: NDArray[np.int64]) -> None:
        """Score cells (n, 3) one by one."""
        cells = np.unique(cells, axis=0)  # in index order
        for heading in np.unique(cells[:, 0]).tolist():
            mine = cells[cells[:, 0] == heading]
            moments = self.prepared.moments_of_cells(heading, mine)
            self._keep(mine, self.objective.score(moments), moments)

    def score_headings(self, headings: Headings, n_threads: int) -> None:
        """Score all cells of some headings, and discard those that do not reach what is asked."""
        moments = self.prepared.moments_of_headings(headings, n_threads)
        _, ny, nx = self.prepared.space.shape
        index = np.unravel_index(np.arange(len(headings) * ny * nx), (len(headings), ny, nx))
        cells = np.stack([headings[index[0]], *index[1:]], axis=1)
        self._keep(cells, self.objective.score(moments).reshape(-1), moments.reshape(-1, 4))
        is_asked = self._scores >= max(self.asked, SMALLEST)
        self.rule_out(self._scores[~is_asked])
        self._cells, self._scores = self._cells[is_asked], self._scores[is_asked]

    def _keep(self, cells: NDArray[np.int64], scores: Scores, moments: Moments) -> None:
        """Keep scored cells, in index order: at ties the first one is the best (D8)."""
        first = int(np.argmax(scores))
        heading, y, x = cells[first].tolist()
        if (-scores[first], (heading, y, x)) < (-self._best[0], self._best[1]):
            self._best = float(scores[first]), (heading, y, x), moments[first].copy()
        self.n_scored += len(cells)
        self._cells, self._scores = np.concatenate([self._cells, cells]), np.append(self._scores, scores)

    def rule_out(self, upper: Scores) -> None:
        """Discard cells that score no more than this."""
        self.ruled_out = max(self.ruled_out, float(upper.max(initial=0.0)))

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one, or else from the best."""
        offsets = cells[:, 1:] - np.array((self.guarded or self._best[1])[1:])
        distances = np.hypot(offsets[:, 0], offsets[:, 1]) * self.prepared.space.cell_edge
        return np.asarray(distances > self.guard_radius)

    def second_best(self) -> float:
        """Highest score beyond the guard radius among the cells that are kept; 0 for none."""
        return float(self._scores.max(where=self.is_beyond(self._cells), initial=0.0))

    def found(self, height: int) -> Found:
        """Return the best cell, with what all others score at most."""
        score, cell, moments = self._best
        return Found(cell, score, moments, max(self.ruled_out, self.second_best()), self.n_scored, height)
