# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""WithinSigmas: each scan is searched where the covariance of its own prior lets it be (D2)."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.estimate import Estimate
from maxcon.geometry import Pose, wrap_angle
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory
from maxcon.search.space import SearchSpace

# A smaller space, m and degrees, saves no time, shows no place beyond the guard radius, and leaves out what no
# covariance of a prior holds: the map's own shift, a lever arm, a clock that is 20 ms off at 50 km/h.
SMALLEST_HALF_WIDTH, SMALLEST_TURN_DEG = 1.0, 1.0


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
            covariance,
            k=self.sigmas,
            cell=usual.cell,
            heading_step_deg=usual.heading_step_deg,
            smallest_half_width=SMALLEST_HALF_WIDTH,
            smallest_heading_half_width_deg=SMALLEST_TURN_DEG,
            largest_half_width=self.largest_half_width,
        )
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
