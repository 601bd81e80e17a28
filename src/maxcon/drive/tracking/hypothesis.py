# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Hypothesis: one place where the sensor may be, and what speaks for it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from maxcon.drive.tracking.motion import Motion, MotionNoise
from maxcon.drive.tracking.uncertain_pose import UncertainPose
from maxcon.estimate import Estimate

__all__ = ["Hypothesis", "distance", "ranked", "weighed"]

# Scans taken within this way see much the same surfaces: together they are held to say as much as one, m.
WAY_OF_EVIDENCE = 2.0
# What no scan matches is not worth nothing: the next scan may be hidden no longer.
LEAST_RATIO = 0.1
# A hypothesis worth less than this share of the best one is given up.
LEAST_EVIDENCE = 0.05
MOST_HYPOTHESES = 8
# What has agreed for long is not doubted for one scan that is hidden, but for the third in a row.
MOST_AGREEMENT = 4.0
STANDSTILL = Motion.none()


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One place where the sensor may be.

    Parameters
    ----------
    anchor : UncertainPose
        Where it was when a scan last agreed with it, or where a search found it.
    evidence : float
        Its scores over those of the best hypothesis, multiplied over the way: at first the runner-up ratio of a
        single epoch, and smaller with every metre on which it fits worse. The best one has 1.
    motion : Motion
        Since the anchor, as one: errors of odometry add up over it, they do not cancel.
    agreement : float
        Shares of their points that scans matched here, added up over scans that agreed, up to `MOST_AGREEMENT`, and
        halved with each scan that did not: so many whole scans lie on the map.
    n_refused : int
        Scans in a row that did not, up to now.
    estimate : Estimate or None
        What the search around it answered last.
    """

    anchor: UncertainPose
    evidence: float = 1.0
    motion: Motion = STANDSTILL
    agreement: float = 0.0
    n_refused: int = 0
    estimate: Estimate | None = None

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
        return replace(self, anchor=anchor, motion=STANDSTILL, agreement=agreement, n_refused=0, estimate=estimate)

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
