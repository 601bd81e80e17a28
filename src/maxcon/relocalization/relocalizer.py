"""Relocalizer: where in a whole map a scan was taken. The page to read first.

1. In cells of about a metre, all cells of the map that match nearly as many points as the best one: an exact branch and
   bound over counts (`coarse_filter.filter_cells`).
2. Around each of these, counts in cells half as large (`coarse_filter.recount`).
3. The best of those are adjusted to the map, and scored by Helmert's score there. The best place is validated as in a
   search around a prior; all other places of the map are its rivals.
"""

import copy
import math
from dataclasses import dataclass, replace

import numpy as np

from maxcon.cell_search import BestCell, CellSearch
from maxcon.errors import MapError, OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, reasons_to_doubt_scan
from maxcon.map import PointMap
from maxcon.refine import fit_ground, fit_ground_plane, pose_above_ground, validate
from maxcon.refine.adjustment import FROM_LARGE_CELLS, LAST_PASSES
from maxcon.refine.candidates import Candidate, Scoring, adjusted_candidate, distinct
from maxcon.refine.tilt import are_tilted_alike, with_own_tilt
from maxcon.relocalization.coarse_filter import CoarseScan, CountedCells, Regions, filter_cells, recount
from maxcon.relocalization.coarse_map import Circle, CoarseMap
from maxcon.scan import Scan
from maxcon.search.accumulator import Multiplicity, SearchMethod, Weighting, check_threads
from maxcon.search.objectives import Helmert

CELL = 0.96  # m, edge of large cells
# Edges of the cubes of the thinned scan, in large cells and in half as large ones, m.
THINNING, HALF_THINNING = 2.0, 1.0
# Places that may reach this ratio to the best score are followed; less, where an answer is ambiguous from a lower ratio
# on. For FOLLOWED, large cells that reach COARSE_RATIO of the highest count are kept, and half as large ones that reach
# HALF_RATIO of theirs: true places reached these ratios.
FOLLOWED, LEAST_FOLLOWED = 0.8, 0.4
COARSE_RATIO, HALF_RATIO = 0.6, 0.75
# A place that matches the least share of a scan's points in the map's own cells matches 1.4 to 3 times that share in
# large ones. So much of it is asked for there: where a scan was not taken in the map, most is ruled out at once.
COARSE_SHARES = 1.25
# At most so many places are left by each of the two steps, those of the highest counts.
MOST_COARSE, MOST_HALF = 512, 64
# Cells that lie nearer to each other are one place: large ones and half as large ones, m and degrees.
SAME_COARSE, SAME_COARSE_DEG = 1.5, 4.5
SAME_HALF, SAME_HALF_DEG = 0.8, 2.5
SCORING = Scoring(Helmert(), Multiplicity.OCCUPIED, Weighting.COSINE)
LEAST_SHARE = 0.1  # of points that match: somewhere in a whole map a twentieth may match by chance
FEWEST_POINTS = 50  # with fewer above the ground nothing is searched


@dataclass(frozen=True, slots=True, eq=False)
class Relocalization:
    """Where a scan was taken, and what is known of all other places of the map.

    - estimate: the best place, judged; its `runner_up` is the best of all other places.
    - n_cells: large cells, at all headings, that were searched: those in which a scanner may stand.
    - n_coarse, n_half: places left by large cells, and by half as large ones.
    - n_others: places that could not be excluded, beside the best one: their scores exceed
      `Trust.largest_runner_up` times the best score.
    - places: those that were adjusted to the map and score enough to be followed, the highest score first; local frame.
    """

    estimate: Estimate
    n_cells: int = 0
    n_coarse: int = 0
    n_half: int = 0
    n_others: int = 0
    places: tuple[Pose, ...] = ()


