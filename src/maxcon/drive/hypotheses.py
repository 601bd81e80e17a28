"""Where the sensor may be, what speaks for each place, and where a scan is searched by a covariance (D2)."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.motion import PLANAR, Motion, MotionNoise, UncertainPose
from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory
from maxcon.search.objectives import Helmert
from maxcon.search.space import PAPER_CELL, PAPER_STEP_DEG, SearchSpace

# Scans taken within this way see much the same surfaces: together they are held to say as much as one, m.
WAY_OF_EVIDENCE = 2.0
LEAST_RATIO = 0.1  # a scan that matches nowhere leaves a place this ratio: what hides the map may be gone in the next
LEAST_EVIDENCE = 0.05  # a hypothesis worth less than this ratio to the best one is given up
MOST_HYPOTHESES = 8
MOST_AGREEMENT = 4.0  # where scans agreed for long, three in a row that do not are bridged, the fourth is not
# The usual share of matches is a mean in which earlier scans weigh USUAL_LASTS. A scan that matches with less than
# LEAST_OF_USUAL of it is not of this place.
USUAL_LASTS, LEAST_OF_USUAL = 0.8, 0.2
STANDSTILL = Motion.none()

# Of an estimate without a covariance: a cell's and a heading step's own, and what the map and the scan add, m and rad.
MAP_SIGMA, MAP_HEADING_SIGMA = 0.02, math.radians(0.1)
# What a prior's height, roll and pitch are held to be worth, m and rad: the search takes them as they come.
HEIGHT_SIGMA, TILT_SIGMA = 0.1, math.radians(0.3)
HEIGHTS_AND_TILTS = np.diag([np.inf, np.inf, HEIGHT_SIGMA**2, TILT_SIGMA**2, TILT_SIGMA**2, np.inf])
"""Covariance of a prior as a measurement of height, roll and pitch alone, shape (6, 6)."""
# How well a candidate is known, which is where a peak of the scores is, m and rad.
PEAK_SIGMA, PEAK_HEADING_SIGMA = 0.1, math.radians(0.5)
# A window of a larger half width (m) is not searched: only a prior helps then. Turns are not searched beyond.
FARTHEST_REACH, LARGEST_TURN_DEG = 12.0, 10.0
# A smaller space, m and degrees, saves no time, shows no place beyond the guard radius, and leaves out what no
# covariance of a prior holds: the map's own shift, a lever arm, a clock that is 20 ms off at 50 km/h.
SMALLEST_HALF_WIDTH, SMALLEST_TURN_DEG = 1.0, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One place where the sensor may be."""

    anchor: UncertainPose  # where it was when a scan last agreed with it, or where a search found it
    # Its scores over those of the best hypothesis, multiplied over the way: at first the second best ratio of a single
    # epoch, and smaller with every metre on which it fits worse. The best one has 1.
    evidence: float = 1.0
    motion: Motion = STANDSTILL  # since the anchor, as one: errors of odometry add up over it, they do not cancel
    # Ratios of their points that scans matched here, added up over scans that agreed, up to `MOST_AGREEMENT`, and
    # halved with each scan that did not: so many whole scans lie on the map
    agreement: float = 0.0
    n_refused: int = 0  # scans in a row that did not, up to now
    estimate: Estimate | None = None  # what the search around it answered last
    # Way over which scans have yet to agree, m: where motion does not lead from where the track was localized
    unproven: float = 0.0
    usual_share: float = 0.0  # of their points that scans matched here, averaged over the last ones that agreed

    def moved(self, motion: Motion) -> "Hypothesis":
        """Return it after a motion."""
        return replace(self, motion=self.motion.then(motion))

    def predicted(self, noise: MotionNoise) -> UncertainPose:
        """Return where the sensor is, if this is the place."""
        return self.anchor.moved(self.motion, noise)

    @property
    def score(self) -> float:
        """Worth of the best cell around it in the last scan."""
        return 0.0 if self.estimate is None else self.estimate.score

    def agreed(self, anchor: UncertainPose, estimate: Estimate) -> "Hypothesis":
        """Return it after a scan that agreed."""
        agreement = min(self.agreement + estimate.share, MOST_AGREEMENT)
        usual = USUAL_LASTS * (self.usual_share or estimate.share) + (1.0 - USUAL_LASTS) * estimate.share
        return replace(
            self, anchor=anchor, motion=STANDSTILL, agreement=agreement, n_refused=0, estimate=estimate,
            usual_share=usual, unproven=max(0.0, self.unproven - self.motion.distance),
        )  # fmt: skip

    @property
    def is_contradicted(self) -> bool:
        """Whether the last scan speaks against this place: it misses more than what hides a part of the map."""
        if self.estimate is None:
            return False
        is_against = self.estimate.status in (Status.MISFIT, Status.AT_RIM, Status.AMBIGUOUS)
        return is_against or self.estimate.share < LEAST_OF_USUAL * self.usual_share

    def refused(self, estimate: Estimate) -> "Hypothesis":
        """Return it after a scan that did not agree."""
        return replace(self, agreement=self.agreement / 2.0, n_refused=self.n_refused + 1, estimate=estimate)


