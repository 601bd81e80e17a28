"""The best cell of a search space, by the search that suits the space and the objective, and its status so far."""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.integrity import Trust, highest_beyond, invert, reasons_to_doubt_answer, reasons_to_doubt_scan
from maxcon.map import PointMap
from maxcon.refine.candidates import Candidate, Scoring, find_candidates
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
from maxcon.search.coarse import CELL, STEP_DEG
from maxcon.search.objectives import Bounded, Helmert, Moments, Objective
from maxcon.search.space import PAPER_STEP_DEG, Cell, SearchSpace

# Least ratio to the best score that is asked for, where every other candidate is to be known.
LEAST_RATIO = 1e-6
# Scores in large cells rank poses less sharply than those in small ones: a candidate is followed if it reaches this
# part of the asked ratio.
BLUNT = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class BestCell:
    """The best cell of a search at one height, and Helmert's score of the second best candidate over its own.

    space, prior: the cells of its height, and the prior raised to it.
    cell, score, moments: index, score and moments, shape (4,), of the cell.
    runner_up: the ratio.
    is_at_boundary: whether the cell lies at the boundary of the whole space; None: that is still to be found.
    share: ratio of the searched points that match; None: that of the thinned scan is still to be found.
    is_mirrored: whether the mirror image of the scan fits better.
    """

    space: SearchSpace
    prior: Pose
    cell: Cell
    score: float
    moments: Moments
    runner_up: float
    is_at_boundary: bool | None = None
    share: float | None = None
    is_mirrored: bool = False

    @classmethod
    def at(cls, candidate: Candidate, point_map: PointMap, runner_up: float, *, is_at_boundary: bool) -> "BestCell":
        """Return the cell, the only one of its space, that stands for the pose of a candidate."""
        here = SearchSpace(0.0, heading_half_width_deg=0.0).at(point_map.cell)
        return cls(
            here, candidate.pose, (0, 0, 0), candidate.score, candidate.moments, runner_up, is_at_boundary,
            candidate.share, candidate.is_mirrored,
        )  # fmt: skip

    @property
    def pose(self) -> Pose:
        """T_map_sensor of the cell, local frame."""
        return self.space.pose(self.cell, self.prior)