class Relocalizer:
    """Finds where in a map scans were taken, at any place and heading.

    Make one and ask it often: it keeps the map in large voxels, made tile by tile when first needed, of at most three
    quarters of a gigabyte. No prior is needed; the scan's z axis is up within 30 degrees.

    Parameters
    ----------
    point_map : PointMap
        With ground, above which a scanner stands.
    around : tuple of 2 float, optional
        Middle (x, y), local frame, m, of a circle in which the scanner stands; anywhere if not given.
    radius : float
        Of that circle, m.
    n_threads : int
        Headings and places searched at the same time; the answer does not depend on it.
    trust : Trust, optional
        Thresholds for an answer to be called localized; the usual ones, but a `least_share` of 0.1, if not given.
    risk : float
        The error may be larger than the protection level with at most this probability.

    Raises
    ------
    MapError
        If the map has no ground, or voxels of more than half a metre; from `check`, `localize` and `search`, if
        there is none where the scanner may stand.
    OptionError
        If a number is out of its range.
    """

    def __init__(
        self, point_map: PointMap, around: tuple[float, float] | None = None, radius: float = 300.0, *,
        n_threads: int = 1, trust: Trust | None = None, risk: float = 0.01,
    ) -> None:  # fmt: skip
        check_threads(n_threads)
        if not 0.0 < risk < 1.0:
            raise OptionError(f"Expected `risk` above 0 and below 1, got {risk}. The default is 0.01.")
        self.map = point_map
        self.area = None if around is None else _circle(around, radius)
        self.n_threads = n_threads
        self.trust = trust or Trust(least_share=LEAST_SHARE)
        self.risk = risk
        self.coarse = Regions(CoarseMap(point_map, CELL), self.area)
        half = 0.5 * self.coarse.map.cell
        if point_map.cell > 1.01 * half:
            raise MapError(
                f"Expected voxels of up to half a metre, to search a map without a prior, got {point_map.cell:g} m."
                " Build it anew with a smaller cell; 0.06 m is the default."
            )
        self._half = CoarseMap(point_map, half)

    @property
    def n_cells(self) -> int:
        """Large cells, of all headings, in which a scanner may stand."""
        return self.coarse.n_cells

    def check(self) -> None:
        """Raise a MapError if the map has no ground where the scanner may stand."""
        if self.n_cells == 0:
            where = "" if self.area is None else f" within {self.area.radius:g} m of the place that was named"
            raise MapError(f"Expected ground of the map{where}, got none. Is that place in the map, in its CRS?")

    def within(self, around: tuple[float, float], radius: float) -> "Relocalizer":
        """Return a relocalizer for a circle (`around`, `radius`) that shares what this one keeps of the map."""
        other = copy.copy(self)
        other.area = _circle(around, radius)
        other.coarse = Regions(self.coarse.map, other.area)
        return other

    def localize(self, scan: Scan) -> Estimate:
        """Find the pose of a scan (sensor frame), local frame of the map: the estimate of `search`."""
        return self.search(scan).estimate

    def search(self, scan: Scan) -> Relocalization:
        """Find the pose of a scan (sensor frame, z within 30 degrees of up), and what is known of all other places.

        Poses are in the local frame of the map. Without a place, that of the estimate is the origin.
        """
        self.check()
        level = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        found, tilted = self._search(scan, level), with_own_tilt(scan, level)
        if tilted is None:
            return found
        other = self._search(scan, tilted)
        if found.estimate.is_localized and are_tilted_alike(found.estimate.pose, tilted):
            return other  # of places with this tilt the level search knows few
        return max(found, other, key=lambda each: (each.estimate.is_localized, each.estimate.score))

    def _search(self, scan: Scan, upright: Pose) -> Relocalization:
        """Search with the roll and pitch of a pose, from which the scanner's are some degrees away."""
        T_ground_sensor = fit_ground_plane(scan, upright.roll, upright.pitch)
        if T_ground_sensor is None:
            return _nothing(scan, "the scan shows no ground around it")
        few, many = (CoarseScan.of(scan.thinned(edge), T_ground_sensor) for edge in (THINNING, HALF_THINNING))
        if len(few) < FEWEST_POINTS:
            return _nothing(scan, "few of the points are above the ground")
        candidates, n_coarse = self._candidates(few, many)
        if not len(candidates):
            return _nothing(scan, f"no place of the map matches as many points in cells of {CELL} m as right ones do")
        found = self._adjusted(scan, T_ground_sensor, candidates)
        return self._concluded(scan, found, candidates, n_coarse)

    def _candidates(self, few: CoarseScan, many: CoarseScan) -> tuple[CountedCells, int]:
        """Places left by cells of half a metre, the highest count first; and how many large cells left."""
        ratio = COARSE_RATIO * self._followed / FOLLOWED
        fewest = max(1.0, COARSE_SHARES * min(self.trust.least_share, LEAST_SHARE) * len(few))
        coarse = filter_cells(few, self.coarse, ratio, fewest, n_threads=self.n_threads)
        if not len(coarse):
            return coarse, 0
        coarse = coarse.distinct(SAME_COARSE, math.radians(SAME_COARSE_DEG), MOST_COARSE)
        half = recount(many, coarse, self._half).reaching(HALF_RATIO * self._followed / FOLLOWED)
        return half.distinct(SAME_HALF, math.radians(SAME_HALF_DEG), MOST_HALF), len(coarse)

    def _adjusted(self, scan: Scan, T_ground_sensor: Pose, candidates: CountedCells) -> list[Candidate]:
        """Candidates adjusted to the map and scored there, the highest first, down to the ratio that is followed."""
        found = []
        for x, y, heading in candidates.poses.tolist():
            start = pose_above_ground(self.map, x, y, heading, T_ground_sensor)
            ground = fit_ground(scan, self.map, start)
            start = start if ground is None else ground.pose
            found.append(adjusted_candidate(scan.sample, self.map, start, FROM_LARGE_CELLS, SCORING))
        found = distinct(found)
        return [each for each in found if each.score > 0.0 and each.score >= self._followed * found[0].score]

    def _concluded(self, scan: Scan, found: list[Candidate], candidates: CountedCells, n_coarse: int) -> Relocalization:
        """Judge the best place, with all others for rivals."""
        if not found:
            return _nothing(scan, "no place of the map determines x and y")
        largest = self.trust.largest_runner_up
        # Places that were not adjusted are judged by their counts.
        has_more = len(candidates) == MOST_HALF or candidates.left_out > largest
        left_out = max(candidates.left_out, self._followed) if has_more else self._followed
        rivals = [found[0], *(each for each in found[1:] if each.score > largest * found[0].score)]
        others = found[len(rivals) :]
        runner_up = max(left_out, rivals[1].score / rivals[0].score if len(rivals) > 1 else 0.0)
        # Adjusting to the end decides which of the rivals is best; that there are rivals stays true.
        if len(rivals) > 1:
            rivals = [adjusted_candidate(scan.sample, self.map, each.pose, LAST_PASSES, SCORING) for each in rivals]
            rivals.sort(key=lambda each: -each.score)
        best, area = rivals[0], self.area
        # In the outermost large cell of the circle.
        is_at_boundary = area is not None and (
            math.hypot(best.pose.x - area.x, best.pose.y - area.y) > area.radius - self.coarse.map.cell
        )
        search = CellSearch(
            SCORING.objective, SCORING.multiplicity, SCORING.weighting, SearchMethod.BRANCH_AND_BOUND, 0.0,
            self.n_threads, self.trust,
        )  # fmt: skip
        found_cell = BestCell.at(best, self.map, runner_up, is_at_boundary=is_at_boundary)
        judged = replace(search.estimate(found_cell, scan, self.map), cell=None)
        ground = fit_ground(scan, self.map, judged.pose)
        estimate = validate(judged, ground, scan, self.map, self.trust, self.risk, passes=LAST_PASSES)
        n_others = len(rivals) - 1
        if estimate.status is Status.AMBIGUOUS:
            words = _words(n_others, has_more=has_more)
            estimate = replace(estimate, reason="; ".join(filter(None, [words, estimate.reason])))
        poses = tuple(each.pose for each in (*rivals, *others))
        return Relocalization(estimate, self.n_cells, n_coarse, len(candidates), n_others, poses)

    @property
    def _followed(self) -> float:
        """Ratio to the best score that other places are followed down to."""
        return min(max(self.trust.largest_runner_up, LEAST_FOLLOWED), FOLLOWED)


def _circle(around: tuple[float, float], radius: float) -> Circle:
    if not 0.0 < radius < math.inf:
        raise OptionError(f"Expected a `radius` above 0 m, got {radius}. The default is 300.")
    return Circle(*around, radius)


def _words(n_others: int, *, has_more: bool) -> str:
    """Reason of an ambiguous answer: how many places were not excluded, and whether more were not searched."""
    searched = f"{n_others} other place{'' if n_others == 1 else 's'} of the map could not be excluded"
    more = f"beyond {MOST_HALF} places others match nearly as many points"
    return "; ".join(([searched] if n_others or not has_more else []) + ([more] if has_more else []))


def _nothing(scan: Scan, reason: str) -> Relocalization:
    """The answer where no place was found, and why."""
    origin = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    words = "; ".join([reason, *reasons_to_doubt_scan(scan, origin)])
    open_both_ways = np.diag([np.inf, np.inf])
    return Relocalization(Estimate(origin, 0.0, None, Status.NO_MATCH, open_both_ways, reason=words))
