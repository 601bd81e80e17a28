# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The places of a wide search space where a scan fits: what hypotheses begin with."""

import math
from dataclasses import dataclass, replace

import numpy as np

from maxcon.drive.tracking.uncertain_pose import UncertainPose
from maxcon.drive.tracking.window import HEIGHT_SIGMA, TILT_SIGMA
from maxcon.estimate import Status
from maxcon.geometry import Pose
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.objectives import Helmert
from maxcon.search.space import SearchSpace

__all__ = ["Place", "find_places"]

MOST_PLACES = 8
# How well a place is known, which is where a peak of the scores is, m and rad.
PLACE_SIGMA, PLACE_HEADING_SIGMA = 0.1, math.radians(0.5)


@dataclass(frozen=True, slots=True)
class Place:
    """A pose (local frame) where a scan fits, and Helmert's score there over that of the best place."""

    pose: Pose
    share: float

    @property
    def uncertain(self) -> UncertainPose:
        """The pose with what is known of it before a scan is compared with the map there closely."""
        sigmas = [PLACE_SIGMA, PLACE_SIGMA, HEIGHT_SIGMA, TILT_SIGMA, TILT_SIGMA, PLACE_HEADING_SIGMA]
        return UncertainPose(self.pose, np.diag(np.square(sigmas)))


def find_places(
    method: MaximumConsensus, space: SearchSpace, scan: Scan, point_map: PointMap, prior: Pose, share: float
) -> list[Place]:
    """Return the places of a search space that score at least a share of the best one, the best first.

    Parameters
    ----------
    method : MaximumConsensus
        How cells are scored; its own space is not used. Places lie farther apart than its guard radius.
    space : SearchSpace
        Around the prior.
    scan : Scan
        Of one epoch.
    point_map : PointMap
        The map.
    prior : Pose
        T_map_sensor, local frame.
    share : float
        Of the best score, above 0 to 1.

    Notes
    -----
    Where branch and bound proves that no other place scores so much, that is all. Where it does not, every cell is
    looked at; of a wide space the places that it left open.
    """
    trust = replace(method.trust, largest_runner_up=share)
    asked = replace(method, space=space, trust=trust, refinement=False)
    best = asked.localize(scan, point_map, prior)
    if best.status is Status.NO_MATCH:
        return []
    if best.runner_up <= share:
        return [Place(best.pose, 1.0)]
    if asked.cell_search.is_coarse_to_fine(space, point_map):
        found = asked.cell_search.places(scan, point_map, prior.with_height_and_tilt_of(best.pose), space)
        worth = [float(Helmert().score(each.moments)) for each in found[:MOST_PLACES]]
        ratios = [score / max(worth) for score in worth] if max(worth, default=0.0) > 0.0 else []
        return [Place(each.pose, ratio) for each, ratio in zip(found, ratios, strict=False) if ratio >= share]
    accumulator = asked.accumulate(scan, point_map, prior)
    scores = np.array(accumulator.score(Helmert()), dtype=np.float64)
    rows, columns = np.meshgrid(*map(np.arange, accumulator.space.shape[1:]), indexing="ij")
    places: list[Place] = []
    highest = float(scores.max())
    while len(places) < MOST_PLACES and highest > 0.0:
        heading, iy, ix = (int(index) for index in np.unravel_index(int(np.argmax(scores)), scores.shape))
        ratio = float(scores[heading, iy, ix]) / highest
        if ratio < share:
            break
        pose = accumulator.space.pose((heading, iy, ix), accumulator.prior)
        places.append(Place(pose, ratio))
        is_near = np.hypot(rows - iy, columns - ix) * accumulator.space.cell_edge <= method.trust.guard_radius
        scores[:, is_near] = -1.0
    return places
