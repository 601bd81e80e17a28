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

from maxcon.accumulator import Accumulator, highest
from maxcon.best_cell import BestCell, judge
from maxcon.coarse_to_fine import COARSE, best_places
from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.examination import examine
from maxcon.geometry import Pose
from maxcon.ground import GroundFit, fit_ground
from maxcon.integrity import Trust, highest_beyond, invert, reasons_to_doubt_scan
from maxcon.objectives import BoundedByAxes, BoundedByCount, Helmert, Objective
from maxcon.point_map import PointMap
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
from maxcon.search_space import Cell, SearchSpace

__all__ = ["MaximumConsensus"]

# Where every other place is to be known, however low it scores.
LEAST_SHARE = 1e-6
# Where the ground lies so much higher or lower than the prior or the answer (m), it is searched from both heights.
OTHER_GROUND = 0.25
# An open space of fewer of the map's own cells is searched in these at once: that is as fast.
FEW_CELLS = 8_000
# A wider search turns twice as far, unless that is much.
LARGEST_DOUBLED_DEG = 10.0


@dataclass(frozen=True)
class MaximumConsensus:
    """Localizes scans by search for the cell of highest score (equations (1), (2) and (6)).

    Parameters
    ----------
    space : SearchSpace
        The candidate poses around each prior; 12 m and 10 degrees if not given. An open space, without a cell, is
        searched coarse to fine: in a level of the map first, then in the map's own cells around every place left open.
        One with a cell is searched in these cells alone, `SearchSpace.paper()` in the paper's.
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
        How the best cell is found; in given cells it is the same one. Branch and bound takes a fraction of the time. Of
        the runner-up it proves what `trust` asks for, not what it scores. An objective without bounds
        (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively. "exhaustive" looks at every cell; of an open
        space at all of the map's own.
    thinning : float
        One point of the scan is searched with in each cube of this edge, m; 0 for all, as published. Near surfaces
        have most of the points, and would outvote the far ones.
    refinement : bool
        Whether the pose of the best cell is adjusted to the surfaces of the map and examined there, and a covariance
        given. Without, the answer is the cell, as published.
    wider : float
        Where an answer is in doubt, all places within so much of it along x and y are searched too, coarse to fine, m;
        0 for never, as where the prior is certain to hold the true pose.
    risk : float
        The error may be larger than the protection level with at most this probability.
    is_levelled : bool
        Whether height, roll and pitch of the prior are first corrected by the ground, where the map has some and scan
        and map agree on it; the heights of `space` are searched where they do not. Otherwise these are always searched.

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
    is_levelled: bool = True

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
            The map; the space's cell edge, if given, is its voxel edge or 2, 4, ... 32 times that.
        prior : Pose
            T_map_sensor before localization, local frame of the map.

        Returns
        -------
        Estimate
            Its `status` says whether the pose may be used.

        Raises
        ------
        SearchSpaceError
            If the cell edge is not the map's or that of a level of it, or the space is too large.
        """
        found, start, space = max(
            ((self._search(scan, point_map, *each), *each) for each in self._starts(scan, point_map, prior)),
            key=lambda each: each[0].score,
        )
        is_outermost = abs(found.pose.z - start.z) > space.height_half_width - 0.5 * point_map.cell
        found, ground = self._on_ground(found, prior, scan, point_map)
        settled = self._settle(found, ground, start, scan, point_map)
        if space.height_half_width > 0.0 and is_outermost and settled.is_localized:
            return replace(settled, status=Status.AT_RIM)
        return settled

    def _starts(self, scan: Scan, point_map: PointMap, prior: Pose) -> list[tuple[Pose, SearchSpace]]:
        """The prior on the ground and the cells of that height; the prior and all heights where it cannot be told.

        Where the two are far apart both are searched from: what looks like the ground may be the roofs of cars.
        """
        ground = fit_ground(scan, point_map, prior) if self.is_levelled else None
        if ground is None:
            return [(prior, self.space)]
        starts = [(ground.pose, self.space.plane)]
        return starts if abs(ground.height) <= OTHER_GROUND else [*starts, (prior, self.space.plane)]

    def _on_ground(
        self, found: Estimate, around: Pose, scan: Scan, point_map: PointMap
    ) -> tuple[Estimate, GroundFit | None]:
        """An answer and its ground. Where that is far off, the answer from there if it scores higher, or no ground."""
        ground = self._ground_at(found, scan, point_map)
        if ground is None or abs(ground.height) <= OTHER_GROUND:
            return found, ground
        other = self._search(scan, point_map, around.levelled(ground.pose), self.space.plane)
        return (
            (other, self._ground_at(other, scan, point_map)) if other.score > found.score else (found, None)
        )

    def _ground_at(self, found: Estimate, scan: Scan, point_map: PointMap) -> GroundFit | None:
        """The ground of the place that was found, where that can be told."""
        if not self.is_levelled or found.status is Status.NO_MATCH:
            return None
        return fit_ground(scan, point_map, found.pose)

    def _search(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> Estimate:
        """Find the best cell of a space around a start, and judge it."""
        if self.is_coarse_to_fine(space, point_map):
            places = self.places(scan, point_map, start, space)
            if places:
                return replace(self._judge(places[0], scan, point_map), cell=None)
        level, cells = self._cells(space, point_map)
        if self.search is SearchMethod.BRANCH_AND_BOUND and self._has_bounds:
            best = self._by_bounds(scan.thinned(self.thinning), level, start, cells)
            if best is not None:
                return self._judge(best, scan, level)
        return self._conclude(self._accumulate(scan, level, start, cells), scan, level)

    def _cells(self, space: SearchSpace, point_map: PointMap) -> tuple[PointMap, SearchSpace]:
        """The level of the map, and the cells, that a space is searched in; coarse to fine those that come first."""
        if self.is_coarse_to_fine(space, point_map):
            level = point_map.level(COARSE.factor)
            return level, space.at(level.cell, COARSE.heading_step_deg)
        cells = space.at(point_map.cell)
        return level_of(point_map, cells), cells

    def is_coarse_to_fine(self, space: SearchSpace, point_map: PointMap) -> bool:
        """Whether a space is searched in a level of the map first: an open one of more than a few cells."""
        is_open = space.is_open and self.search is SearchMethod.BRANCH_AND_BOUND
        return is_open and space.at(point_map.cell).n_cells > FEW_CELLS

    def places(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> list[BestCell]:
        """Places of an open space where a scan may have been taken, the best first: see `best_places`."""

        def search(
            scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, *, share: float, lists_all: bool
        ) -> Found:
            return branch_and_bound(
                scan, point_map, prior, space, self.objective, multiplicity=self.multiplicity,
                weighting=self.weighting, share=share, lists_all=lists_all, guard_radius=self.trust.guard_radius,
                n_threads=self.n_threads,
            )  # fmt: skip

        share = max(self.trust.largest_runner_up, LEAST_SHARE)
        return best_places(search, scan.thinned(self.thinning), point_map, start, space, share)

    def _settle(
        self, found: Estimate, ground: GroundFit | None, start: Pose, scan: Scan, point_map: PointMap
    ) -> Estimate:
        """Lay an answer on its ground, adjust it to the map, and search wider where it is in doubt (D12)."""
        if not self.refinement:
            return found if ground is None else replace(found, pose=ground.pose)
        # A street that leaves a direction open does so from farther around too.
        is_open = found.status is Status.UNDETERMINED and found.share >= self.trust.least_share
        examined = examine(found, ground, scan, point_map, self.trust, self.risk)
        if examined.is_localized or is_open:
            return examined
        return self._search_wider(examined, start, scan, point_map)

    def _search_wider(self, doubted: Estimate, start: Pose, scan: Scan, point_map: PointMap) -> Estimate:
        """Search all around an answer in doubt, at twice the headings: the same place may win, or another one.

        What wins is examined in its turn; the same place needs less evidence then. Another place is the answer if it is
        localized; otherwise it is one more reason to doubt.
        """
        if self.wider == 0.0:
            return doubted
        turn_deg = self.space.heading_half_width_deg
        space = SearchSpace(
            half_width=max(self.wider, self.space.half_width),
            heading_half_width_deg=2.0 * turn_deg if turn_deg <= LARGEST_DOUBLED_DEG else turn_deg,
        )
        around = replace(doubted.pose, heading=start.heading)  # a wrong place has a wrong heading
        wide = self if self._has_bounds else replace(self, objective=Helmert())
        places = wide.places(scan, point_map, around, space)
        if not places:
            return doubted
        best = places[0]
        found = wide._judge(best, scan, point_map)
        found, ground = wide._on_ground(found, found.pose, scan, point_map)
        moved = math.hypot(found.pose.x - doubted.pose.x, found.pose.y - doubted.pose.y)
        is_same = doubted.status is not Status.NO_MATCH and moved <= self.trust.guard_radius
        examined = examine(found, ground, scan, point_map, self.trust, self.risk, is_confirmed=is_same)
        if not (is_same or examined.is_localized):
            reason = f"from farther around another place, {moved:.1f} m away, fits better"
            return replace(
                doubted, reason="; ".join(filter(None, [doubted.reason, reason])), was_widened=True
            )
        score = examined.score if self._has_bounds else float(self.objective.score(best.moments))
        return replace(examined, score=score, cell=doubted.cell if is_same else None, was_widened=True)

    @property
    def _has_bounds(self) -> bool:
        return isinstance(self.objective, BoundedByAxes | BoundedByCount)

    def accumulate(self, scan: Scan, point_map: PointMap, prior: Pose) -> Accumulator:
        """Moments of every cell, of several heights of the best: what `conclude` decides on, and what plots show.

        Coarse to fine is searched in large cells first: of such a space these are meant.
        """
        starts = self._starts(scan, point_map, prior)
        found = []
        for start, space in starts:
            level, cells = self._cells(space, point_map)
            found.append(self._accumulate(scan, level, start, cells))
        return max(found, key=lambda each: each.score(self.objective).max()) if len(found) > 1 else found[0]

    def _accumulate(self, scan: Scan, point_map: PointMap, start: Pose, space: SearchSpace) -> Accumulator:
        heights = accumulators(
            exhaustive, scan.thinned(self.thinning), point_map, start, space,
            multiplicity=self.multiplicity, weighting=self.weighting, n_threads=self.n_threads,
        )  # fmt: skip
        return next(heights) if space.n_heights == 1 else highest_of(heights, self.objective)[1]

    def conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Take the best cell of an accumulator of this scan, and settle its pose: what `localize` answers."""
        found = self._conclude(accumulator, scan, level_of(point_map, accumulator.space))
        found, ground = self._on_ground(found, accumulator.prior, scan, point_map)
        return self._settle(found, ground, accumulator.prior, scan, point_map)

    def _conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Say how far the best cell of an accumulator may be trusted."""
        space, prior, moments = accumulator.space, accumulator.prior, accumulator.moments
        scores = accumulator.score(self.objective)
        cell = highest(scores, space)
        if not moments[..., 0].any():
            _, cofactor = invert(accumulator.normal_matrix(cell))
            reason = "; ".join(reasons_to_doubt_scan(scan, prior))
            return Estimate(prior, 0.0, cell, Status.NO_MATCH, cofactor, reason=reason)
        helmert = scores if isinstance(self.objective, Helmert) else accumulator.score(Helmert())
        beyond = highest_beyond(helmert, cell, space, self.trust.guard_radius)
        runner_up = beyond / float(helmert[cell]) if helmert[cell] > 0.0 else math.inf
        best = BestCell(space, prior, cell, float(scores[cell]), moments[cell], runner_up)
        return self._judge(best, scan, point_map)

    def _by_bounds(self, scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace) -> BestCell | None:
        """The best cell by branch and bound; None where nothing scores, and all cells have to be looked at."""

        def search(
            prior: Pose, space: SearchSpace, objective: Objective, guarded: Cell | None = None
        ) -> Found:
            return branch_and_bound(
                scan, point_map, prior, space, objective, multiplicity=self.multiplicity,
                weighting=self.weighting, share=max(self.trust.largest_runner_up, LEAST_SHARE),
                guard_radius=self.trust.guard_radius, guarded=guarded, n_threads=self.n_threads,
            )  # fmt: skip

        found = search(prior, space, self.objective)
        raised, plane = space.raised(prior, found.height), space.plane
        score = float(Helmert().score(found.moments))
        if score <= 0.0:
            return None
        helmert = found
        if not isinstance(self.objective, Helmert):
            helmert = search(raised, plane, Helmert(), found.cell)
        return BestCell(plane, raised, found.cell, found.score, found.moments, helmert.rest / score)

    def _judge(self, best: BestCell, scan: Scan, point_map: PointMap) -> Estimate:
        """Say how far the best cell may be trusted, and what casts doubt on it."""
        return judge(
            best, scan, scan.thinned(self.thinning), point_map, self.trust,
            objective=self.objective, multiplicity=self.multiplicity, weighting=self.weighting,
        )  # fmt: skip