def weighed(hypotheses: Iterable[Hypothesis], way: float) -> list[Hypothesis]:
    """Return the hypotheses with the evidence of a scan that all were compared with, taken after so many metres."""
    compared = list(hypotheses)
    best = max((hypothesis.score for hypothesis in compared), default=0.0)
    if best <= 0.0:
        return compared
    power = min(1.0, way / WAY_OF_EVIDENCE)
    return [replace(each, evidence=each.evidence * max(each.score / best, LEAST_RATIO) ** power) for each in compared]


def ranked(hypotheses: Iterable[Hypothesis], noise: MotionNoise, radius: float) -> list[Hypothesis]:
    """Return the best hypotheses, the best first, each farther than a radius (m) from better ones."""
    kept: list[Hypothesis] = []
    for each in sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence):
        place = each.predicted(noise)
        if all(distance(place, other.predicted(noise)) > radius for other in kept):
            kept.append(each)
    if not kept or kept[0].evidence <= 0.0:
        return kept[:MOST_HYPOTHESES]
    best = kept[0].evidence
    scaled = [replace(each, evidence=each.evidence / best) for each in kept[:MOST_HYPOTHESES]]
    return [each for each in scaled if each.evidence >= LEAST_EVIDENCE]


def distance(one: UncertainPose, other: UncertainPose) -> float:
    """Between two positions, in x and y, m."""
    return math.hypot(one.pose.x - other.pose.x, one.pose.y - other.pose.y)


def window(predicted: UncertainPose, sigmas: float, space: SearchSpace) -> SearchSpace:
    """Return the window of so many sigmas of the innovation around a prediction, at most twice `FARTHEST_REACH`."""
    return SearchSpace.from_covariance(
        predicted.planar_covariance + np.diag(_cell_variances(space)[PLANAR]), k=sigmas, cell=space.cell,
        heading_step_deg=space.heading_step_deg, largest_half_width=2.0 * FARTHEST_REACH,
        largest_heading_half_width_deg=max(LARGEST_TURN_DEG, space.heading_half_width_deg),
    )  # fmt: skip


def measured_covariance(estimate: Estimate, space: SearchSpace) -> NDArray[np.float64]:
    """Covariance of an estimate as a measurement, (6, 6): its own, else that of a cell (edge / sqrt(12))."""
    is_known = np.isfinite(np.diag(estimate.covariance)[PLANAR]).all()
    return estimate.covariance if is_known else np.diag(_cell_variances(space))


def _cell_variances(space: SearchSpace) -> NDArray[np.float64]:
    edge = PAPER_CELL if space.cell is None else space.cell
    step_deg = PAPER_STEP_DEG if space.heading_step_deg is None else space.heading_step_deg
    offset = edge**2 / 12.0 + MAP_SIGMA**2
    turn = math.radians(step_deg) ** 2 / 12.0 + MAP_HEADING_SIGMA**2
    return np.array([offset, offset, np.inf, np.inf, np.inf, turn])


def find_hypotheses(
    method: MaximumConsensus, space: SearchSpace, scan: Scan, point_map: PointMap, prior: Pose, ratio: float
) -> list[Hypothesis]:
    """Return the places in a space around a prior that score at least a ratio of the best one, the best first.

    They lie farther apart than the guard radius, and that ratio is their evidence. Where branch and bound does not
    prove that there are no others, every cell is scored; of a wide space the places that it left open.
    """
    asked = replace(method, space=space, trust=replace(method.trust, largest_runner_up=ratio), refinement=False)
    best = asked.localize(scan, point_map, prior)
    if best.status is Status.NO_MATCH:
        return []
    if best.runner_up <= ratio:
        return [_at_peak(best.pose, 1.0)]
    if asked.cell_search.is_coarse_to_fine(space):
        found = asked.cell_search.candidates(scan, point_map, prior.with_height_and_tilt_of(best.pose), space)
        worth = [float(Helmert().score(each.moments)) for each in found[:MOST_HYPOTHESES]]
        ratios = [score / max(worth) for score in worth] if max(worth, default=0.0) > 0.0 else []
        return [_at_peak(each.pose, own) for each, own in zip(found, ratios, strict=False) if own >= ratio]
    accumulator = asked.accumulate(scan, point_map, prior)
    scores = np.array(accumulator.score(Helmert()), dtype=np.float64)
    rows, columns = np.meshgrid(*map(np.arange, accumulator.space.shape[1:]), indexing="ij")
    candidates: list[Hypothesis] = []
    highest = float(scores.max())
    while len(candidates) < MOST_HYPOTHESES and highest > 0.0:
        heading, iy, ix = (int(index) for index in np.unravel_index(int(np.argmax(scores)), scores.shape))
        own = float(scores[heading, iy, ix]) / highest
        if own < ratio:
            break
        candidates.append(_at_peak(accumulator.space.pose((heading, iy, ix), accumulator.prior), own))
        is_near = np.hypot(rows - iy, columns - ix) * accumulator.space.cell_edge <= method.trust.guard_radius
        scores[:, is_near] = -1.0
    return candidates


