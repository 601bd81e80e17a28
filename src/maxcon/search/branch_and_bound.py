# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Branch and bound: the best cell of the exhaustive search, from bounds of all cells and the moments of few."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maxcon.accumulator import Accumulator, highest
from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.integrity import highest_beyond
from maxcon.objectives import BoundedByAxes, BoundedByCount, Objective
from maxcon.options import Multiplicity, Weighting
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search.bounded_search import BoundedSearch
from maxcon.search.bounding import bounding_of
from maxcon.search.bounds import Bounds
from maxcon.search.candidates import Candidates
from maxcon.search.exhaustive import exhaustive
from maxcon.search.found import Found, Standing, Wanted
from maxcon.search.heights import outwards
from maxcon.search.limits import DEFAULT_LIMITS, Limits
from maxcon.search.matching import cells_of, check_threads
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.scored_cells import ScoredCells
from maxcon.search_space import Cell, SearchSpace

__all__ = ["branch_and_bound"]


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
        A score already reached elsewhere: only cells that reach it are sought. If none does, that is proved; the score
        that comes back is below it (minus infinity where nothing was scored), and the cell means nothing.
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
        If the prior lies so far out that voxels have no index there.
    """
    space = cells_of(space, point_map)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    if not 0.0 < share <= 1.0:
        raise OptionError(
            f"Expected `share` above 0 and at most 1, got {share}. With 1 only the best cell is found."
        )
    check_threads(n_threads)
    if not 0.0 <= guard_radius < math.inf:
        raise OptionError(f"Expected `guard_radius` >= 0 m, got {guard_radius}. The default is 0.3.")

    def search(height: int, share: float, standing: Standing | None) -> Found:
        wanted = Wanted(objective, share, guard_radius, guarded, lists_all, standing)
        raised = space.raised(prior, height)
        if isinstance(objective, BoundedByCount | BoundedByAxes):
            prepared = PreparedScan.prepare(scan, point_map, raised, space.plane, multiplicity, weighting)
            bounds = Bounds.of(bounding_of(objective, prepared))
            scored = ScoredCells(prepared, wanted)
            found = BoundedSearch(bounds, scored, wanted, limits, n_threads).run()
        else:
            accumulator = exhaustive(
                scan, point_map, raised, space.plane,
                multiplicity=multiplicity, weighting=weighting, n_threads=n_threads,
            )  # fmt: skip
            found = _best_of_all(accumulator, wanted)
        return replace(found, height=height)

    return _best_of_heights(search, space, share, standing)


def _best_of_heights(
    search: Callable[[int, float, Standing | None], Found],
    space: SearchSpace,
    share: float,
    standing: Standing | None,
) -> Found:
    """The best of what is found at each height, and its runner-up as at a single one.

    search : given the number of a height, the share, and what stands already, what is found there.
    """

    def rank(found: Found) -> tuple[float, int, int, int, int]:
        heading, y, x = found.cell
        return -found.score, heading, found.height, y, x

    first, *others = outwards(space)
    best = search(first, share, standing)
    n_scored = best.n_scored
    for height in others:
        if standing is None or best.score > standing.score:
            standing = Standing(best.score, best.moments)
        found = search(height, 1.0, standing)
        n_scored += found.n_scored
        best = min(best, found, key=rank)
    if best.height != first and share < 1.0:  # so far nothing but the best cell was looked for there
        best = search(best.height, share, None)
        n_scored += best.n_scored
    return replace(best, n_scored=n_scored)


def _best_of_all(accumulator: Accumulator, wanted: Wanted) -> Found:
    """What is wanted, where the moments of all cells are known: for objectives without bounds."""
    space, scores = accumulator.space, accumulator.score(wanted.objective)
    cell = highest(scores, space)
    rest = highest_beyond(scores, wanted.guarded or cell, space, wanted.guard_radius)
    score = float(scores[cell])
    reaching = Candidates.none()
    if wanted.lists_all:
        cells = np.argwhere(scores >= wanted.share * score)
        reaching = Candidates(cells, np.asarray(scores[tuple(cells.T)], np.float64))
    return Found(cell, score, accumulator.moments[cell].copy(), score, rest, scores.size, reaching=reaching)
