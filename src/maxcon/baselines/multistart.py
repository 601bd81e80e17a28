# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MultiStart: a method from many starts, to see whether they all end at the same place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from maxcon.baselines.started import StartedMethod, check_number, check_steps
from maxcon.errors import OptionError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.point_map import PointMap
from maxcon.scan import Scan

__all__ = ["MultiStart"]


@dataclass(frozen=True)
class MultiStart:
    """Localizes scans from a square grid of starts; the default is the paper's 5 x 5 at 1 m.

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

    Raises
    ------
    OptionError
        If a value is out of its range.
    """

    method: StartedMethod
    n_side: int = 5
    spacing: float = 1.0
    agreement_distance: float = 0.3
    agreement_heading_deg: float = 1.0

    def __post_init__(self) -> None:
        check_steps("n_side", self.n_side, 5)
        check_number("spacing", self.spacing, 1.0, "m")
        check_number("agreement_distance", self.agreement_distance, 0.3, "m")
        check_number("agreement_heading_deg", self.agreement_heading_deg, 1.0, "degrees")

    def starts(self, centre: Pose) -> list[Pose]:
        """Poses of the grid around `centre`, in map axes, in the order (y, x); all else is that of `centre`."""
        steps = [self.spacing * (step - 0.5 * (self.n_side - 1)) for step in range(self.n_side)]
        return [replace(centre, x=centre.x + dx, y=centre.y + dy) for dy in steps for dx in steps]

    @property
    def largest_offset(self) -> float:
        """How far from the centre the corners of the grid lie, m."""
        return math.sqrt(0.5) * self.spacing * (self.n_side - 1)

    def estimates(self, scan: Scan, point_map: PointMap, centre: Pose) -> list[Estimate]:
        """Where the method ends from each start.

        Parameters
        ----------
        scan : Scan
            Points of one epoch, sensor frame.
        point_map : PointMap
            The map.
        centre : Pose
            T_map_sensor, local frame of the map: the prior, or the reference of an evaluation.

        Returns
        -------
        list of Estimate
            In the order of `starts`.
        """
        aligner = self.method.prepare(scan, point_map, centre, self.largest_offset)
        return [aligner.align(start) for start in self.starts(centre)]

    def choose(self, estimates: Sequence[Estimate]) -> Estimate:
        """Return the end with the most correspondences, the first of equal ones.

        What would be `LOCALIZED` is `AMBIGUOUS` if not all starts ended within 0.3 m and 1 degree of it (the
        options say how near). Most correspondences need not be the right place: in a street of equal houses
        every house has about as many.

        Raises
        ------
        OptionError
            If there are no estimates.
        """
        if not estimates:
            raise OptionError("Expected the estimates of at least one start, got none.")
        best = max(estimates, key=lambda estimate: estimate.score)
        if best.is_localized and not all(self._agrees(estimate.pose, best.pose) for estimate in estimates):
            return replace(best, status=Status.AMBIGUOUS)
        return best

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Find the pose of a scan in the map: what `choose` makes of `estimates` around the prior."""
        return self.choose(self.estimates(scan, point_map, prior))

    def _agrees(self, pose: Pose, best: Pose) -> bool:
        distance = math.hypot(pose.x - best.x, pose.y - best.y)
        turned = abs(wrap_angle(pose.heading - best.heading))
        return distance <= self.agreement_distance and turned <= math.radians(self.agreement_heading_deg)