def _at_peak(pose: Pose, ratio: float) -> Hypothesis:
    """A pose with what is known of it before a scan is compared with the map there closely."""
    sigmas = [PEAK_SIGMA, PEAK_SIGMA, HEIGHT_SIGMA, TILT_SIGMA, TILT_SIGMA, PEAK_HEADING_SIGMA]
    return Hypothesis(UncertainPose(pose, np.diag(np.square(sigmas))), evidence=ratio)


@dataclass(frozen=True)
class WithinSigmas:
    """A method that searches so many standard deviations of each prior, and wider where its answer is in doubt."""

    # What searches. Cells, steps and heights of its space are taken over; all of it is searched where it is not known
    # how well a prior is known.
    method: MaximumConsensus
    prior: Trajectory  # whose covariance, at the time of a scan, makes the space around its prior
    sigmas: float = 3.0  # half widths in standard deviations; 1 m and 1 degree at least
    largest_half_width: float = 24.0  # no space is larger, m, and no answer in doubt is searched for farther around
    max_gap: float = 0.5  # largest time between two poses of the prior to interpolate across, s

    def __post_init__(self) -> None:
        if not 0.0 < self.largest_half_width < math.inf:
            raise OptionError(f"Expected a largest half width above 0 m, got {self.largest_half_width}. Default: 24 m.")

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan around its prior, local frame; TrajectoryError if the trajectory has no pose then."""
        covariance = self.prior.covariance_at(scan.time, self.max_gap)
        estimate = self.at(scan.time).localize(scan, point_map, prior)
        if covariance is None:
            return estimate
        reasons = self._reasons(estimate, prior, covariance)
        return replace(estimate, reason="; ".join(filter(None, [*reasons, estimate.reason])))

    def at(self, time: float) -> MaximumConsensus:
        """Return what searches at a time, s."""
        covariance = self.prior.covariance_at(time, self.max_gap)
        if covariance is None:
            return self.method
        return replace(self.method, space=self.space(covariance), widest=self.largest_half_width)

    def space(self, covariance: NDArray[np.float64]) -> SearchSpace:
        """Return the space of a covariance of x, y and heading, shape (3, 3)."""
        usual = self.method.space
        space = SearchSpace.from_covariance(
            covariance, k=self.sigmas, cell=usual.cell, heading_step_deg=usual.heading_step_deg,
            smallest_half_width=SMALLEST_HALF_WIDTH, smallest_heading_half_width_deg=SMALLEST_TURN_DEG,
            largest_half_width=self.largest_half_width,
        )  # fmt: skip
        return replace(space, height_half_width=usual.height_half_width)

    def reach(self, covariance: NDArray[np.float64]) -> float:
        """Return so many standard deviations of x or y, the larger of the two, m: it may be more than is searched."""
        return self.sigmas * math.sqrt(max(covariance[0, 0], covariance[1, 1]))

    def _reasons(self, estimate: Estimate, prior: Pose, covariance: NDArray[np.float64]) -> list[str]:
        """Why an answer is to be doubted because of the covariance, or the covariance because of the answer."""
        space, reach, reasons = self.space(covariance), self.reach(covariance), []
        if reach > self.largest_half_width:
            reasons.append(
                f"{self.sigmas:g} sigma of the prior are {reach:.0f} m, searched were {space.half_width:g} m"
            )
        offset = max(abs(estimate.pose.x - prior.x), abs(estimate.pose.y - prior.y))
        turn_deg = math.degrees(abs(wrap_angle(estimate.pose.heading - prior.heading)))
        is_beyond = offset > space.half_width or turn_deg > space.heading_half_width_deg
        if estimate.is_localized and estimate.was_widened and is_beyond:
            reasons.append(
                f"{offset:.1f} m and {turn_deg:.1f} degrees from the prior, searched first were"
                f" {space.half_width:.1f} m and {space.heading_half_width_deg:.1f} degrees: are its sigmas too small?"
            )
        return reasons
