# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Branch and bound: the best cell of the exhaustive search, from bounds of all cells and the moments of few.

Read `BoundedSearch.run` beside section 3 of the design. `prepared_scan` has the scan prepared for the map, `bounds` the
upper limits of scores, `scored_cells` the cells scored so far.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import Multiplicity, Weighting, cells_of, check_all_fit, check_threads
from maxcon.search.bounds import Bounding, CellSums, Summand, bounding_of
from maxcon.search.objectives import Bounded, Checked, Objective, Scores
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search.scored_cells import FIRST_OF_ALL, Candidates, Found, Incumbent, ScoredCells
from maxcon.search.space import Cell, SearchSpace, Window

Part = tuple[Headings, Window]
"""Cells of a search space: those of a window at some headings, by number."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When branch and bound scores, bounds again, or scores all cells of a window: a matter of time and memory.

    The best cell, and every other that reaches the asked ratio, are the same for any values. `Found.rest` is not where
    no other cell reaches the ratio: it is the highest bound of those ruled out then.

    Parameters
    ----------
    first_cells : int
        Cells scored before any is ruled out, those with the highest bounds.
    scored_at_once : int
        Candidates scored at a time, from the highest bound on.
    left_out, left_out_of_scan : float
        Voxels are left out of sums if all of them add less than this fraction of the asked score; or, before any cell
        is scored, of what all points could add along the axis that they determine least.
    most_candidates : int
        So many candidates are scored one by one; more are bounded again, or searched as a window.
    most_kept : int
        A part of the space with more candidates than this is bounded again after the others: they may hold a better
        cell.
    undecided : int
        If the first bound leaves more than one in `undecided` cells, no second one is made: it would rule out little.
    cells_per_candidate : int
        Cells of a window that are scored in the time that one candidate by itself takes.
    margin : int
        Rows and columns beside a window that take time too.
    bound_steps : int
        Steps in which the least sum is sought with which a cell can reach the asked score.
    headings_per_pass, cells_per_pass : int
        Cells bounded in one pass: 2^22 sums take 16 MiB, or 32 MiB where voxels count as often as they have points. One
        row is never parted, even if it has more.
    scored_per_pass : int
        Cells of a window scored in one pass: 2^20 take 32 MiB.
    most_scored : int
        A search that would score more cells in windows is refused: nothing stands out in it.
    """

    first_cells: int = 2
    scored_at_once: int = 8
    left_out: float = 0.1
    left_out_of_scan: float = 0.01
    most_candidates: int = 192
    most_kept: int = 2**14
    undecided: int = 20
    cells_per_candidate: int = 120
    margin: int = 24
    bound_steps: int = 4096
    headings_per_pass: int = 16
    cells_per_pass: int = 2**22
    scored_per_pass: int = 2**20
    most_scored: int = 2**26


DEFAULT_LIMITS = Limits()


def branch_and_bound(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    objective: Objective,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
    share: float = 1.0,
    guard_radius: float = 0.3,
    guarded: Cell | None = None,
    lists_all: bool = False,
    incumbent: Incumbent | None = None,
    n_threads: int = 1,
    limits: Limits = DEFAULT_LIMITS,
) -> Found:
    """Find the best cell of a search space: the same as that of the exhaustive search, its score and moments too.

    Every cell is bounded by what its matches add to N along the axis that the best cell so far determines least, or at
    first the scan: one number, without the voxels that add little (design section 3, facts 2 and 3). Where many cells
    could still be the best, they are bounded again, also along the axis across. What remains is scored, from the
    highest bound on, until no bound reaches the best score; or all cells of the window around them, where that is
    faster. Heights are searched from that of the prior outwards.

    Parameters
    ----------
    scan, point_map, prior, multiplicity, weighting, n_threads
        As of `exhaustive`.
    space : SearchSpace
        The cells. Sums take no more memory for more of them, only the tiles of the map in reach do.
    objective : Objective
        What a cell is worth. One without bounds (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively.
    share : float
        1 to find the best cell only; less, above 0, to find the second best too, if it reaches this ratio to the best.
    guard_radius : float
        The second best lies farther than this from the best cell, m, at the same height.
    guarded : tuple of 3 int, optional
        The cell that it lies far from, and whose score it is compared with, if not the best one: that of another
        objective, at the height of the best cell.
    lists_all : bool
        Whether every cell that reaches the ratio is found.
    incumbent : Incumbent, optional
        A score from elsewhere: only cells that reach it are sought. If none does, that is proved; the score that comes
        back is below it (minus infinity where nothing was scored), and the cell means nothing.
    limits : Limits
        When to score, to bound again, or to score a window.

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's; or the space is too large to be searched exhaustively, and bounds decide too
        little or the objective has none.
    OptionError
        If an option has a value that it cannot take.
    ArrayError
        If the prior lies so far out that voxels have no index there, or the objective returns scores of another shape,
        NaN, or negative ones.
    """
    space = cells_of(space, point_map)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    if not 0.0 < share <= 1.0:
        raise OptionError(f"Expected `share` above 0 and at most 1, got {share}. With 1 only the best cell is found.")
    check_threads(n_threads)
    if not 0.0 <= guard_radius < math.inf:
        raise OptionError(f"Expected `guard_radius` >= 0 m, got {guard_radius}. The default is 0.3.")
    if not isinstance(objective, Bounded):
        check_all_fit(space.plane)

    def search(height: int, share: float, incumbent: Incumbent | None) -> Found:
        raised = space.raised(prior, height)
        prepared = PreparedScan.prepare(scan, point_map, raised, space.plane, multiplicity, weighting)
        scored = ScoredCells(prepared, Checked(objective), share, guard_radius, guarded, lists_all, incumbent)
        if isinstance(objective, Bounded):
            found = BoundedSearch(bounding_of(objective, prepared), scored, limits, n_threads).run()
        else:
            every_heading, whole = np.arange(len(space.headings)), Window.of(space)
            rest = scored.score_window(every_heading, whole, n_threads, n_threads * limits.scored_per_pass)
            found = scored.found(rest=max(rest, scored.runner_up()))
        return replace(found, height=height)

    return _best_of_heights(search, space, share, incumbent)


