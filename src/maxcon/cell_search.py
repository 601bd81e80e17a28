# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The best cell of a search space, by the search that suits the space and the objective, and how far it is trusted."""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, highest_beyond, invert, reasons_to_doubt_answer, reasons_to_doubt_scan
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search import (
    Found,
    Multiplicity,
    SearchMethod,
    Weighting,
    accumulators,
    branch_and_bound,
    exhaustive,
    highest_of,
    level_of,
)
from maxcon.search.accumulator import Accumulator, highest
from maxcon.search.coarse_to_fine import COARSE, BestCell, best_candidates
from maxcon.search.objectives import Bounded, Helmert, Objective
from maxcon.search.space import SearchSpace

# Least ratio to the best score that is asked for, where every other candidate is to be known.
LEAST_RATIO = 1e-6
# An open space of fewer of the map's own cells is searched in these at once: that is as fast.
FEW_CELLS = 8_000


@dataclass(frozen=True, slots=True)
class CellSearch:
    """How the best cell is found and validated; its parameters are those of `MaximumConsensus`."""

    objective: Objective
    multiplicity: str | Multiplicity
    weighting: str | Weighting
    search: str | SearchMethod
    thinning: float
    n_threads: int
    trust: Trust

    def best(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> Estimate:
        """Return the estimate of the best cell of a space around a start."""
        if self.is_coarse_to_fine(space, point_map):
            candidates = self.candidates(scan, point_map, start, space)
            if candidates:
                return replace(self.estimate(candidates[0], scan, point_map), cell=None)
            # Nothing scores: the large cells say how many points match all the same.
        level, cells = self.level_and_cells(space, point_map)
        if self.search is SearchMethod.BRANCH_AND_BOUND and self.has_bounds:
            best = self._by_bounds(scan.thinned(self.thinning), level, start, cells)
            if best is not None:
                return self.estimate(best, scan, level)
        return self.conclude(self.accumulate(scan, level, start, cells), scan, level)

    def level_and_cells(self, space: SearchSpace, point_map: PointMap) -> tuple[PointMap, SearchSpace]:
        """The level of the map, and the cells, that a space is searched in; coarse to fine the coarse ones."""
        if self.is_coarse_to_fine(space, point_map):
            return COARSE.of(point_map), COARSE.cells(space, point_map)
        cells = space.at(point_map.cell)
        return level_of(point_map, cells), cells

    def is_coarse_to_fine(self, space: SearchSpace, point_map: PointMap) -> bool:
        """Whether a space is searched in a level of the map first: an open one of more than a few cells."""
        is_free = space.is_open and self.search is SearchMethod.BRANCH_AND_BOUND
        return is_free and space.n_cells_at(point_map.cell) > FEW_CELLS

    def candidates(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> list[BestCell]:
        """Candidates of an open space, the best first: see `best_candidates`."""
        search = self._branch_and_bound(self.objective)
        return best_candidates(search, scan.thinned(self.thinning), point_map, start, space, self._asked_ratio)

    def accumulate(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> Accumulator:
        """Moments of every cell of a space around a start, of several heights those of the best."""
        heights = accumulators(
            exhaustive, scan.thinned(self.thinning), point_map, start, space,
            multiplicity=self.multiplicity, weighting=self.weighting, n_threads=self.n_threads,
        )  # fmt: skip
        return next(heights) if space.n_heights == 1 else highest_of(heights, self.objective)[1]

    def conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Return the estimate of the best cell of an accumulator."""
        space, prior, moments = accumulator.space, accumulator.prior, accumulator.moments
        scores = accumulator.score(self.objective)
        cell = highest(scores)
        if not moments[..., 0].any():
            _, cofactor = invert(accumulator.normal_matrix(cell))
            reason = "; ".join(reasons_to_doubt_scan(scan, prior))
            return Estimate(prior, 0.0, cell, Status.NO_MATCH, cofactor, reason=reason)
        helmert = scores if isinstance(self.objective, Helmert) else accumulator.score(Helmert())
        beyond = highest_beyond(helmert, cell, space, self.trust.guard_radius)
        runner_up = beyond / float(helmert[cell]) if helmert[cell] > 0.0 else math.inf
        best = BestCell(space, prior, cell, float(scores[cell]), moments[cell], runner_up)
        return self.estimate(best, scan, point_map)

    def estimate(self, best: BestCell, scan: Scan, point_map: PointMap) -> Estimate:
        """Return the estimate of a best cell: how far it may be trusted, and what casts doubt on it."""
        searched = scan.thinned(self.thinning)
        _, nxx, nxy, nyy = (float(moment) for moment in best.moments)
        is_determined, cofactor = invert(np.array([[nxx, nxy], [nxy, nyy]]))
        share = self._matched_ratio(best, searched, point_map)
        is_at_boundary = best.is_at_boundary
        if is_at_boundary is None:
            is_at_boundary = best.space.is_at_boundary(best.cell) or self._is_higher_beyond(best, searched, point_map)
        status = self.trust.status_of_cell(
            is_determined=is_determined, share=share, is_at_boundary=is_at_boundary, runner_up=best.runner_up
        )
        reasons = reasons_to_doubt_scan(scan, best.prior)
        if self.multiplicity == Multiplicity.OCCUPIED:  # otherwise N counts map points, not matches
            reasons += reasons_to_doubt_answer(best.moments)
        return Estimate(best.pose, best.score, best.cell, status, cofactor, share, best.runner_up, "; ".join(reasons))

    @property
    def has_bounds(self) -> bool:
        """Whether the objective can be bounded, and need not be searched exhaustively."""
        return isinstance(self.objective, Bounded)

    @property
    def _asked_ratio(self) -> float:
        """Ratio to the best score from which on other candidates are to be known."""
        return max(self.trust.largest_runner_up, LEAST_RATIO)

    def _branch_and_bound(self, objective: Objective) -> "partial[Found]":
        """Branch and bound for an objective, given scan, map, prior and space."""
        return partial(
            branch_and_bound, objective=objective, multiplicity=self.multiplicity, weighting=self.weighting,
            guard_radius=self.trust.guard_radius, n_threads=self.n_threads,
        )  # fmt: skip

    def _by_bounds(self, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace) -> BestCell | None:
        """The best cell by branch and bound; None where nothing scores: all cells are scored then."""
        share = self._asked_ratio
        found = self._branch_and_bound(self.objective)(scan, point_map, prior, space, share=share)
        raised, plane = space.raised(prior, found.height), space.plane
        score = float(Helmert().score(found.moments))
        if score <= 0.0:
            return None
        helmert = found
        if not isinstance(self.objective, Helmert):
            search = self._branch_and_bound(Helmert())
            helmert = search(scan, point_map, raised, plane, share=share, guarded=found.cell)
        return BestCell(plane, raised, found.cell, found.score, found.moments, helmert.rest / score)

    def _is_higher_beyond(self, best: BestCell, scan: Scan, point_map: PointMap) -> bool:
        """Whether one step beyond the outermost heading, if that is the best one, some cell scores higher."""
        space, heading = best.space, best.cell[0]
        if not space.is_outermost(heading):
            return False
        step = math.radians(space.step_deg)
        turn = space.headings[heading] + (step if heading > 0 else -step)
        beyond = replace(best.prior, heading=best.prior.heading + float(turn))
        one_heading = replace(space, heading_half_width_deg=0.0)
        found = exhaustive(
            scan, point_map, beyond, one_heading, multiplicity=self.multiplicity, weighting=self.weighting
        )
        return bool(found.score(self.objective).max() > best.score)

    def _matched_ratio(self, best: BestCell, scan: Scan, point_map: PointMap) -> float:
        """Fraction of the scan's points that match at a cell; a count of map points has to be counted anew."""
        if self.multiplicity == Multiplicity.OCCUPIED:
            return float(best.moments[0]) / len(scan)
        here = SearchSpace(half_width=0.0, heading_half_width_deg=0.0)
        return float(exhaustive(scan, point_map, best.pose, here).moments[0, 0, 0, 0]) / len(scan)
