# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maximum-consensus localization: the page to read first.

The paper's method in the order of the paper: every cell of a search space around the prior is a candidate
pose; each match of a scan point with the map adds to its cell; the cell whose matches determine the
position best is the answer. Then what the paper does not have: its pose is adjusted to the surfaces of the
map, examined, and where in doubt searched for once more, wider (D12).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from maxcon.accumulator import Accumulator, highest
from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import (
    Trust,
    highest_beyond,
    invert,
    protection_level,
    reasons_to_doubt_answer,
    reasons_to_doubt_scan,
)
from maxcon.objectives import BoundedByAxes, BoundedByCount, Helmert, Moments, Objective
from maxcon.point_map import PointMap
from maxcon.refine import covariance, least_wall_share, refine
from maxcon.scan import Scan
from maxcon.search import Found, Multiplicity, SearchMethod, Weighting, branch_and_bound, exhaustive
from maxcon.search_space import Cell, SearchSpace

__all__ = ["MaximumConsensus"]

# Where every other place is to be known, however low it scores.
LEAST_SHARE = 1e-6


@dataclass(frozen=True)
class MaximumConsensus:
    """Localizes scans by search for the cell of highest score (equations (1), (2) and (6)).

    Parameters
    ----------
    space : SearchSpace
        The candidate poses around each prior; the paper's if not given.
    objective : Objective
        What a cell is worth; Helmert's point error if not given. Any object with ``score(moments)``.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    n_threads : int
        Headings searched at the same time; the answer does not depend on it.
    trust : Trust
        From where on an answer is not called localized.
    weighting : {"cosine", "published", "one"}
        Weight of a match in N: max(0, n_scan . n_map), and 1/2 where the scan point has no normal; the same, but 0
        there, as published; or 1 (D5).
    search : {"branch and bound", "exhaustive"}
        How the best cell is found; it is the same one. Branch and bound takes a fraction of the time. Of the
        runner-up it proves what `trust` asks for, not what it scores. An objective without bounds (`BoundedByAxes`,
        `BoundedByCount`) is searched exhaustively.
    thinning : float
        One point of the scan is searched with in each cube of this edge, m; 0 for all, as published. Near surfaces
        have most of the points, and would outvote the far ones.
    refinement : bool
        Whether the pose of the best cell is adjusted to the surfaces of the map and examined there, and a covariance
        given. Without, the answer is the cell, as published.
    wider : float
        Where an answer is in doubt, all places within so much of it along x and y are searched too, m; 0 for never, as
        where the prior is certain to hold the true pose.
    risk : float
        The error may be larger than the protection level with at most this probability.

    Raises
    ------
    OptionError
        If the multiplicity, the weighting or the search is unknown, or a number out of its range.
    """

    space: SearchSpace = field(default_factory=SearchSpace)
    objective: Objective = field(default_factory=Helmert)
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED
    n_threads: int = 1
    trust: Trust = field(default_factory=Trust)
    weighting: str | Weighting = Weighting.COSINE
    search: str | SearchMethod = SearchMethod.BRANCH_AND_BOUND
    thinning: float = 0.25
    refinement: bool = True
    wider: float = 12.0
    risk: float = 0.01

    def __post_init__(self) -> None:
        object.__setattr__(self, "multiplicity", Multiplicity.parse(self.multiplicity))
        object.__setattr__(self, "weighting", Weighting.parse(self.weighting))
        object.__setattr__(self, "search", SearchMethod.parse(self.search))
        if not 0.0 <= self.thinning < math.inf:
            raise OptionError(
                f"Expected `thinning` to be an edge >= 0 m, got {self.thinning}. With 0 all points are searched with."
            )
        if not 0.0 <= self.wider < math.inf:
            raise OptionError(
                f"Expected `wider` to be a half width >= 0 m, got {self.wider}. With 0 nothing wider is searched."
            )
        if not 0.0 < self.risk < 1.0:
            raise OptionError(f"Expected `risk` above 0 and below 1, got {self.risk}. The default is 0.01.")

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan in the map.

        Parameters
        ----------
        scan : Scan
            Points (and normals) of one epoch, sensor frame.
        point_map : PointMap
            The map; its voxel edge is the space's cell edge.
        prior : Pose
            T_map_sensor before localization, local frame of the map.

        Returns
        -------
        Estimate
            Its `status` says whether the pose may be used.

        Raises
        ------
        SearchSpaceError
            If the cell edge is not the map's, or the space is too large.
        """
        if self.search is SearchMethod.BRANCH_AND_BOUND and self._has_bounds:
            answer = self._by_bounds(scan.thinned(self.thinning), point_map, prior)
            if answer is not None:
                judged = self._judge(answer, scan, point_map, prior)
                return self._examine(judged, scan, point_map)
        return self.conclude(self.accumulate(scan, point_map, prior), scan, point_map)

    def accumulate(self, scan: Scan, point_map: PointMap, prior: Pose) -> Accumulator:
        """Moments of every cell: what `conclude` decides on, and what plots show."""
        return exhaustive(
            scan.thinned(self.thinning), point_map, prior, self.space,
            multiplicity=self.multiplicity, weighting=self.weighting, n_threads=self.n_threads,
        )  # fmt: skip

    def conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Take the best cell of an accumulator of this scan, refine and examine its pose: what `localize` answers."""
        space, prior, moments = accumulator.space, accumulator.prior, accumulator.moments
        scores = accumulator.score(self.objective)
        cell = highest(scores, space)
        if not moments[..., 0].any():
            _, cofactor = invert(accumulator.normal_matrix(cell))
            reason = "; ".join(reasons_to_doubt_scan(scan, prior))
            nothing = Estimate(prior, 0.0, cell, Status.NO_MATCH, cofactor, reason=reason)
            return self._examine(nothing, scan, point_map)
        helmert = scores if isinstance(self.objective, Helmert) else accumulator.score(Helmert())
        beyond = highest_beyond(helmert, cell, space, self.trust.guard_radius)
        runner_up = beyond / float(helmert[cell]) if helmert[cell] > 0.0 else math.inf
        answer = _Answer(space, cell, float(scores[cell]), moments[cell], runner_up)
        return self._examine(self._judge(answer, scan, point_map, prior), scan, point_map)

    def _examine(self, judged: Estimate, scan: Scan, point_map: PointMap) -> Estimate:
        """Refine the pose of the best cell, and search wider where the answer is in doubt (D12)."""
        is_open = judged.status is Status.UNDETERMINED and judged.share >= self.trust.least_share
        if (
            not self.refinement or is_open
        ):  # a street that leaves a direction open does so from farther around too
            return judged
        refined = self._refine(judged, scan, point_map)
        return refined if refined.is_localized else self._search_wider(refined, scan, point_map)

    def _search_wider(self, doubted: Estimate, scan: Scan, point_map: PointMap) -> Estimate:
        """Search all around an answer in doubt: the same place may win there too, or another one.

        What wins is refined and examined; the same place needs less evidence then.
        """
        cell = point_map.cell
        space = replace(self.space, half_width=math.floor(self.wider / cell + 1e-9) * cell)
        if space.half_width <= self.space.half_width:
            return doubted
        around = doubted.pose
        objective = self.objective if self._has_bounds else Helmert()
        wide = replace(self, space=space, objective=objective)
        answer = wide._by_bounds(scan.thinned(self.thinning), point_map, around)
        if answer is None:
            return doubted
        judged = wide._judge(answer, scan, point_map, around)
        moved = math.hypot(judged.pose.x - around.x, judged.pose.y - around.y)
        is_same = doubted.status is not Status.NO_MATCH and moved <= self.trust.guard_radius
        found = wide._refine(judged, scan, point_map, is_confirmed=is_same)
        score = float(self.objective.score(answer.moments))
        return replace(found, score=score, cell=doubted.cell if is_same else None, was_widened=True)

    def _refine(
        self, judged: Estimate, scan: Scan, point_map: PointMap, *, is_confirmed: bool = False
    ) -> Estimate:
        """Adjust the pose of a best cell to the map, and judge it once more; a doubted one stays as it is."""
        if not judged.is_localized:
            return judged
        refined = refine(scan, point_map, judged.pose)
        walls = least_wall_share(refined)
        status = self.trust.judge_refined(
            n_planes=refined.n_planes,
            moved=refined.moved,
            wall_share=None if walls is None else walls.share,
            is_confirmed=is_confirmed,
        )
        reasons = [judged.reason] if judged.reason else []
        if status is Status.WALLS_MISSING:
            reasons.append("the scan has hardly any wall points" if walls is None else walls.words)
        if status is Status.NOT_CONFIRMED:
            reasons.append(
                f"{refined.n_planes} points on planes of the map, {refined.moved:.2f} m from the best cell"
            )
        reason = "; ".join(reasons)
        if status is not Status.LOCALIZED:
            return replace(judged, status=status, reason=reason)
        errors = covariance(refined, point_map.sigma)
        level = protection_level(errors, refined.pose.heading, self.risk)
        return replace(
            judged, pose=refined.pose, status=status, reason=reason, covariance=errors, protection_level=level
        )

    @property
    def _has_bounds(self) -> bool:
        return isinstance(self.objective, BoundedByAxes | BoundedByCount)

    def _by_bounds(self, scan: Scan, point_map: PointMap, prior: Pose) -> "_Answer | None":
        """The best cell by branch and bound; None where nothing scores, and all cells have to be looked at."""

        def search(objective: Objective, guarded: Cell | None = None) -> Found:
            return branch_and_bound(
                scan, point_map, prior, self.space, objective, multiplicity=self.multiplicity,
                weighting=self.weighting, share=max(self.trust.largest_runner_up, LEAST_SHARE),
                guard_radius=self.trust.guard_radius, guarded=guarded, n_threads=self.n_threads,
            )  # fmt: skip

        found = search(self.objective)
        score = float(Helmert().score(found.moments))
        if score <= 0.0:
            return None
        helmert = found if isinstance(self.objective, Helmert) else search(Helmert(), found.cell)
        return _Answer(self.space, found.cell, found.score, found.moments, helmert.rest / score)

    def _judge(self, answer: "_Answer", scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Say how far the best cell may be trusted, and what casts doubt on it."""
        space, cell, searched = answer.space, answer.cell, scan.thinned(self.thinning)
        _, nxx, nxy, nyy = (float(moment) for moment in answer.moments)
        is_determined, cofactor = invert(np.array([[nxx, nxy], [nxy, nyy]]))
        share = _matched_share(answer, self.multiplicity, searched, point_map, prior)
        status = self.trust.judge(
            is_determined=is_determined,
            share=share,
            is_at_rim=space.is_at_rim(cell) or self._rises_beyond(answer, searched, point_map, prior),
            runner_up=answer.runner_up,
        )
        reasons = reasons_to_doubt_scan(scan, prior)
        if self.multiplicity is Multiplicity.OCCUPIED:  # otherwise N counts map points, not matches
            reasons += reasons_to_doubt_answer(answer.moments)
        pose = space.pose(cell, prior)
        return Estimate(
            pose, answer.score, cell, status, cofactor, share, answer.runner_up, "; ".join(reasons)
        )

    def _rises_beyond(self, answer: "_Answer", scan: Scan, point_map: PointMap, prior: Pose) -> bool:
        """Whether the best heading is the outermost, and one more step would score higher still."""
        space, cell = answer.space, answer.cell
        n_headings = space.shape[0]
        if n_headings == 1 or cell[0] not in (0, n_headings - 1):
            return False
        step = math.radians(space.heading_step_deg)
        beyond = space.headings[cell[0]] + (step if cell[0] > 0 else -step)
        turned = replace(prior, heading=prior.heading + float(beyond))
        one_heading = replace(space, heading_half_width_deg=0.0)
        further = exhaustive(
            scan, point_map, turned, one_heading, multiplicity=self.multiplicity, weighting=self.weighting
        )
        return bool(further.score(self.objective).max() > answer.score)


@dataclass(frozen=True, slots=True)
class _Answer:
    """What a search found: its best cell with score and moments, and Helmert's score of the runner-up over its own."""

    space: SearchSpace
    cell: Cell
    score: float
    moments: Moments
    runner_up: float


def _matched_share(
    answer: _Answer, multiplicity: str | Multiplicity, scan: Scan, point_map: PointMap, prior: Pose
) -> float:
    """Share of the scan's points that match at a cell; a count of map points has to be counted anew."""
    if multiplicity == Multiplicity.OCCUPIED:
        return float(answer.moments[0]) / len(scan)
    here = SearchSpace(half_width=0.0, cell=answer.space.cell, heading_half_width_deg=0.0)
    pose = answer.space.pose(answer.cell, prior)
    return float(exhaustive(scan, point_map, pose, here).moments[0, 0, 0, 0]) / len(scan)