def _best_of_heights(
    search: Callable[[int, float, Incumbent | None], Found],
    space: SearchSpace,
    share: float,
    incumbent: Incumbent | None,
) -> Found:
    """Search height by height, from that of the prior outwards; `share` is asked for at that of the best cell."""

    def rank(found: Found) -> tuple[float, int, int, int, int]:
        heading, y, x = found.cell
        return -found.score, heading, found.height, y, x

    middle = space.n_heights // 2
    first, *others = sorted(range(space.n_heights), key=lambda height: abs(height - middle))
    best = search(first, share, incumbent)
    n_scored = best.n_scored
    for height in others:
        if incumbent is None or best.score > incumbent.score:
            incumbent = Incumbent(best.score, best.moments)
        found = search(height, 1.0, incumbent)
        n_scored += found.n_scored
        best = min(best, found, key=rank)
    if best.height != first and share < 1.0:  # so far nothing but the best cell was looked for there
        best = search(best.height, share, None)
        n_scored += best.n_scored
    return replace(best, n_scored=n_scored)


@dataclass(eq=False)
class BoundedSearch:
    """State of a search at one height; `ruled_out` is the highest bound of the cells that were discarded."""

    bounding: Bounding
    scored: ScoredCells
    limits: Limits
    n_threads: int
    ruled_out: float = 0.0

    def run(self) -> Found:
        """Find the best cell, and prove what the others score at most."""
        if self.bounding.prepared.matches_nothing:
            self.scored.score(np.array([FIRST_OF_ALL]))
            return self.scored.found(rest=self.scored.best)
        # Bound all cells, part by part.
        bounded, crowded = [], []
        parts = self._parts()
        for part in parts:
            sums = self._sum_and_score(part)
            if len(parts) > 1 and sums.count_reaching(self._least_sum()) > self.limits.most_kept:
                crowded.append(part)  # other parts may have better cells, which leave less open
            else:
                bounded.append(self._left_open(sums))
        # Branch: all cells of the windows around very many candidates, and the others one by one.
        candidates = Candidates.none()
        for left_open in bounded:
            candidates = candidates.joined(self._search_around(self._reaching(left_open)))
        for part in crowded:
            candidates = candidates.joined(self._search_around(self._left_open(self._sum_and_score(part))))
        self._score_best_first(candidates)
        return self.scored.found(rest=max(self.ruled_out, self.scored.runner_up()))

    def _parts(self) -> list[Part]:
        """Headings and windows that make up the space, as large as memory allows, from those near the prior on."""
        space = self.bounding.prepared.space
        n_headings, ny, nx = space.shape
        most_headings = max(1, min(self.limits.headings_per_pass, self.limits.cells_per_pass // (ny * nx)))
        parts = np.array_split(np.arange(n_headings), -(-n_headings // most_headings))
        bands = list(Window.of(space).bands(self.limits.cells_per_pass))
        parts.sort(key=lambda headings: abs(headings.mean() - (n_headings - 1) / 2))
        bands.sort(key=lambda window: abs(window.y_first + window.y_last))
        return [(headings, window) for headings in parts for window in bands]

    def _sum_and_score(self, part: Part) -> CellSums:
        """Sum up what bounds all cells of a part, and score those of the highest sums."""
        sums = self.bounding.sum_up(*part, self._summand(), self.n_threads)
        is_first = self.scored.best <= 0.0
        if is_first:
            self.scored.score(sums.units.highest(self.limits.first_cells))
        n_open = sums.count_reaching(self._least_sum())
        if n_open > self.limits.most_candidates:
            self.scored.score(sums.units.highest(self.limits.scored_at_once))
        elif n_open and not is_first:
            self.scored.score(sums.units.highest(self.limits.first_cells))
        return sums

    def _left_open(self, sums: CellSums) -> Candidates:
        """Cells that may reach the asked score; where these are many, after a second bound."""
        cells, highest_other = sums.reaching(self._least_sum())
        self._rule_out(self.bounding.upper_along(np.array([highest_other])))
        candidates = self._reaching(Candidates(cells, self.bounding.upper_along(sums.at(cells))))
        if self.limits.most_candidates < len(candidates) <= len(sums) // self.limits.undecided:
            return self._bound_again(candidates, sums)
        return candidates

    def _bound_again(self, candidates: Candidates, sums: CellSums) -> Candidates:
        """Bound candidates along the axis of the best cell so far, and across it, in the window around them only."""
        summand = self._summand()
        if summand != sums.summand:
            sums = self.bounding.sum_up(*self._around(candidates), summand, self.n_threads)
            candidates = self._reaching(candidates.below(self.bounding.upper_along(sums.at(candidates.cells))))
        across = self.bounding.across(summand)
        if across is not None and len(candidates) > self.limits.most_candidates:
            sums_across = self.bounding.sum_up(*self._around(candidates), across, self.n_threads)
            upper = self.bounding.upper(sums.at(candidates.cells), sums_across.at(candidates.cells))
            candidates = self._reaching(candidates.below(upper))
        return candidates

    def _search_around(self, candidates: Candidates) -> Candidates:
        """Score the whole window around many candidates, if that is faster. Returns those that are left."""
        limits = self.limits
        if len(candidates) <= limits.most_candidates:
            return candidates
        headings, window = self._around(candidates)
        n_visited = len(headings) * math.prod(n + limits.margin for n in window.shape)
        if n_visited > limits.cells_per_candidate * len(candidates):
            return candidates
        n_scored = self.scored.n_in_windows + len(headings) * math.prod(window.shape)
        if n_scored > limits.most_scored:
            raise SearchSpaceError(
                f"Expected bounds to leave at most {limits.most_scored:,} cells of the search space to be looked at,"
                f" got {n_scored:,}: nothing stands out. Narrow the search space, or see whether scan and map belong"
                " together."
            )
        rest = self.scored.score_window(headings, window, self.n_threads, limits.scored_per_pass)
        self.ruled_out = max(self.ruled_out, rest)
        return Candidates.none()

    def _score_best_first(self, candidates: Candidates) -> None:
        """Score candidates until none is left that could be the best, or the second best that is asked for."""
        candidates = candidates[np.argsort(-candidates.upper, kind="stable")]
        at_once, n_scored = self.limits.scored_at_once, 0
        while n_scored < len(candidates) and candidates.upper[n_scored] >= self.scored.best:
            self.scored.score(candidates.cells[n_scored : n_scored + at_once])
            n_scored += at_once
        others = candidates[n_scored:]
        if self.scored.lists_all:
            self.scored.score(self._reaching(others).cells)
            return
        others = others[self.scored.is_beyond(others.cells)]
        n_scored, runner_up = 0, self.scored.runner_up()
        while n_scored < len(others) and others.upper[n_scored] >= max(self.scored.asked, runner_up):
            some = others.cells[n_scored : n_scored + at_once]
            self.scored.score(some)
            runner_up = max(runner_up, self.scored.highest_of(some))
            n_scored += at_once
        self._rule_out(others.upper[n_scored:])

    def _summand(self) -> Summand:
        """What to sum next, from the best cell so far."""
        leader = self.scored.leader
        best = leader.moments if leader is not None and leader.score > 0.0 else None
        return self.bounding.summand(best, self.limits.left_out * self.scored.asked, self.limits.left_out_of_scan)

    def _around(self, candidates: Candidates) -> Part:
        """The headings of candidates, and the smallest window around them."""
        cells = candidates.cells
        return np.unique(cells[:, 0]), Window.around(cells, self.bounding.prepared.space)

    def _least_sum(self) -> float:
        """Least sum over its matches with which a cell may reach the asked score."""
        return self.bounding.least_sum(self.scored.asked, self.limits.bound_steps)

    def _reaching(self, candidates: Candidates) -> Candidates:
        """Those that may reach the asked score; the others are ruled out."""
        is_left = candidates.upper >= self.scored.asked
        self._rule_out(candidates.upper[~is_left])
        return candidates[is_left]

    def _rule_out(self, upper: Scores) -> None:
        """Discard cells that score no more than this."""
        self.ruled_out = max(self.ruled_out, float(upper.max(initial=0.0)))
