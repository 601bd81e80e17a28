"""Branch and bound: the best cell of the exhaustive search, from bounds of all cells and the moments of few.

Read `_search_by_bounds` beside section 3 of the design. `prepared_scan` has the scan prepared for the map, `bounds` the
upper limits of scores, `scored_cells` the cells scored so far.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import Multiplicity, Weighting, cells_of, check_all_fit, check_threads
from maxcon.search.bounds import Bounding, bounding_of
from maxcon.search.objectives import Bounded, Checked, Objective, Scores
from maxcon.search.prepared_scan import PASS_CELLS, Headings, PreparedScan
from maxcon.search.scored_cells import Found, ScoredCells
from maxcon.search.space import Cell, SearchSpace

# When to score, to sum again, or to score all cells of a heading: a matter of time and memory, not of the best cell.
# After each pass so many cells of the highest bounds are scored; in the end so many at a time, highest bounds first.
FIRST_CELLS, SCORED_AT_ONCE = 2, 8
# If a pass leaves more cells open, they are summed again, along the axis of the best cell so far.
MOST_LEFT_OPEN = 192
# Cells of a heading that are scored together in the time that one cell by itself takes.
CELLS_PER_SINGLE = 120
# Cells bounded in one pass: 2^22 sums take 16 MiB, or 32 MiB where voxels count as often as they have points.
HEADINGS_PER_PASS, CELLS_PER_PASS = 16, 2**22
# A search is refused if it has more cells at one heading, or if bounds leave more cells open.
MOST_SCORED = 2**26


@dataclass(frozen=True, slots=True, eq=False)
class LeftOpen:
    """Cells (n, 3) that are not ruled out, and the most that each scores, (n,)."""

    cells: NDArray[np.int64]
    upper: Scores

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.int64]) -> "LeftOpen":
        return LeftOpen(self.cells[which], self.upper[which])


def branch_and_bound(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    objective: Objective,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
    ratio: float = 1.0,
    guard_radius: float = 0.3,
    guarded: Cell | None = None,
    n_threads: int = 1,
) -> Found:
    """Find the best cell of a search space: the same as that of the exhaustive search, its score and moments too.

    Every cell is bounded by what its matches add to N along the axis that the best cell so far determines least, or at
    first the scan: one number, without the voxels that add little (design section 3, facts 2 and 3). What could still
    be the best is scored, from the highest bound on, until no bound reaches the best score; or with all cells of its
    heading, where that is faster. Heights are searched from that of the prior outwards.

    Parameters
    ----------
    scan, point_map, prior, multiplicity, weighting, n_threads
        As of `exhaustive`.
    space : SearchSpace
        The cells. Sums take no more memory for more headings, only the tiles of the map in reach do.
    objective : Objective
        What a cell is worth. One without bounds (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively.
    ratio : float
        1 to find the best cell only; less, above 0, to find the second best too, if it reaches this ratio to the best.
    guard_radius : float
        The second best lies farther than this from the best cell, m, at the same height.
    guarded : tuple of 3 int, optional
        The cell that it lies far from, and whose score it is compared with, if not the best one: that of another
        objective, at the height of the best cell.

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
    if not 0.0 < ratio <= 1.0:
        raise OptionError(f"Expected `ratio` above 0 and at most 1, got {ratio}. With 1 only the best cell is found.")
    check_threads(n_threads)
    if not 0.0 <= guard_radius < math.inf:
        raise OptionError(f"Expected `guard_radius` >= 0 m, got {guard_radius}. The default is 0.3.")
    if not isinstance(objective, Bounded):
        check_all_fit(space.plane)

    def search(height: int, ratio: float, known: Found | None) -> Found:
        raised = space.raised(prior, height)
        prepared = PreparedScan.prepare(scan, point_map, raised, space.plane, multiplicity, weighting)
        scored = ScoredCells(prepared, Checked(objective), ratio, guard_radius, guarded, known)
        if isinstance(objective, Bounded):
            _search_by_bounds(bounding_of(objective, prepared), scored, n_threads)
        else:
            _score_headings(np.arange(len(space.headings)), scored, n_threads)
        return scored.found(height)

    first, *others = sorted(range(space.n_heights), key=lambda height: abs(height - space.n_heights // 2))
    best = search(first, ratio, None)
    n_scored = best.n_scored
    for height in others:
        found = search(height, 1.0, best)
        n_scored += found.n_scored
        best = min(best, found, key=lambda each: (-each.score, each.cell[0], each.height, each.cell))
    if best.height != first and ratio < 1.0:  # so far nothing but the best cell was looked for there
        best = search(best.height, ratio, None)
        n_scored += best.n_scored
    return replace(best, n_scored=n_scored)


def _search_by_bounds(bounding: Bounding, scored: ScoredCells, n_threads: int) -> None:
    """Score the best cell of one height and what is asked for beside it, and bound what all others score."""
    if bounding.prepared.matches_nothing:
        scored.score(np.zeros((1, 3), np.int64))
        return
    left_open = _left_open(bounding, scored, n_threads)
    # Branch: all cells of the headings at which very many are left open, and the others one by one.
    _, ny, nx = bounding.prepared.space.shape
    headings, n_left = np.unique(left_open.cells[:, 0], return_counts=True)
    crowded = headings[n_left > max(MOST_LEFT_OPEN, ny * nx // CELLS_PER_SINGLE)]
    _score_headings(crowded, scored, n_threads)
    _score_best_first(left_open[~np.isin(left_open.cells[:, 0], crowded)], scored)


def _left_open(bounding: Bounding, scored: ScoredCells, n_threads: int) -> LeftOpen:
    """Bound all cells, and score the most promising ones: the cells that are not ruled out then."""
    left_open = LeftOpen(np.empty((0, 3), np.int64), np.empty(0))
    for headings in _passes(bounding.prepared.space):
        sums = bounding.sum_up(headings, bounding.summand(scored.best_moments, scored.asked), n_threads)
        scored.score(sums.highest(FIRST_CELLS))
        cells, highest_other = sums.reaching(bounding.least_sum(scored.asked))
        upper = bounding.upper(sums.at(cells))
        scored.rule_out(bounding.upper(np.array([highest_other])))
        summand = bounding.summand(scored.best_moments, scored.asked)
        if len(cells) > MOST_LEFT_OPEN and summand.axis != sums.summand.axis:
            # Once more, along the axis that the best cell determines least.
            sums = bounding.sum_up(np.unique(cells[:, 0]), summand, n_threads)
            upper = np.minimum(upper, bounding.upper(sums.at(cells)))
            scored.score(sums.highest(FIRST_CELLS))
        # The best score may have risen: what earlier passes left open must reach what is asked for now.
        left_open = LeftOpen(np.concatenate([left_open.cells, cells]), np.append(left_open.upper, upper))
        is_left = left_open.upper >= scored.asked
        scored.rule_out(left_open.upper[~is_left])
        left_open = left_open[is_left]
        _check(len(left_open.cells))
    return left_open


def _passes(space: SearchSpace) -> list[Headings]:
    """All headings, by number, in parts as large as memory allows, from those near the prior on."""
    n_headings, ny, nx = space.shape
    _check(ny * nx)
    most = max(1, min(HEADINGS_PER_PASS, CELLS_PER_PASS // (ny * nx)))
    parts = np.array_split(np.arange(n_headings), -(-n_headings // most))
    return sorted(parts, key=lambda headings: abs(float(headings.mean()) - (n_headings - 1) / 2))


def _score_headings(headings: Headings, scored: ScoredCells, n_threads: int) -> None:
    """Score all cells of some headings, as many at a time as memory allows."""
    _, ny, nx = scored.prepared.space.shape
    _check(len(headings) * ny * nx)
    most = n_threads * max(1, PASS_CELLS // (ny * nx))
    for first in range(0, len(headings), most):
        scored.score_headings(headings[first : first + most], n_threads)


def _score_best_first(left_open: LeftOpen, scored: ScoredCells) -> None:
    """Score cells until none is left that could be the best, or the second best that is asked for."""
    left_open = left_open[np.argsort(-left_open.upper, kind="stable")]
    n = 0
    while n < len(left_open.cells) and left_open.upper[n] >= scored.best:
        scored.score(left_open.cells[n : n + SCORED_AT_ONCE])
        n += SCORED_AT_ONCE
    others = left_open[n:]
    others = others[scored.is_beyond(others.cells)]
    n = 0
    while n < len(others.cells) and others.upper[n] >= max(scored.asked, scored.second_best()):
        scored.score(others.cells[n : n + SCORED_AT_ONCE])
        n += SCORED_AT_ONCE
    scored.rule_out(others.upper[n:])


def _check(n_cells: int) -> None:
    """Refuse a search of too many cells."""
    if n_cells > MOST_SCORED:
        raise SearchSpaceError(
            f"Expected at most {MOST_SCORED:,} cells at one heading, or left to be looked at by bounds, got"
            f" {n_cells:,}: nothing stands out. Narrow the search space, or see whether scan and map belong together."
        )