@dataclass(frozen=True, slots=True)
class CellSearch:
    """How the best cell is found and judged; its parameters are those of `MaximumConsensus`."""

    objective: Objective
    multiplicity: str | Multiplicity
    weighting: str | Weighting
    search: str | SearchMethod
    thinning: float
    n_threads: int
    trust: Trust

    def best(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> Estimate:
        """Return the estimate of the best cell of a space around a start; of an open one, of the best candidate."""
        if self.is_coarse_to_fine(space):
            candidates = self.candidates(scan, point_map, start, space)
            if candidates:
                return replace(self.estimate(candidates[0], scan, point_map), cell=None)
            # Nothing scores: the large cells say how many points match all the same.
            level, cells = self.level_and_cells(space, point_map)
            return replace(self.conclude(self.accumulate(scan, level, start, cells), scan, level), cell=None)
        level, cells = self.level_and_cells(space, point_map)
        if self.search is SearchMethod.BRANCH_AND_BOUND and isinstance(self.objective, Bounded):
            best = self._by_bounds(scan.thinned(self.thinning), level, start, cells)
            if best is not None:
                return self.estimate(best, scan, level)
        return self.conclude(self.accumulate(scan, level, start, cells), scan, level)

    def level_and_cells(self, space: SearchSpace, point_map: PointMap) -> tuple[PointMap, SearchSpace]:
        """The level of the map, and the cells, that a space is searched in; coarse to fine the coarse ones."""
        if self.is_coarse_to_fine(space):
            level = point_map.nearest_level(CELL)
            return level, space.at(level.cell, STEP_DEG)
        cells = space.at(point_map.cell)
        return level_of(point_map, cells), cells

    def is_coarse_to_fine(self, space: SearchSpace) -> bool:
        """Whether a space is searched in large cells first, whose candidates are adjusted: an open one."""
        return space.is_open and self.search is SearchMethod.BRANCH_AND_BOUND

    def candidates(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> list[BestCell]:
        """Candidates of an open space, the highest score first; none where nothing scores.

        `runner_up` of each is the highest other candidate's ratio, or the ratio below which large cells were not
        followed, if that is higher.
        """
        scoring = Scoring(self.objective, Multiplicity(self.multiplicity), Weighting(self.weighting))
        ratio = BLUNT * self._asked_ratio
        found, rest = find_candidates(scan, point_map, start, space, ratio, scoring, self.n_threads)
        scores = [float(Helmert().score(each.moments)) for each in found]

        def ratio_of_other(k: int) -> float:
            """Ratio of scores, or of scores times shares if that is less: score and matches both have to rival."""
            if scores[k] <= 0.0:
                return math.inf
            others = [j for j in range(len(found)) if j != k]
            return max([rest, *(scores[j] / scores[k] * min(1.0, found[j].share / found[k].share) for j in others)])

        return [
            BestCell.at(
                one, point_map, ratio_of_other(k), is_at_boundary=is_at_boundary(one.pose, start, space, point_map.cell)
            )
            for k, one in enumerate(found)
        ]

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
            is_inside = point_map.covers(prior.x, prior.y, space.half_width)
            outside = () if is_inside else ("outside the map: is the pose in its local frame (`frame.pose_to_local`)?",)
            reason = "; ".join([*outside, *reasons_to_doubt_scan(scan, prior)])
            return Estimate(prior, 0.0, cell, Status.NO_MATCH, cofactor, reason=reason)
        helmert = scores if isinstance(self.objective, Helmert) else accumulator.score(Helmert())
        beyond = highest_beyond(helmert, cell, space, self.trust.guard_radius)
        runner_up = beyond / float(helmert[cell]) if helmert[cell] > 0.0 else math.inf
        best = BestCell(space, prior, cell, float(scores[cell]), moments[cell], runner_up)
        return self.estimate(best, scan, point_map)

    def estimate(self, best: BestCell, scan: Scan, point_map: PointMap) -> Estimate:
        """Return the estimate of a best cell: how far it may be trusted, and what casts doubt on it."""
        _, nxx, nxy, nyy = (float(moment) for moment in best.moments)
        is_determined, cofactor = invert(np.array([[nxx, nxy], [nxy, nyy]]))
        at_boundary, share = best.is_at_boundary, best.share
        if share is None:
            share = self._matched_ratio(best, scan.thinned(self.thinning), point_map)
        if at_boundary is None:
            searched = scan.thinned(self.thinning)
            at_boundary = best.space.is_at_boundary(best.cell) or self._is_higher_beyond(best, searched, point_map)
        status = self.trust.status_of_cell(
            is_determined=is_determined, share=share, is_at_boundary=at_boundary, runner_up=best.runner_up
        )
        reasons = reasons_to_doubt_scan(scan, best.prior)
        if self.multiplicity == Multiplicity.OCCUPIED:  # otherwise N counts map points, not matches
            reasons += reasons_to_doubt_answer(best.moments)
        if status is Status.AMBIGUOUS:
            reasons.append(f"another place scores {best.runner_up:.2f} of it by Helmert's score")
        elif status is Status.FEW_MATCHES:
            reasons.append(f"{100.0 * share:.1f} % of the points match")
        if best.is_mirrored:
            status = Status.MISFIT if self.trust.largest_misfit < math.inf else status
            reasons.append("the mirror image of the scan fits better: is its y to the left?")
        return Estimate(best.pose, best.score, best.cell, status, cofactor, share, best.runner_up, "; ".join(reasons))

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
        ratio = self._asked_ratio
        found = self._branch_and_bound(self.objective)(scan, point_map, prior, space, ratio=ratio)
        raised, plane = space.raised(prior, found.height), space.plane
        score = float(Helmert().score(found.moments))
        if score <= 0.0:
            return None
        helmert = found
        if not isinstance(self.objective, Helmert):
            search = self._branch_and_bound(Helmert())
            helmert = search(scan, point_map, raised, plane, ratio=ratio, guarded=found.cell)
        return BestCell(plane, raised, found.cell, found.score, found.moments, helmert.second_best / score)

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


def is_at_boundary(pose: Pose, prior: Pose, space: SearchSpace, cell: float) -> bool:
    """Whether a pose lies in the outermost cell of a space, or beyond."""
    offsets = (pose.x - prior.x, pose.y - prior.y)
    turn_deg = math.degrees(abs(wrap_angle(pose.heading - prior.heading)))
    # Offsets run from -half_width to half_width - cell; half a cell, so that rounding decides nothing. Of two columns
    # none is an inner one: only what lies beyond them is far then.
    margin = 0.5 * cell if space.half_width > 1.5 * cell else -0.5 * cell
    is_low, is_high = min(offsets) < margin - space.half_width, max(offsets) > space.half_width - cell - margin
    is_far = space.half_width > 0.0 and (is_low or is_high)
    return is_far or turn_deg > space.heading_half_width_deg + 0.5 * PAPER_STEP_DEG
