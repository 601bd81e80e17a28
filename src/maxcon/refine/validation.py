"""Validation after refinement (D12): a best cell adjusted to the map, and whether walls of scan and map agree there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.integrity import Trust, protection_level
from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.refine import adjustment
from maxcon.refine.fit import fit_of
from maxcon.refine.ground import REACH, GroundFit, shares_off_ground
from maxcon.scan import Scan

# Height and tilt by the ground are not held for more exact than this, m and rad: walls and ground of a map have errors
# of their own.
GROUND_HEIGHT_SIGMA, GROUND_TILT_SIGMA = 0.01, 0.003
# A wall point has a normal with a vertical part below LEVEL; it is found if a plane of the map lies within this, m.
LEVEL = 0.5
FOUND_WITHIN = 0.08
N_BINS = 6  # orientation bins of wall points, 30 degrees of azimuth each; both sides of a wall are in one
FEWEST_POINTS = 20  # bins with fewer wall points are not judged
# Without a ground fit, an answer is in doubt where more of a scan's lowest points lie below, or far above the ground.
MOST_BELOW_GROUND, MOST_ABOVE_GROUND = 0.05, 0.9
# Added to the numbers of found and of all points: 2 of 20 are less certain than 20 of 200.
FOUND_BEFORE, ALL_BEFORE = 2, 4


def validate(
    found: Estimate, ground: GroundFit | None, scan: Scan, point_map: PointMap, trust: Trust, risk: float, *,
    is_confirmed: bool = False, passes: Sequence[adjustment.Pass] = adjustment.PASSES,
) -> Estimate:  # fmt: skip
    """Adjust the pose of a best cell to the surfaces of the map, and judge it once more.

    found: the best cell of a search, judged. If it is in doubt already, only its height, roll and pitch are the
        ground's.
    ground: the fit of the scan's ground at the place that was found, where that can be told.
    scan: all its points, with normals, sensor frame.
    point_map: the map.
    trust: thresholds for the answer to stay localized.
    risk: of an error larger than the protection level.
    is_confirmed: whether a wider search found the same place.
    passes: of the adjustment; the last ones suffice for a candidate that is adjusted already.
    Returns with a refined pose, covariance and protection level where it is localized still, with a reason where not.
    """
    start = found.pose if ground is None else ground.pose
    is_image_better = found.status is Status.MISFIT  # of the scan as it is
    if not (found.is_localized or is_image_better):
        return replace(found, pose=start)
    table = adjustment.table_around(scan.sample, point_map, [start])
    refined = _refined(scan, point_map, start, ground, passes, table)
    walls = least_wall_share(refined)
    status = trust.status_of_pose(
        n_planes=refined.n_planes,
        moved=refined.moved,
        wall_share=None if walls is None else walls.share,
        is_confirmed=is_confirmed,
    )
    if status is Status.LOCALIZED:
        fit = fit_of(refined, scan.sample, point_map, table)
        reason = "; ".join(filter(None, [found.reason, fit.words]))
        if fit.misfit > trust.largest_misfit or (is_image_better and fit.refined is refined):
            return replace(found, pose=start, status=Status.MISFIT, reason=reason)
        below, above = (0.0, 0.0) if ground is not None else shares_off_ground(scan, point_map, fit.refined.pose)
        if below > MOST_BELOW_GROUND or above > MOST_ABOVE_GROUND:
            words = f"{below:.0%} of the scan's lowest points lie below the map's ground: is roll or pitch wrong?"
            if above > MOST_ABOVE_GROUND:
                words = f"the scan's lowest points lie more than {REACH:g} m above the ground: is its height wrong?"
            reason = "; ".join(filter(None, [reason, words]))
            return replace(found, pose=start, status=Status.NOT_CONFIRMED, reason=reason)
        pose, errors = fit.refined.pose, adjustment.covariance(fit.refined, point_map.sigma) + fit.covariance
        level = protection_level(errors, pose.heading, risk)
        return replace(found, pose=pose, status=status, covariance=errors, protection_level=level, reason=reason)
    reason = f"{refined.n_planes} points on planes of the map, {refined.moved:.2f} m from the best cell"
    if status is Status.WALLS_MISSING:
        reason = "the scan has hardly any wall points" if walls is None else walls.words
    return replace(found, pose=start, status=status, reason="; ".join(filter(None, [found.reason, reason])))


def _refined(
    scan: Scan, point_map: PointMap, start: Pose, ground: GroundFit | None, passes: Sequence[adjustment.Pass],
    table: VoxelTable,
) -> adjustment.Refined:  # fmt: skip
    """The adjusted pose, which the ground holds if it is known."""
    height_sigma, tilt_sigma = adjustment.HEIGHT_SIGMA, adjustment.TILT_SIGMA
    if ground is not None:
        height_sigma = max(ground.sigma_height, GROUND_HEIGHT_SIGMA)
        tilt_sigma = max(ground.sigma_tilt, GROUND_TILT_SIGMA)
    return adjustment.refine(
        scan, point_map, start, height_sigma=height_sigma, tilt_sigma=tilt_sigma, passes=passes, table=table
    )


def fits_on_ground(found: Pose, ground: GroundFit, scan: Scan, point_map: PointMap) -> bool:
    """Whether a scan fits the map at least as well on its ground there as at the height that was found, far from it.

    What looks like the ground may be the roofs of cars; and few walls tell heights.
    """
    table, passes = adjustment.table_around(scan.sample, point_map, [found]), adjustment.LAST_PASSES
    here = _refined(scan, point_map, found, None, passes, table)
    there = _refined(scan, point_map, ground.pose, ground, passes, table)
    return bool(there.weights.sum() >= here.weights.sum())


@dataclass(frozen=True, slots=True)
class WallShare:
    """Of the wall points of one orientation bin, how many lie on walls of the map.

    azimuth: middle of the bin, rad from +x, 0 to pi: both sides of a wall are in one bin.
    n_points, n_found: wall points of the bin, and those within 8 cm of a wall of the map.
    """

    azimuth: float
    n_points: int
    n_found: int

    @property
    def share(self) -> float:
        """Found over all, 0 to 1, drawn to a half where there are few."""
        return (self.n_found + FOUND_BEFORE) / (self.n_points + ALL_BEFORE)

    @property
    def words(self) -> str:
        """The share as part of a sentence for a reader."""
        azimuth = f"{math.degrees(self.azimuth):.0f} degrees from +x (of 180)"
        return f"of {self.n_points} wall points facing {azimuth} {self.n_found} lie on the map"


def least_wall_share(refined: adjustment.Refined) -> WallShare | None:
    """The lowest share over six orientation bins of 30 degrees each; None where no bin has 20 wall points.

    At a wrong place along a street the walls along it fit all the same; those across do not.
    """
    from maxcon.refine import kernels

    n_points, n_found = np.zeros(N_BINS, np.int64), np.zeros(N_BINS, np.int64)
    kernels.count_walls(
        refined.normals, refined.residuals, refined.pose.rotation, LEVEL, FOUND_WITHIN, n_points, n_found
    )
    shares = [
        WallShare((k + 0.5) * math.pi / N_BINS, int(n_points[k]), int(n_found[k]))
        for k in range(N_BINS)
        if n_points[k] >= FEWEST_POINTS
    ]
    return min(shares, key=lambda each: each.share, default=None)
