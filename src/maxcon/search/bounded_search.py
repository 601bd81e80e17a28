# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""BoundedSearch: in which order cells are bounded, bounded again and scored, until the best one is proved."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import SearchSpaceError
from maxcon.objectives import Scores
from maxcon.search.bounding import Summand
from maxcon.search.bounds import Bounds, CellBounds, Part
from maxcon.search.candidates import Candidates
from maxcon.search.found import Found, Wanted
from maxcon.search.limits import Limits
from maxcon.search.scored_cells import ScoredCells
from maxcon.search.window import Window

__all__ = ["BoundedSearch"]

FIRST_OF_ALL = np.zeros((1, 3), np.int64)


@dataclass
class BoundedSearch:
    """One search at one height, and how far it has come.

    Parameters
    ----------
    bounds : Bounds
        Upper bounds of what the matches of cells add up to.
    scored : ScoredCells
        The cells scored so far.
    wanted : Wanted
        What is to be found.
    limits : Limits
        When to score, to bound again, or to search a window exhaustively.
    n_threads : int
        Headings are shared out among that many threads.
    ruled_out : float
        Highest upper bound among the cells that were discarded.
    """

    bounds: Bounds
    scored: ScoredCells
    wanted: Wanted
    limits: Limits
    n_threads: int
    ruled_out: float = 0.0

    def run(self) -> Found:
        """Find the best cell, and prove what the others score at most."""
        if self.bounds.prepared.matches_nothing:
            self.scored.score(FIRST_OF_ALL)
            return self.scored.found(rest=self.scored.best)
        bounded, crowded = self._bound_parts()
        candidates = self._branch(bounded, crowded)
        self._score_best_first(candidates)
        return self.scored.found(rest=max(self.ruled_out, self.scored.runner_up()))

    def _bound_parts(self) -> tuple[list[Candidates], list[Part]]:
        """Bound all cells. What is left open of each part; and the parts in which too much is, to come back to."""
        bounded, crowded = [], []
        parts = self.bounds.parts(self.limits)
        for part in parts:
            cells = self._bound(part)
            if len(parts) > 1 and cells.count_reaching(self._least_sum()) > self.limits.most_kept:
                crowded.append(part)  # other parts may have better cells, which leave less open
            else:
                bounded.append(self._left_open(cells))
        return bounded, crowded

    def _branch(self, bounded: list[Candidates], crowded: list[Part]) -> Candidates:
        """Search windows around many candidates exhaustively. Returns the candidates that are to be scored singly."""
        candidates = Candidates.none()
        for left in bounded:
            candidates = candidates.joined(self._search_around(self._reaching(left)))
        for part in crowded:
            candidates = candidates.joined(self._search_around(self._left_open(self._bound(part))))
        return candidates

    def _bound(self, part: Part) -> CellBounds:
        """Bound all cells of a part by one sum, and score the most promising."""
        cells = self._sum_up(part, self._summand())
        is_first = self.scored.best <= 0.0
        if is_first:
            self.scored.score(cells.highest(self.limits.first_cells))
        n_open = cells.count_reaching(self._least_sum())
        if n_open > self.limits.most_candidates:
            self.scored.score(cells.highest(self.limits.scored_at_once))
        elif n_open and not is_first:
            self.scored.score(cells.highest(self.limits.first_cells))
        return cells

    def _left_open(self, cells: CellBounds) -> Candidates:
        """Cells that may reach the asked score; where many are left, after a second bound of those."""
        reaching, highest = cells.reaching(self._least_sum())
        self._rule_out(self._upper(np.array([highest])))
        candidates = self._reaching(Candidates(reaching, self._upper(cells.at(reaching))))
        if self.limits.most_candidates < len(candidates) <= len(cells) // self.limits.undecided:
            return self._bound_again(candidates, cells)
        return candidates

    def _bound_again(self, candidates: Candidates, cells: CellBounds) -> Candidates:
        """Bound candidates by the sum that the best cell so far asks for, and by the one across.

        Only the window around them is looked at.
        """
        summand = self._summand()
        if summand != cells.summand:
            cells = self._sum_up(self._around(candidates), summand)
            candidates = self._reaching(candidates.below(self._upper(cells.at(candidates.cells))))
        across = self.bounds.bounding.across(summand)
        if across is not None and len(candidates) > self.limits.most_candidates:
            cells_across = self._sum_up(self._around(candidates), across)
            upper = self._upper(cells.at(candidates.cells), cells_across.at(candidates.cells))
            candidates = self._reaching(candidates.below(upper))
        return candidates

    def _search_around(self, candidates: Candidates) -> Candidates:
        """Search the window around many candidates exhaustively, if that is faster. Returns those that are left."""
        limits = self.limits
        if len(candidates) <= limits.most_candidates:
            return candidates
        headings, window = self._around(candidates)
        n_visited = len(headings) * math.prod(n + limits.margin for n in window.shape)
        if n_visited > limits.cells_per_candidate * len(candidates):
            return candidates
        n_cells = len(headings) * math.prod(window.shape)
        n_scored = self.scored.n_in_windows + n_cells
        if n_scored > limits.most_scored:
            raise SearchSpaceError(
                f"Expected bounds to leave at most {limits.most_scored:,} cells of the search space to be looked at,"
                f" got {n_scored:,}: nothing stands out. Narrow the search space, or see whether scan and map belong"
                " together."
            )
        n_parts = min(-(-n_cells // limits.scored_per_pass), len(headings))
        for part in np.array_split(headings, n_parts):
            self.ruled_out = max(self.ruled_out, self.scored.score_window(part, window, self.n_threads))
        return Candidates.none()

    def _score_best_first(self, candidates: Candidates) -> None:
        """Score candidates until none is left that could be the best, or the runner-up that is asked for."""
        candidates = candidates[np.argsort(-candidates.upper, kind="stable")]
        at_once, place = self.limits.scored_at_once, 0
        while place < len(candidates) and candidates.upper[place] >= self.scored.best:
            self.scored.score(candidates.cells[place : place + at_once])
            place += at_once
        others = candidates[place:]
        if self.wanted.lists_all:
            self.scored.score(self._reaching(others).cells)
            return
        others = others[self.scored.is_beyond(others.cells)]
        place, runner_up = 0, self.scored.runner_up()
        while place < len(others) and others.upper[place] >= max(self.scored.asked, runner_up):
            some = others.cells[place : place + at_once]
            self.scored.score(some)
            runner_up = max(runner_up, self.scored.highest_of(some))
            place += at_once
        self._rule_out(others.upper[place:])

    def _summand(self) -> Summand:
        """What to sum, from what is known so far."""
        return self.bounds.bounding.summand(self.scored.leader, self.scored.asked, self.limits)

    def _sum_up(self, part: Part, summand: Summand) -> CellBounds:
        return self.bounds.heading_pass(*part).sum_up(summand, self.n_threads)

    def _around(self, candidates: Candidates) -> Part:
        """The headings of candidates, and the smallest window around them."""
        return np.unique(candidates.cells[:, 0]), Window.around(candidates.cells, self.bounds.prepared.space)

    def _least_sum(self) -> float:
        """Least sum over its matches with which a cell may reach the asked score, in steps."""
        steps = np.linspace(0.0, self.bounds.most, self.limits.bound_steps)
        is_open = self._upper(steps) >= self.scored.asked
        first_open = int(np.argmax(is_open)) if is_open.any() else self.limits.bound_steps
        return float(steps[max(first_open - 1, 0)])

    def _upper(self, sums: NDArray[np.float64], sums_across: NDArray[np.float64] | None = None) -> Scores:
        """Most that cells score, from upper bounds of one or both sums."""
        if sums_across is None:
            sums_across = np.full_like(sums, self.bounds.most)
        return self.bounds.bounding.upper(sums, sums_across)

    def _reaching(self, candidates: Candidates) -> Candidates:
        """Those that may reach the asked score; the others are ruled out."""
        is_left = candidates.upper >= self.scored.asked
        self._rule_out(candidates.upper[~is_left])
        return candidates[is_left]

    def _rule_out(self, upper: Scores) -> None:
        """Discard cells that score no more than this."""
        self.ruled_out = max(self.ruled_out, float(upper.max(initial=0.0)))
