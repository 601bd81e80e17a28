# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""BoundedSearch: in which order cells are bounded, bounded again and scored, until the best one is proved."""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import SearchSpaceError
from maxcon.objectives import BoundedByAxes, BoundedByCount, Objective, Scores
from maxcon.search.axis import Axis
from maxcon.search.bounds import Along, Bounds, HeadingPass
from maxcon.search.cell_scores import Candidates, CellScores
from maxcon.search.found import Found, Standing
from maxcon.search.limits import DEFAULT_LIMITS, Limits
from maxcon.search.window import Window

__all__ = ["BoundedSearch"]


@dataclass
class BoundedSearch:
    """One search, and how far it has come.

    Parameters
    ----------
    bounds : Bounds
        Of the scan.
    objective : Objective
        What a cell is worth: `BoundedByAxes` or `BoundedByCount`.
    share : float
        Cells are looked for that reach this share of the guarded cell's score, or else of the best.
    scores : CellScores
        The cells scored so far.
    n_threads : int
        Headings are shared out among that many threads.
    standing : Standing, optional
        What a cell must score at least. If none does, some cell is found, or none, with a score of minus infinity.
    lists_all : bool
        Whether all cells are scored that may reach that, not only the best one and the runner-up.
    limits : Limits
        When to score, to bound again, or to search a window exhaustively.
    highest_left_out : float
        Most that cells can score which were left out so far.
    """

    bounds: Bounds
    objective: Objective
    share: float
    scores: CellScores
    n_threads: int
    standing: Standing | None = None
    lists_all: bool = False
    limits: Limits = DEFAULT_LIMITS
    highest_left_out: float = 0.0

    def run(self) -> Found:
        """The best cell, and what is proved of the others."""
        scores = self.scores
        if not (
            self.bounds.n_points and self.bounds.prepared.tiles
        ):  # nothing adds to N: all cells are alike
            scores.score(np.zeros((1, 3), np.int64))
            return self._found(rest=scores.best)
        if scores.guarded is not None:
            scores.score(np.array([scores.guarded]))
        parts = self.bounds.parts(self.limits)
        of_parts, undecided = [], []
        for part in parts:
            along = self._bound(self.bounds.heading_pass(*part))
            if len(parts) > 1 and along.count_reaching(self._open_from) > self.limits.most_kept:
                undecided.append(part)  # the best cell may lie in another part
            else:
                of_parts.append(self._left_open(along))
        candidates = Candidates.none()
        for left in of_parts:
            candidates = candidates.joined(self._search_around(self._left(left)))
        for part in undecided:
            left = self._left_open(self._bound(self.bounds.heading_pass(*part)))
            candidates = candidates.joined(self._search_around(left))
        self._decide(candidates)
        return self._found(rest=max(self.highest_left_out, scores.runner_up()))

    def _found(self, rest: float) -> Found:
        scores = self.scores
        if not scores.scored:  # no bound reaches what stands
            return Found(scores.cell, -math.inf, np.zeros(4), self._best, rest, 0)
        _, moments = scores.scored[scores.cell]
        n_scored = len(scores.scored) + scores.n_in_windows
        reaching = scores.reaching(self._asked) if self.lists_all else Candidates.none()
        return Found(scores.cell, scores.best, moments.copy(), scores.best, rest, n_scored, reaching=reaching)

    @property
    def _asked(self) -> float:
        """Score from which on a cell is looked for."""
        guarded = self.scores.guarded
        asked = self.share * (self.scores.best if guarded is None else self.scores.scored[guarded][0])
        return asked if self.standing is None else max(asked, self.standing.score)

    @property
    def _leader(self) -> Standing | None:
        """The best cell so far, of this height or of the others."""
        scores, standing = self.scores, self.standing
        if not scores.scored or (standing is not None and standing.score >= scores.best):
            return standing
        return Standing(scores.best, scores.scored[scores.cell][1])

    @property
    def _best(self) -> float:
        """Score from which on a cell is the best, or as good."""
        return self.scores.best if self.standing is None else max(self.scores.best, self.standing.score)

    def _plan(self) -> tuple[Axis, float]:
        """Axis that the best cell so far, or else the scan, determines least, and which voxels to leave out."""
        if self.bounds.is_count:
            return Axis.none(), 0.0
        leader = self._leader
        if leader is not None and leader.score > 0.0:
            _, xx, xy, yy = leader.moments
            axis, turn, left_out = _weak_azimuth(xx, xy, yy)[0], 0.0, self.limits.left_out * self._asked
        else:
            axis, least = _weak_azimuth(*self.bounds.prepared.spread.tolist())
            turn, left_out = self.bounds.prepared.prior.heading, self.limits.left_out_of_scan * least
        weak = Axis.near(axis + turn)
        return weak, left_out / max(1.0, self.bounds.total_weight)

    def _bound(self, heading_pass: HeadingPass) -> Along:
        """Bound all cells of a part, and score the first of them."""
        along = heading_pass.along(*self._plan(), self.n_threads)
        is_first = self._best <= 0.0
        if is_first:
            self.scores.score(along.highest(self.limits.first_cells))
        n_open = along.count_reaching(self._open_from)
        if n_open > self.limits.most_candidates:
            self.scores.score(along.highest(self.limits.scored_at_once))
        elif n_open and not is_first:
            self.scores.score(along.highest(self.limits.first_cells))
        return along

    def _left_open(self, along: Along) -> Candidates:
        """Cells that may reach the asked share of the best score."""
        candidates = self._reaching(along)
        most = along.sums.numbers.size // self.limits.undecided
        if self.limits.most_candidates < len(candidates) <= most and not along.axis.is_none:
            return self._bound_again(candidates, along)
        return candidates

    def _bound_again(self, candidates: Candidates, along: Along) -> Candidates:
        """Those that bounds along the axis that the best cell so far determines least, and across it, leave open.

        Only the window around them is looked at.
        """
        axis, least = self._plan()
        if (axis, least) != (along.axis, along.least):
            along = self.bounds.heading_pass(*self._around(candidates)).along(axis, least, self.n_threads)
            candidates = self._left(candidates.below(self._upper(along.at(candidates.cells))))
        if len(candidates) > self.limits.most_candidates:
            across = self.bounds.heading_pass(*self._around(candidates)).along(
                axis.across, least, self.n_threads
            )
            upper = self._upper(along.at(candidates.cells), across.at(candidates.cells))
            candidates = self._left(candidates.below(upper))
        return candidates

    def _search_around(self, candidates: Candidates) -> Candidates:
        """Search the window around many candidates exhaustively, if that is faster; those that are left then."""
        if len(candidates) <= self.limits.most_candidates:
            return candidates
        headings, window = self._around(candidates)
        n_cells = len(headings) * math.prod(n + self.limits.margin for n in window.shape)
        if n_cells > self.limits.cells_per_candidate * len(candidates):
            return candidates
        n_scored = self.scores.n_in_windows + len(headings) * math.prod(window.shape)
        if n_scored > self.limits.most_scored:
            raise SearchSpaceError(
                f"Expected bounds to leave at most {self.limits.most_scored:,} cells of the search space to be looked"
                f" at, got {n_scored:,}: nothing stands out."
                " Narrow the search space, or see whether scan and map belong"
                " together."
            )
        n_parts = -(-len(headings) * math.prod(window.shape) // self.limits.scored_per_pass)
        for part in np.array_split(headings, min(n_parts, len(headings))):
            grid = self.scores.score_window(part, window, self.n_threads)
            cells, highest = grid.reaching(max(self._asked, np.nextafter(0.0, 1.0)))
            self._leave_out(np.array([] if highest is None else [highest]))
            self.scores.kept = self._left(self.scores.kept.joined(Candidates(cells, grid.at(cells))))
        return Candidates.none()

    def _around(self, candidates: Candidates) -> tuple[NDArray[np.int64], Window]:
        """The headings of candidates, and the smallest window around them: a part of the space."""
        return np.unique(candidates.cells[:, 0]), Window.around(candidates.cells, self.bounds.prepared.space)

    @property
    def _open_from(self) -> float:
        """What matches must add along an axis, in steps, for a cell to reach the asked score."""
        steps = np.linspace(0.0, self.bounds.most, self.limits.bound_steps)
        is_open = self._upper(steps) >= self._asked
        first_open = int(np.argmax(is_open)) if is_open.any() else self.limits.bound_steps
        return float(steps[max(first_open - 1, 0)])

    def _reaching(self, along: Along) -> Candidates:
        """Cells whose bound along one axis leaves it open whether they reach the asked score."""
        cells, highest = along.reaching(self._open_from)
        self._leave_out(self._upper(np.array([highest])))
        return self._left(Candidates(cells, self._upper(along.at(cells))))

    def _left(self, candidates: Candidates) -> Candidates:
        """Those that may reach the asked score."""
        is_left = candidates.upper >= self._asked
        self._leave_out(candidates.upper[~is_left])
        return candidates[is_left]

    def _leave_out(self, upper: Scores) -> None:
        """Keep the most that cells score which are not looked at."""
        self.highest_left_out = max(self.highest_left_out, float(upper.max(initial=0.0)))

    def _upper(self, along: NDArray[np.float64], across: NDArray[np.float64] | None = None) -> Scores:
        """Most that cells score, from what their matches add along one or both axes at most."""
        if self.bounds.is_count:
            return cast(BoundedByCount, self.objective).bound_by_count(along)
        if across is None:
            across = np.full_like(along, self.bounds.most)
        return cast(BoundedByAxes, self.objective).bound_by_axes(along, across)

    def _decide(self, candidates: Candidates) -> None:
        """Score candidates until none is left that could be the best, or the runner-up that is asked for."""
        candidates = candidates[np.argsort(-candidates.upper, kind="stable")]
        place = 0
        while place < len(candidates) and candidates.upper[place] >= self._best:
            self.scores.score(candidates.cells[place : place + self.limits.scored_at_once])
            place += self.limits.scored_at_once
        others = candidates[place:]
        if self.lists_all:
            is_asked = others.upper >= self._asked
            self.scores.score(others.cells[is_asked])
            self._leave_out(others.upper[~is_asked])
            return
        others = others[self.scores.is_beyond(others.cells)]
        place, runner_up = 0, self.scores.runner_up()
        while place < len(others) and others.upper[place] >= max(self._asked, runner_up):
            some = others.cells[place : place + self.limits.scored_at_once]
            self.scores.score(some)
            runner_up = max(runner_up, self.scores.highest_of(some))
            place += self.limits.scored_at_once
        self._leave_out(others.upper[place:])


def _weak_azimuth(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """Azimuth of the eigenvector of the smaller eigenvalue of a matrix, rad, and that eigenvalue."""
    azimuth = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    return azimuth, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
