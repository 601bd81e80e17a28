"""Maximum-consensus localization: the page to read first.

The paper's method in the order of the paper: every cell of a search space around the prior is a candidate
pose; each match of a scan point with the map adds to its cell; the cell whose matches determine the
position best is the answer. Then what the paper does not have: its pose is adjusted to the surfaces of the
map, validated, and where in doubt searched for once more, wider (D12). By default the cells are searched coarse
to fine, over a thinned scan (`maxcon.cell_search`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from maxcon.cell_search import CellSearch
from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust
from maxcon.map import PointMap
from maxcon.map.ground import HEADROOM
from maxcon.refine import validate
from maxcon.refine.adjustment import LAST_PASSES, PASSES
from maxcon.refine.ground import GroundFit, fit_ground, other_storeys
from maxcon.refine.tilt import with_own_tilt
from maxcon.refine.validation import fits_on_ground
from maxcon.scan import Scan
from maxcon.search import Multiplicity, SearchMethod, Weighting, level_of
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Helmert, Objective, as_objective
from maxcon.search.space import SearchSpace

# Where the ground lies so much higher or lower than the prior or the answer (m), it is searched from both heights.
OTHER_GROUND = 0.25
# A wider search turns twice as far, unless that is much.
LARGEST_DOUBLED_DEG = 10.0


@dataclass(frozen=True)
class MaximumConsensus:
    """Localizes scans by search for the cell of highest score (equations (1), (2) and (6)).

    Parameters
    ----------
    space : SearchSpace
        The candidate poses around each prior; 12 m and 10 degrees if not given. An open space, without a cell, is
        searched coarse to fine: in large cells of a level of the map first, whose candidates are then adjusted to the
        map. One with a cell is searched in these cells alone, `SearchSpace.paper()` in the paper's.
    objective : Objective or {"helmert", "count", "max-eigenvalue"}
        What a cell is worth; Helmert's point error if not given. Any object with ``score(moments)``.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    n_threads : int
        Headings searched at the same time; the answer does not depend on it.
    trust : Trust
        Thresholds that an answer has to meet to be called localized.
    weighting : {"cosine", "published", "one"}
        Weight of a match in N: max(0, n_scan . n_map), and 1/2 where the scan point has no normal; the same, but 0
        there, as published; or 1 (D5).
    search : {"branch-and-bound", "exhaustive"}
        How the best cell is found; in given cells it is the same one. Branch and bound takes a fraction of the time. Of
        the second best it proves what `trust` asks for, not what it scores. An objective without bounds
        (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively there. "exhaustive" scores every cell; of an open
        space all of the map's own.
    thinning : float
        Given cells are searched with one point of the scan in each cube of this edge, m; 0 for all, as published. Near
        surfaces have most of the points, and would outvote the far ones.
    refinement : bool
        Whether the pose of the best cell is adjusted to the surfaces of the map and validated there, and a covariance
        given. Without, the answer is the cell, as published; of an open space the candidate.
    wider : float
        An answer in doubt is searched for once more, coarse to fine, up to so far around it along x and y, m; 0 for
        never, where the search space is certain to hold the true pose.
    risk : float
        The error may be larger than the protection level with at most this probability.
    is_levelled : bool
        Whether height, roll and pitch of the prior are first corrected by the ground, where the map has some and scan
        and map agree on it; the heights of `space` are searched where they do not. Otherwise these are always searched.
        An answer in doubt is searched for once more from the tilt of the scan's own surfaces, if that is another one.
    widest : float
        An answer that stays in doubt is searched for again, each time twice as far around, until it is localized or
        this is reached, m; 0: within `wider` only. For spaces of a covariance that may be too small: turns then reach
        at least as far as by default.

    Raises
    ------
    OptionError
        If the objective, the multiplicity, the weighting or the search is unknown, or a number out of its range.
    """

    space: SearchSpace = field(default_factory=SearchSpace)
    objective: Objective | str = field(default_factory=Helmert)
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
    widest: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "objective", as_objective(self.objective))
        object.__setattr__(self, "multiplicity", Multiplicity.parse(self.multiplicity))
        object.__setattr__(self, "weighting", Weighting.parse(self.weighting))
        object.__setattr__(self, "search", SearchMethod.parse(self.search))
        if not 0.0 <= self.thinning < math.inf:
            raise OptionError(
                f"Expected `thinning` to be an edge >= 0 m, got {self.thinning}. With 0 all points are searched with."
            )
        for name in ("wider", "widest"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise OptionError(
                    f"Expected `{name}` to be a half width >= 0 m, got {value}. With 0 nothing wider is searched."
                )
        if not 0.0 < self.risk < 1.0:
            raise OptionError(f"Expected `risk` above 0 and below 1, got {self.risk}. The default is 0.01.")

    @property
    def cell_search(self) -> CellSearch:
        """How the best cell of a space is found and validated."""
        return CellSearch(
            as_objective(self.objective), self.multiplicity, self.weighting, self.search, self.thinning,
            self.n_threads, self.trust,
        )  # fmt: skip

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
        answer = self._localize_around(scan, point_map, prior)
        if answer.is_localized or not (self.is_levelled and self.refinement and point_map.has_ground):
            return answer
        tilted = with_own_tilt(scan, prior)
        other = None if tilted is None else self._localize_around(scan, point_map, tilted)
        return answer if other is None or not other.is_localized else other

    def _localize_around(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """The answer of the search around a prior whose roll and pitch are known to some degrees."""
        starts = self._starts(scan, point_map, prior)
        answers = [self.cell_search.best(scan, point_map, start, space) for start, space in starts]
        highest = max(range(len(starts)), key=lambda number: answers[number].score)
        found, (start, space) = answers[highest], starts[highest]
        found, ground = self._on_ground(found, prior, scan, point_map)
        storey = self._rival_storey(found, answers)
        if storey is not None:
            return storey
        settled = self._settle(found, ground, start, scan, point_map)
        outermost = space.height_half_width - 0.5 * point_map.cell
        is_searched = ground is None and space.height_half_width > 0.0  # otherwise the ground says the height
        if settled.is_localized and is_searched and abs(settled.pose.z - start.z) > outermost:
            return replace(settled, status=Status.AT_RIM)
        return settled

    def _starts(self, scan: Scan, point_map: PointMap, prior: Pose) -> list[tuple[Pose, SearchSpace]]:
        """The prior on the ground and the cells of that height; the prior and all heights where it cannot be told.

        Where the two are far apart both are searched from: what looks like the ground may be the roofs of cars. So are
        the next storeys above and below: heights of priors are off by more than a storey of a garage.
        """
        ground = fit_ground(scan, point_map, prior) if self.is_levelled else None
        if ground is None:
            return [(prior, self.space)]
        starts = [(ground.pose, self.space.plane)]
        if abs(ground.height) > OTHER_GROUND:
            starts.append((prior, self.space.plane))
        for height in other_storeys(point_map, ground.pose):
            there = fit_ground(scan, point_map, ground.pose.translated([0.0, 0.0, height]))
            if there is not None:
                starts.append((there.pose, self.space.plane))
        return starts

    def _rival_storey(self, found: Estimate, answers: Sequence[Estimate]) -> Estimate | None:
        """The answer as ambiguous, if one of another storey scores nearly as high."""
        rivals = [each for each in answers if abs(each.pose.z - found.pose.z) >= HEADROOM]
        rival = max(rivals, key=lambda each: each.score, default=None)
        if rival is None or rival.score <= self.trust.largest_runner_up * found.score:
            return None
        ratio, height = rival.score / found.score, rival.pose.z - found.pose.z
        side = "above" if height > 0.0 else "below"
        reason = f"the storey {abs(height):.1f} m {side} scores {ratio:.2f} of it"
        reasons = "; ".join(filter(None, [found.reason, reason]))
        return replace(found, status=Status.AMBIGUOUS, runner_up=max(found.runner_up, ratio), reason=reasons)

    def _on_ground(
        self, found: Estimate, around: Pose, scan: Scan, point_map: PointMap
    ) -> tuple[Estimate, GroundFit | None]:
        """An answer, its ground: a far one if the answer from there scores higher, or the scan fits on it as well."""
        ground = self._ground_at(found, scan, point_map)
        if ground is None or abs(ground.height) <= OTHER_GROUND:
            return found, ground
        other = self.cell_search.best(scan, point_map, around.with_height_and_tilt_of(ground.pose), self.space.plane)
        if other.score > found.score:
            found, ground = other, self._ground_at(other, scan, point_map)
        if ground is None or abs(ground.height) <= OTHER_GROUND or fits_on_ground(found.pose, ground, scan, point_map):
            return found, ground
        return found, None

    def _ground_at(self, found: Estimate, scan: Scan, point_map: PointMap) -> GroundFit | None:
        """The ground plane fit at an answer, where there is one."""
        if not self.is_levelled or found.status is Status.NO_MATCH:
            return None
        return fit_ground(scan, point_map, found.pose)

    def _settle(
        self, found: Estimate, ground: GroundFit | None, start: Pose, scan: Scan, point_map: PointMap
    ) -> Estimate:
        """Align an answer to its ground, adjust and validate it; search farther around where it is in doubt (D12)."""
        if not self.refinement:
            return found if ground is None else replace(found, pose=ground.pose)
        # A street that leaves a direction open does so from farther around too; a wall in a small window may not.
        is_wide = self.space.half_width >= self.wider
        is_street = is_wide and found.status is Status.UNDETERMINED and found.share >= self.trust.least_share
        passes = LAST_PASSES if self.cell_search.is_coarse_to_fine(self.space) else PASSES
        validated = validate(found, ground, scan, point_map, self.trust, self.risk, passes=passes)
        if validated.is_localized or is_street:
            return validated
        answer = self._search_wider(validated, start, scan, point_map)
        is_same = math.hypot(answer.pose.x - found.pose.x, answer.pose.y - found.pose.y) <= self.trust.guard_radius
        return validated if found.status is Status.MISFIT and is_same else answer  # mirrored, it stays so

    def _search_wider(self, doubted: Estimate, start: Pose, scan: Scan, point_map: PointMap) -> Estimate:
        """Search around an answer in doubt with larger half widths: the same pose may win, or another one."""
        answer, farthest = doubted, 0.0
        offset = max(abs(doubted.pose.x - start.x), abs(doubted.pose.y - start.y))
        for space in self._wider_spaces():
            if doubted.status is Status.AMBIGUOUS and space.half_width < offset + self.space.half_width:
                continue  # the other candidate, which is as good, may not be in it
            answer, farthest = self._search_around(doubted, space, start, scan, point_map), space.half_width
            if answer.is_localized:
                return answer
        if self.widest == 0.0 or farthest == 0.0:
            return answer
        reason = f"searched for up to {farthest:g} m around"
        return replace(answer, reason="; ".join(filter(None, [answer.reason, reason])), was_widened=True)

    def _wider_spaces(self) -> Iterator[SearchSpace]:
        """Fallback search spaces around an answer in doubt: twice the headings, then again and again twice as far."""
        if self.wider == 0.0:
            return
        half_width, turn_deg = max(self.wider, self.space.half_width), self.space.heading_half_width_deg
        least_deg = SearchSpace().heading_half_width_deg if self.widest > 0.0 else 0.0
        while True:
            turn_deg = max(2.0 * turn_deg if turn_deg <= LARGEST_DOUBLED_DEG else turn_deg, least_deg)
            yield SearchSpace(half_width, heading_half_width_deg=turn_deg)
            if half_width >= self.widest:
                return
            half_width = min(2.0 * half_width, self.widest)

    def _search_around(
        self, doubted: Estimate, space: SearchSpace, start: Pose, scan: Scan, point_map: PointMap
    ) -> Estimate:
        """Search around an answer in doubt, in a fallback space.

        Its best candidate is validated too. The same pose as before needs less evidence now. Another pose is the answer
        if it is localized; otherwise it is one more reason to doubt.
        """
        around = replace(doubted.pose, heading=start.heading)  # a wrong pose has a wrong heading
        candidates = self.cell_search.candidates(scan, point_map, around, space)
        if not candidates:
            return doubted
        found = self.cell_search.estimate(candidates[0], scan, point_map)
        found, ground = self._on_ground(found, found.pose, scan, point_map)
        moved = math.hypot(found.pose.x - doubted.pose.x, found.pose.y - doubted.pose.y)
        is_same = doubted.status is not Status.NO_MATCH and moved <= self.trust.guard_radius
        validated = validate(
            found, ground, scan, point_map, self.trust, self.risk, is_confirmed=is_same, passes=LAST_PASSES
        )
        if not (is_same or validated.is_localized):
            reason = f"searched farther around, another place fits better, {moved:.1f} m away"
            return replace(doubted, reason="; ".join(filter(None, [doubted.reason, reason])), was_widened=True)
        return replace(validated, cell=doubted.cell if is_same else None, was_widened=True)

    def accumulate(self, scan: Scan, point_map: PointMap, prior: Pose) -> Accumulator:
        """Moments of every cell; of several heights those of the best. What `conclude` decides on, and what plots show.

        Of a space that is searched coarse to fine these are the coarse cells, so that `conclude` is coarser than
        `localize`.
        """
        starts = self._starts(scan, point_map, prior)
        found = []
        for start, space in starts:
            level, cells = self.cell_search.level_and_cells(space, point_map)
            found.append(self.cell_search.accumulate(scan, level, start, cells))
        return max(found, key=lambda each: each.score(self.cell_search.objective).max()) if len(found) > 1 else found[0]

    def conclude(self, accumulator: Accumulator, scan: Scan, point_map: PointMap) -> Estimate:
        """Take the best cell of an accumulator of this scan, and settle its pose: `localize`, of given cells."""
        found = self.cell_search.conclude(accumulator, scan, level_of(point_map, accumulator.space))
        found, ground = self._on_ground(found, accumulator.prior, scan, point_map)
        return self._settle(found, ground, accumulator.prior, scan, point_map)
