"""Tracker: localizes scan after scan, each only where the one before and the motion since allow it to be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from maxcon.drive.hypotheses import (
    FARTHEST_REACH,
    HEIGHTS_AND_TILTS,
    Hypothesis,
    distance,
    find_hypotheses,
    measured_covariance,
    ranked,
    weighed,
    window,
)
from maxcon.drive.motion import Motion, MotionNoise, UncertainPose, check_numbers
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import protection_level
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.refine import map_covariance
from maxcon.scan import Scan
from maxcon.search.space import SearchSpace

# Where a wide search looks for other places at first, those that reach this ratio of the best one are kept.
RATIO_AT_FIRST = 0.5
# Once the track was told apart from all other places, one that fits about as well has all against it that was seen
# before: only a slip of the odometry could have brought the sensor there. One that fits clearly better has not.
NEWCOMER = 0.1
# The best of several places is believed once all others are worth less than this; from then on up to the method's own
# largest second best ratio.
TOLD_APART = 0.5
# Motion does not lead to a place farther than APART from the prediction, m, and out of its window: scans have to agree
# with it over PROVEN of the way, m, unless a prior is near.
PROVEN, APART = 25.0, 3.0
WIDER = 3.0  # a scan that fits best at the rim of its window is compared again in one that is so many times as wide
WALKING_PACE = 1.0  # m/s; while a vehicle stands, other places are looked for as often as at this speed
UNKNOWN = np.diag([np.inf, np.inf])


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """What the tracker asks for before it calls a pose localized; OptionError if a number is not above 0.

    - sigmas: A scan is searched within so many standard deviations of the prediction.
    - largest_sigma: of a position, in the direction that is known worst, m: a pose known less well is not called
      localized.
    - least_agreement: before a place is called localized, the matched ratios of the scans that agreed with it have to
      add up to this: half a scan, which takes two scans that match by 25 %, or five that match by 10 %.
    - check_distance: every so many metres the whole search space is searched for a place that fits better.
    - patience: A track that stays outside of the prior's search space for so many metres is lost. A single motion as
      long is a gap, after which scans have to agree anew.
    """

    sigmas: float = 3.0
    largest_sigma: float = 0.1
    least_agreement: float = 0.5
    check_distance: float = 3.0
    patience: float = 20.0

    def __post_init__(self) -> None:
        check_numbers(self, may_be_zero=False)


@dataclass
class Tracker:
    """Localizes scan after scan: call `move` with the motion since the last one, then `localize`.

    Hypotheses, one or several, are moved; each scan is compared with the map in the window that the covariance of
    each prediction leaves, and adjusts it. Of several, the scores over the way decide. A wide search begins the track,
    begins it anew where a prediction is too uncertain, and looks every few metres whether another place fits better.

    - method: how scans are compared with the map. Its space is the wide one, around the prior.
    - noise: of the motions that it is told.
    - options: what it asks for before it calls a pose localized.
    - start: where the sensor is when `localize` is first called, local frame; it is checked there. Without it the prior
      says where to begin.
    - puts_off: whether the look for other places waits for `work_off`, so that the answer comes sooner. The first look
      does not wait, nor does one that has waited for as many metres again.

    The filter is an extended Kalman filter of x, y, z, roll, pitch and heading. Height, roll and pitch follow the
    motion, the prior's own and, where an estimate measures them, the estimate.
    """

    method: MaximumConsensus
    noise: MotionNoise = field(default_factory=MotionNoise)
    options: TrackingOptions = field(default_factory=TrackingOptions)
    start: UncertainPose | None = None
    puts_off: bool = False

    def __post_init__(self) -> None:
        self._hypotheses = [] if self.start is None else [Hypothesis(self.start)]
        self._way = math.inf  # since a scan was last compared with all hypotheses, m
        self._unchecked = math.inf  # since the whole search space was last looked at, m
        self._was_localized = False
        self._has_begun = False  # whether the track was ever localized: then motion says where it can be
        self._outside = 0.0  # since the track was last seen in the prior's search space, m
        self.put_off: Callable[[], None] | None = None
        self.searched = 0.0
        """Largest half width that the last scan was searched in, m."""

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Places where the sensor may be, the best first; none before the track begins."""
        return tuple(self._hypotheses)

    @property
    def prediction(self) -> UncertainPose | None:
        """Where the best hypothesis expects the sensor; None without one."""
        return self._hypotheses[0].predicted(self.noise) if self._hypotheses else None

    def move(self, motion: Motion) -> None:
        """Take account of a motion since the last scan; several in a row are one."""
        self.put_off, self.searched = None, 0.0
        is_gap = motion.distance > self.options.patience
        self._hypotheses = [
            replace(each.moved(motion), agreement=0.0 if is_gap else each.agreement) for each in self._hypotheses
        ]
        self._way += motion.distance
        self._unchecked += max(motion.distance, WALKING_PACE * motion.seconds)
        self._outside += motion.distance

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose | None) -> Estimate | None:
        """Find the pose of a scan (sensor frame); the filter's, with its covariance. None without a track and a prior.

        `prior` is T_map_sensor from another source such as GNSS, local frame, if there is one: it begins a track, and
        tells a wrong one. `runner_up` is the evidence of the second hypothesis over that of the first.
        """
        hypotheses, is_new = self._widely(scan, point_map, prior)
        compared = [self._followed(each, scan, point_map, prior) for each in hypotheses]
        weighted = weighed(compared, math.inf if is_new else self._way)
        self._hypotheses = ranked(weighted, self.noise, self._guard_radius)
        self._way = 0.0
        if prior is not None:
            self._hypotheses = [  # near a prior nothing is left to prove
                replace(each, unproven=0.0) if self._is_inside(each.predicted(self.noise).pose, prior) else each
                for each in self._hypotheses
            ]
        if prior is None or (self.prediction is not None and self._is_inside(self.prediction.pose, prior)):
            self._outside = 0.0
        if self._hypotheses and self._unchecked >= self.options.check_distance:
            self.put_off = partial(self._check, scan, point_map, prior)
            if not self.puts_off or self._unchecked >= 2.0 * self.options.check_distance:
                self.work_off()
        return self._conclude(point_map, prior)

    def work_off(self) -> None:
        """Look for other places, if that was put off; before the next move."""
        check, self.put_off = self.put_off, None
        if check is not None:
            check()

    @property
    def _guard_radius(self) -> float:
        return self.method.trust.guard_radius

    def _widely(self, scan: Scan, point_map: PointMap, prior: Pose | None) -> tuple[list[Hypothesis], bool]:
        """Hypotheses to compare a scan with, and whether a wide search found any of them."""
        if not self._hypotheses:
            return self._begun(scan, point_map, prior), True
        spaces = [self._window(each.predicted(self.noise)) for each in self._hypotheses]
        is_wide = [space.half_width > self._guard_radius for space in spaces]
        compared = [each for each, wide in zip(self._hypotheses, is_wide, strict=True) if not wide]
        for each, space, wide in zip(self._hypotheses, spaces, is_wide, strict=True):
            if not wide:
                continue
            if prior is not None and space.half_width > self.method.space.half_width:
                compared += self._inheriting(each, self._begun(scan, point_map, prior))
                break  # the prior's search space is that of all of them
            if space.half_width <= FARTHEST_REACH:
                pose = each.predicted(self.noise).pose
                found = self._candidates(space, scan, point_map, pose, RATIO_AT_FIRST)
                compared += self._inheriting(each, found)
        return compared, any(is_wide)

    def _begun(self, scan: Scan, point_map: PointMap, prior: Pose | None) -> list[Hypothesis]:
        """Hypotheses from the whole search space around the prior."""
        if prior is None:
            return []
        self._unchecked = 0.0
        found = self._candidates(self.method.space, scan, point_map, prior, RATIO_AT_FIRST)
        return [replace(each, evidence=1.0) for each in found]

    def _candidates(
        self, space: SearchSpace, scan: Scan, point_map: PointMap, prior: Pose, ratio: float
    ) -> list[Hypothesis]:
        self.searched = max(self.searched, space.half_width)
        return find_hypotheses(self.method, space, scan, point_map, prior, ratio)

    def _inheriting(self, parent: Hypothesis, found: list[Hypothesis]) -> list[Hypothesis]:
        """Return new hypotheses with the evidence of the one they follow, where its prediction allows them."""
        predicted = parent.predicted(self.noise)
        reach = self._window(predicted).half_width
        inheriting = []
        for each in found:
            away = distance(each.anchor, predicted)
            agreement = parent.agreement if away <= reach and parent.n_refused == 0 else 0.0
            unproven = self._unproven(parent, away, max(reach, APART))
            inheriting.append(replace(each, evidence=parent.evidence, agreement=agreement, unproven=unproven))
        return inheriting

    def _unproven(self, parent: Hypothesis, away: float, reach: float) -> float:
        """Way over which scans have yet to agree, m, at a place so far from where a hypothesis leads."""
        return PROVEN if self._has_begun and away > reach else parent.unproven

    def _followed(self, hypothesis: Hypothesis, scan: Scan, point_map: PointMap, prior: Pose | None) -> Hypothesis:
        """Compare a scan with the map around the prediction of a hypothesis."""
        predicted = hypothesis.predicted(self.noise)
        if prior is not None:
            predicted = predicted.adjusted(prior, HEIGHTS_AND_TILTS)
        estimate = self._searched(predicted, scan, point_map)
        if estimate.status is Status.AT_RIM:
            predicted = replace(predicted, covariance=predicted.covariance * WIDER**2)
            estimate = self._searched(predicted, scan, point_map)
        if not estimate.is_localized:
            return hypothesis.refused(estimate)
        adjusted = predicted.adjusted(estimate.pose, measured_covariance(estimate, self.method.space))
        return hypothesis.agreed(adjusted, estimate)

    def _searched(self, predicted: UncertainPose, scan: Scan, point_map: PointMap) -> Estimate:
        """The answer in the window of a prediction: that stands for the wider search that confirms a place."""
        trust = replace(self.method.trust, least_wall_share=self.method.trust.least_confirmed_share)
        method = replace(self.method, space=self._window(predicted), trust=trust, wider=0.0)
        self.searched = max(self.searched, method.space.half_width)
        return method.localize(scan, point_map, predicted.pose)

    def _window(self, predicted: UncertainPose) -> SearchSpace:
        return window(predicted, self.options.sigmas, self.method.space)

    def _check(self, scan: Scan, point_map: PointMap, prior: Pose | None) -> None:
        """Search the whole search space; what fits there about as well as the track competes with it from now on."""
        here = self._hypotheses[0].predicted(self.noise)
        ratio = self.method.trust.largest_runner_up
        middle = here.pose if prior is None else prior
        found = self._candidates(self.method.space, scan, point_map, middle, ratio)
        # Scores are compared within this search: where its cells happen to lie changes them by a fifth and more.
        near = [each.evidence for each in found if distance(each.anchor, here) <= self._guard_radius]
        own = max(near, default=ratio)
        is_open = math.isinf(self._unchecked) or self._outside > self.options.patience
        newcomers = []
        for each in found:
            worth = 1.0 if is_open or each.evidence * ratio >= own else NEWCOMER
            away = distance(each.anchor, here)
            unproven = self._unproven(self._hypotheses[0], away, APART) if prior is None else 0.0
            newcomers.append(replace(each, evidence=worth * min(1.0, each.evidence / own), unproven=unproven))
        self._hypotheses = ranked([*self._hypotheses, *newcomers], self.noise, self._guard_radius)
        self._unchecked = 0.0

    def _conclude(self, point_map: PointMap, prior: Pose | None) -> Estimate | None:
        """Say where the best hypothesis is, and whether that may be used."""
        if not self._hypotheses:
            self._was_localized = False
            if prior is None:
                return None
            return Estimate(prior, 0.0, None, Status.LOST, UNKNOWN, reason="no place fits the scan")
        best = self._hypotheses[0]
        place = best.predicted(self.noise)
        rival = self._hypotheses[1].evidence if len(self._hypotheses) > 1 else 0.0
        status, reason = self._judged(best, place, rival)
        self._was_localized = status is Status.LOCALIZED
        self._has_begun |= self._was_localized
        estimate = best.estimate or Estimate(place.pose, 0.0, None, status, UNKNOWN)
        # The error of the map is the same from scan to scan: the filter cannot have averaged it out.
        covariance = place.covariance + map_covariance(point_map.sigma)
        level = (math.inf, math.inf)
        if self._was_localized:
            level = protection_level(covariance, place.pose.heading, self.method.risk)
        space = self.method.space
        cell = None if prior is None or space.is_open else space.at(point_map.cell).nearest_cell(place.pose, prior)
        return replace(
            estimate, pose=place.pose, cell=cell, status=status, runner_up=rival,
            reason="; ".join(filter(None, [reason, estimate.reason])), covariance=covariance, protection_level=level,
        )  # fmt: skip

    def _judged(self, best: Hypothesis, place: UncertainPose, rival: float) -> tuple[Status, str]:
        """Status of the best hypothesis, and the reason beside it."""
        options = self.options
        why = Status.LOST if best.estimate is None or best.n_refused == 0 else best.estimate.status
        if self._outside > options.patience:
            return Status.LOST, f"outside of the prior's search space for {self._outside:.0f} m"
        largest = self.method.trust.largest_runner_up
        if rival > (largest if self._was_localized else min(largest, TOLD_APART)):
            return Status.AMBIGUOUS, f"{len(self._hypotheses)} places fit the last scans"
        if best.agreement < options.least_agreement:
            needed = f"{best.agreement:.2f}, {options.least_agreement:g} is needed"
            return why, f"too few scans agree with this place so far: their matched fractions sum to {needed}"
        if best.unproven > 0.0:
            more = f"without a prior scans have to agree over {best.unproven:.0f} m more"
            return why, f"the motion does not lead here, another place may be alike: {more}"
        if place.sigma > options.largest_sigma:
            return why, f"known to {place.sigma:.2f} m only"
        if best.is_contradicted:
            return why, "the scan speaks against the predicted place"
        if best.n_refused > 0:
            return (Status.LOCALIZED, f"predicted over {best.motion.distance:.1f} m, for the scan itself: {why}")
        return Status.LOCALIZED, ""

    def _is_inside(self, pose: Pose, prior: Pose) -> bool:
        """Whether a pose lies in the search space around the prior."""
        reach = self.method.space.half_width + self._guard_radius
        return max(abs(pose.x - prior.x), abs(pose.y - prior.y)) <= reach
