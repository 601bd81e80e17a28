# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Judged after refinement (D12): the pose of a best cell adjusted to the map, and what that says of it."""

from dataclasses import replace

from maxcon.estimate import Estimate, Status
from maxcon.integrity import Trust, protection_level
from maxcon.map import PointMap
from maxcon.refine import HEIGHT_SIGMA, TILT_SIGMA, covariance, least_wall_share, refine
from maxcon.refine.ground import GroundFit
from maxcon.scan import Scan

__all__ = ["examine"]

# A height and a tilt told by the ground are not taken for better than this, m and rad: of walls and ground in the map
# each has its own error.
GROUND_HEIGHT_SIGMA, GROUND_TILT_SIGMA = 0.03, 0.003


def examine(
    found: Estimate,
    ground: GroundFit | None,
    scan: Scan,
    point_map: PointMap,
    trust: Trust,
    risk: float,
    *,
    is_confirmed: bool = False,
) -> Estimate:
    """Adjust the pose of a best cell to the surfaces of the map, and judge it once more.

    Parameters
    ----------
    found : Estimate
        The best cell of a search, judged. If it is in doubt already, only its height, roll and pitch are the ground's.
    ground : GroundFit or None
        The scan on the ground of the place that was found, where that can be told.
    scan : Scan
        All its points, with normals, sensor frame.
    point_map : PointMap
        The map.
    trust : Trust
        From where on the answer is not trusted.
    risk : float
        Of an error larger than the protection level.
    is_confirmed : bool
        Whether a wider search found the same place.

    Returns
    -------
    Estimate
        With a refined pose, covariance and protection level where it is localized still, with a reason where not.
    """
    start = found.pose if ground is None else ground.pose
    if not found.is_localized:
        return replace(found, pose=start)
    height_sigma, tilt_sigma = HEIGHT_SIGMA, TILT_SIGMA
    if ground is not None:
        height_sigma = max(ground.sigma_height, GROUND_HEIGHT_SIGMA)
        tilt_sigma = max(ground.sigma_tilt, GROUND_TILT_SIGMA)
    refined = refine(scan, point_map, start, height_sigma=height_sigma, tilt_sigma=tilt_sigma)
    walls = least_wall_share(refined)
    status = trust.judge_refined(
        n_planes=refined.n_planes,
        moved=refined.moved,
        wall_share=None if walls is None else walls.share,
        is_confirmed=is_confirmed,
    )
    if status is Status.LOCALIZED:
        errors = covariance(refined, point_map.sigma)
        level = protection_level(errors, refined.pose.heading, risk)
        return replace(found, pose=refined.pose, covariance=errors, protection_level=level)
    reason = f"{refined.n_planes} points on planes of the map, {refined.moved:.2f} m from the best cell"
    if status is Status.WALLS_MISSING:
        reason = "the scan has hardly any wall points" if walls is None else walls.words
    return replace(found, pose=start, status=status, reason="; ".join(filter(None, [found.reason, reason])))
