# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Branch and bound: the best cell of the exhaustive search, from bounds of all cells and the moments of few.

Read `BoundedSearch.run` beside section 3 of the design. It uses the scan prepared for the map (`prepared_scan`), upper
limits of scores (`bounds`), and the cells scored so far (`ScoredCells`, below).
"""

import math
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.bounds import Bounding, CellSums, Summand, bounding_of
from maxcon.search.cells import Candidates, CellGrid, Window
from maxcon.search.found import Found, Standing, Wanted
from maxcon.search.heights import best_of_heights
from maxcon.search.limits import DEFAULT_LIMITS, Limits
from maxcon.search.matching import cells_of, check_all_fit, check_threads
from maxcon.search.objectives import Bounded, Checked, Moments, Objective, Scores
from maxcon.search.options import Multiplicity, Weighting
from maxcon.search.prepared_scan import Headings, PreparedScan
from maxcon.search.space import Cell, SearchSpace

__all__ = ["branch_and_bound"]

FIRST_OF_ALL: Cell = (0, 0, 0)
SMALLEST = float(np.nextafter(0.0, 1.0))

Part = tuple[Headings, Window]
"""Cells of a search space: those of a window at some headings, by number."""


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
    standing: Standing | None = None,
    n_threads: int = 1,
    limits: Limits = DEFAULT_LIMITS,
) -> Found:
    """Find the best cell of a search space: the same as that of the exhaustive search, its score and moments too.

    Every cell is bounded by what its matches add to N along one axis, the one that the best cell so far determines
    least, or at first the scan: a single number, for which no point votes on voxels that add little (design section 3,
    facts 2 and 3). Where many cells could still be the best, they are bounded along the axis that the best cell so far
    determines least, and along the other one too, in the window around them. What remains is scored, from the highest
    bound on, until no bound reaches the best score; or all cells of that window are, where that is faster.

    Heights are searched from that of the prior outwards, and at each only for cells that reach the best score so far.

    Parameters
    ----------
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge.
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells. Sums do not take more memory for more of them, only the tiles of the map in reach do.
    objective : Objective
        What a cell is worth. One without bounds (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    weighting : {"cosine", "published", "one"}
        Weight of a match in N, see `Weighting` (D5).
    share : float
        1 to find the best cell only; less, above 0, to find the runner-up too, if it reaches this share of the best.
    guard_radius : float
        The runner-up lies farther than this from the best cell, m, at the same height.
    guarded : tuple of 3 int, optional
        The cell that it lies far from, and whose score it is compared with, if not the best one: that of another
        objective, at the height of the best cell.
    lists_all : bool
        Whether every cell that reaches the share is found, not only the best one and the runner-up.
    standing : Standing, optional
        A score from elsewhere: only cells that reach it are sought. If none does, that is proved; the score that comes
        back is below it (minus infinity where nothing was scored), and the cell means nothing.
    n_threads : int
        Headings are shared out among that many threads; the result does not depend on it (D8).
    limits : Limits
        When to score, to bound again, or to search exhaustively: time and memory depend on it, the best cell does not.

    Returns
    -------
    Found

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's; or the space is too large to be searched exhaustively, and bounds decide too
        little or the objective has none.
    OptionError
        If the multiplicity or the weighting is unknown, the share, the guard radius or the threads out of range.
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

    def search(height: int, share: float, standing: Standing | None) -> Found:
        raised = space.raised(prior, height)
        prepared = PreparedScan.prepare(scan, point_map, raised, space.plane, multiplicity, weighting)
        wanted = Wanted(Checked(objective), share, guard_radius, guarded, lists_all, standing)
        scored = ScoredCells(prepared, wanted)
        if isinstance(objective, Bounded):
            found = BoundedSearch(bounding_of(objective, prepared), scored, limits, n_threads).run()
        else:
            every_heading, whole = np.arange(len(space.headings)), Window.of(space)
            rest = scored.score_window(every_heading, whole, n_threads, n_threads * limits.scored_per_pass)
            found = scored.found(rest=max(rest, scored.runner_up()))
        return replace(found, height=height)

    return best_of_heights(search, space, share, standing)


@dataclass
class BoundedSearch:
    """State of a search at one height.

    Parameters
    ----------
    bounding : Bounding
        The most that cells can score.
    scored : ScoredCells
        The cells scored so far.
    limits : Limits
        When to score, to bound again, or to look at all cells of a window.
    n_threads : int
        Headings are shared out among that many threads.
    ruled_out : float
        The highest bound of the cells that were discarded.
    """

    bounding: Bounding
    scored: "ScoredCells"
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
        # Answer.
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
            self.scored.score(sums.highest(self.limits.first_cells))
        n_open = sums.count_reaching(self._least_sum())
        if n_open > self.limits.most_candidates:
            self.scored.score(sums.highest(self.limits.scored_at_once))
        elif n_open and not is_first:
            self.scored.score(sums.highest(self.limits.first_cells))
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
        """Bound candidates by the sum that the best cell so far asks for, and by the one across.

        Only the window around them is looked at.
        """
        summand = self._summand()
        if summand != sums.summand:
            sums = self.bounding.sum_up(*self._around(candidates), summand, self.n_threads)
            upper = self.bounding.upper_along(sums.at(candidates.cells))
            candidates = self._reaching(candidates.below(upper))
        across = self.bounding.across(summand)
        if across is not None and len(candidates) > self.limits.most_candidates:
            sums_across = self.bounding.sum_up(*self._around(candidates), across, self.n_threads)
            upper = self.bounding.upper(sums.at(candidates.cells), sums_across.at(candidates.cells))
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
        rest = self.scored.score_window(headings, window, self.n_threads, limits.scored_per_pass)
        self.ruled_out = max(self.ruled_out, rest)
        return Candidates.none()

    def _score_best_first(self, candidates: Candidates) -> None:
        """Score candidates until none is left that could be the best, or the runner-up that is asked for."""
        candidates = candidates[np.argsort(-candidates.upper, kind="stable")]
        at_once, n_scored = self.limits.scored_at_once, 0
        while n_scored < len(candidates) and candidates.upper[n_scored] >= self.scored.best:
            self.scored.score(candidates.cells[n_scored : n_scored + at_once])
            n_scored += at_once
        others = candidates[n_scored:]
        if self.scored.wanted.lists_all:
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
        return self.bounding.summand(self.scored.leader, self.scored.asked, self.limits)

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
        self.prepared = prepared
        self.wanted = wanted
        self._best, self._cell = -math.inf, FIRST_OF_ALL
        self._moments: Moments = np.zeros(4)
        self._singles: dict[Cell, float] = {}  # scores of the cells that were scored by themselves
        self._of_windows = Candidates.none()  # cells of windows that reach what is asked
        self._n_in_windows = 0
        if wanted.guarded is not None:
            self.score(np.array([wanted.guarded]))

    @property
    def best(self) -> float:
        """Score from which on a cell is the best one, or as good: the highest so far, or that of the incumbent."""
        standing = self.wanted.standing
        return self._best if standing is None else max(self._best, standing.score)

    @property
    def asked(self) -> float:
        """Score from which on a cell is looked for: a share of the best, or of the guarded one; and what stands."""
        guarded, standing = self.wanted.guarded, self.wanted.standing
        asked = self.wanted.share * (self._best if guarded is None else self._singles[guarded])
        return asked if standing is None else max(asked, standing.score)

    @property
    def leader(self) -> Standing | None:
        """The best cell so far, or what it has to reach if that is more; none before any is scored."""
        standing = self.wanted.standing
        if self._best == -math.inf or (standing is not None and standing.score >= self._best):
            return standing
        return Standing(self._best, self._moments)

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
            moments = self.prepared.moments_of_cells(heading, np.array(mine, np.int64))
            for cell, score, four in zip(mine, self.wanted.objective.score(moments).tolist(), moments, strict=True):
                self._singles[cell] = score
                self._note(cell, score, four)

    def score_window(self, headings: Headings, window: Window, n_threads: int, cells_per_pass: int) -> float:
        """Score all cells of a window at some headings, and keep those that reach what is asked.

        Returns the highest score that is not kept, of this window or an earlier one; 0 for none.
        """
        n_passes = min(-(-len(headings) * math.prod(window.shape) // cells_per_pass), len(headings))
        passes = np.array_split(headings, n_passes)
        return max(self._score_pass(some, window, n_threads) for some in passes)

    def _score_pass(self, headings: Headings, window: Window, n_threads: int) -> float:
        """Score a window at as many headings as memory allows at a time, see `score_window`."""
        moments = self.prepared.moments_of_window(headings, window, n_threads)
        space = self.prepared.space
        scores = CellGrid.of(space, headings, window, self.wanted.objective.score(moments))
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
        """Remember a cell if it is the best so far; at ties the first in index order is (D8)."""
        if (-score, cell) < (-self._best, self._cell):
            self._best, self._cell, self._moments = score, cell, moments

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one, or else from the best."""
        offsets = cells[:, 1:] - np.array((self.wanted.guarded or self._cell)[1:])
        distances = np.hypot(offsets[:, 0], offsets[:, 1]) * self.prepared.space.cell_edge
        return np.asarray(distances > self.wanted.guard_radius)

    def highest_of(self, cells: NDArray[np.int64]) -> float:
        """Highest score of some cells that were scored by themselves."""
        return max(self._singles[heading, y, x] for heading, y, x in cells.tolist())

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
        scores = np.array(list(self._singles.values()))
        return self._of_windows.joined(Candidates(cells, scores))

    def found(self, rest: float) -> Found:
        """Answer with the best cell; no other beyond the guard radius scores more than `rest`."""
        return Found(
            self._cell,
            self._best,
            self._moments.copy(),
            self.best,
            rest,
            len(self._singles) + self._n_in_windows,
            reaching=self.reaching() if self.wanted.lists_all else Candidates.none(),
        )
