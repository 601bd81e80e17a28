# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MultiStart: a method from many starts; whether all end at the same place, or which of the ends fits best."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.baselines.started import Aligner, StartedMethod, check_options, number, whole_number
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import NamedOption


class Choice(NamedOption, option="choice"):
    """Which end of many starts is the answer, and when it may be used."""

    AGREEMENT = "agreement"
    """The one with the most correspondences; it may be used if all starts ended there."""

    OVERLAP = "overlap"
    """The one that leaves the most scan points near the map; it may be used if the method itself says so."""


@dataclass(frozen=True)
class MultiStart(StartedMethod):
    """Localizes scans from a grid of starts; the default is the paper's 5 x 5 at 1 m, all at the prior's heading.

    In the paper's evaluation the grid is centred at the reference, and ICP fails in an epoch if not all starts
    end at the reference: take `estimates` for that. `localize` is what can be had without a reference.

    Parameters
    ----------
    method : StartedMethod
        `Icp` or `Gicp`. The work that does not depend on the start is done once.
    n_side : int
        Starts along each side of the grid.
    spacing : float
        Between starts, m.
    agreement_distance : float
        Ends farther than this from the best are another place, in x and y, m.
    agreement_heading_deg : float
        So are ends turned by more than this against the best, degrees.
    n_headings : int
        Every place of the grid is tried at so many headings.
    heading_spacing_deg : float
        Between headings, degrees.
    choice : {"agreement", "overlap"}
        Which end is the answer. Correspondences within a wide gate are about as many at a wrong place as at the
        right one: where most starts are expected to fail, take `overlap`.
    overlap_distance : float
        A scan point within this of the map counts for the overlap, m.
    """

    method: StartedMethod
    n_side: int = whole_number(5)
    spacing: float = number(1.0, "m")
    agreement_distance: float = number(0.3, "m")
    agreement_heading_deg: float = number(1.0, "degrees")
    n_headings: int = whole_number(1)
    heading_spacing_deg: float = number(1.0, "degrees")
    choice: str | Choice = Choice.AGREEMENT
    overlap_distance: float = number(0.3, "m")

    def __post_init__(self) -> None:
        object.__setattr__(self, "choice", Choice.parse(self.choice))
        check_options(self)

    def starts(self, centre: Pose) -> list[Pose]:
        """Poses around `centre`, in map axes, in the order (heading, y, x); all else is that of `centre`."""
        offsets = _steps_about_zero(self.n_side, self.spacing)
        turns = _steps_about_zero(self.n_headings, math.radians(self.heading_spacing_deg))
        return [
            replace(centre, x=centre.x + dx, y=centre.y + dy, heading=centre.heading + turn)
            for turn in turns
            for dy in offsets
            for dx in offsets
        ]

    @property
    def largest_offset(self) -> float:
        """How far from the centre the corners of the grid lie, m."""
        return math.sqrt(0.5) * self.spacing * (self.n_side - 1)

    def prepare(self, scan: Scan, point_map: PointMap, around: Pose, spread: float = 0.0) -> Aligner:
        """Do once what all starts share, those around any centre within `spread` (m) of `around`."""
        return self.method.prepare(scan, point_map, around, self.largest_offset + spread)

    def estimates(self, scan: Scan, point_map: PointMap, centre: Pose) -> list[Estimate]:
        """Return where the method ends from each of `starts` around `centre`: the prior, or a reference.

        With the choice `overlap`, `score` is how many points of the thinned scan end near the map.
        """
        aligner = self.prepare(scan, point_map, centre)
        ends = [aligner.align(start) for start in self.starts(centre)]
        if self.choice is Choice.AGREEMENT:
            return ends
        overlaps = [aligner.n_near_map(end.pose, self.overlap_distance) for end in ends]
        return [replace(end, score=float(overlap)) for end, overlap in zip(ends, overlaps, strict=True)]

    def choose(self, estimates: Sequence[Estimate]) -> Estimate:
        """Return the end with the highest score, the first of equal ones: correspondences, or the overlap.

        By agreement, what would be `LOCALIZED` is `AMBIGUOUS` if not all starts ended within the agreement's distance
        and heading of it. Most correspondences need not be the right place: in a street of equal houses every house has
        about as many. OptionError if there are no estimates.
        """
        if not estimates:
            raise OptionError("Expected the estimates of at least one start, got none.")
        best = max(estimates, key=lambda estimate: estimate.score)
        if self.choice is Choice.OVERLAP:
            return best
        if best.is_localized and not all(self._agrees(estimate.pose, best.pose) for estimate in estimates):
            return replace(best, status=Status.AMBIGUOUS)
        return best

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Return what `choose` makes of `estimates` around the prior."""
        return self.choose(self.estimates(scan, point_map, prior))

    def _agrees(self, pose: Pose, best: Pose) -> bool:
        distance = math.hypot(pose.x - best.x, pose.y - best.y)
        turned = abs(wrap_angle(pose.heading - best.heading))
        return distance <= self.agreement_distance and turned <= math.radians(self.agreement_heading_deg)


def _steps_about_zero(n_steps: int, spacing: float) -> list[float]:
    """`n_steps` numbers, `spacing` apart, with the mean 0."""
    return [spacing * (step - 0.5 * (n_steps - 1)) for step in range(n_steps)]
