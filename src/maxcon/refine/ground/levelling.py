# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where the ground of a scan lies on the ground of the map: height, roll and pitch, or that it cannot be told."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices
from maxcon.map import PointMap
from maxcon.scan import Scan

__all__ = ["GroundFit", "fit_ground"]

# The scan's ground is looked for from NEAREST to FARTHEST around it (m): nearer there is the vehicle, farther rings
# lie apart. Of each cell of CELL the points up to THICKNESS above the lowest are taken (m).
NEAREST, FARTHEST = 2.5, 30.0
CELL, THICKNESS = 0.5, 0.12
# A prior's height may be wrong by REACH (m). The fit begins where most cells nearer than NEAR agree, to within BIN
# either way: there a tilt does not yet amount to much.
REACH, BIN, NEAR = 2.5, 0.1, 12.0
# It begins at these tilts, with weights of these scales (m): cars and kerbs make one start end where few cells agree.
TILTS = (-0.02, 0.0, 0.02)
STARTS = np.array([[0.0, x, y] for x in TILTS for y in TILTS])
SCALES = np.array([0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1])
# Starts are tried with about so many of the cells.
ENOUGH = 500
# A prior is tilted by some TILT (rad); ground that differs by ROUGHNESS (m) between scan and map does so over many
# cells beside each other, of which ALIKE count as one.
TILT, ROUGHNESS, ALIKE = math.radians(2.0), 0.05, 20.0
STIFFNESS = ALIKE * (ROUGHNESS / TILT) ** 2
# A cell lies on the ground if it is not farther off than this (m). So many must, and that share of those that have
# ground in the map.
ON_GROUND = 0.15
FEWEST_CELLS, LEAST_SHARE = 60, 0.2


@dataclass(frozen=True, slots=True)
class GroundFit:
    """Where the ground of a scan lies on that of the map.

    Parameters
    ----------
    pose : Pose
        The pose it was fitted at, with the height, roll and pitch that lay the scan on the ground.
    height : float
        What that adds to its height, m.
    tilt : float
        The angle by which it turns, rad.
    spread : float
        Root mean square of how far the cells on the ground lie off it, m.
    n_cells : int
        Cells of half a metre of the scan that lie on the ground.
    share : float
        That of those with ground in the map, 0 to 1: cars, hedges and walls are not on it.
    sigma_height, sigma_tilt : float
        Standard deviations of height, m, and of the less determined tilt, rad, as far as the cells tell: not what the
        ground of another place is worth.
    """

    pose: Pose
    height: float
    tilt: float
    spread: float
    n_cells: int
    share: float
    sigma_height: float
    sigma_tilt: float


def fit_ground(scan: Scan, point_map: PointMap, pose: Pose) -> GroundFit | None:
    """Lay the ground of a scan on the ground of the map, at the place and heading of a pose.

    The lowest points in cells of half a metre are compared with the heights of the map below; the plane of corrections
    that most cells agree on is found by reweighted least squares from several tilts.

    Parameters
    ----------
    scan : Scan
        Sensor frame.
    point_map : PointMap
        With ground; otherwise there is nothing to tell.
    pose : Pose
        T_map_sensor, local frame; its height may be wrong by 2 m, roll and pitch by 2 degrees. On a slope another place
        has another height: the fit is right for the place that it is made at.

    Returns
    -------
    GroundFit or None
        None where too little ground is known, or scan and map do not agree on it.
    """
    if not (point_map.has_ground and len(scan)):
        return None
    points, below = _below_ground(scan, point_map, pose)
    if len(points) < FEWEST_CELLS:
        return None
    plane, normal = fit_plane(points, below, REACH)
    off = np.abs(below - plane[0] - points[:, :2] @ plane[1:])
    is_on_ground = off <= ON_GROUND
    n_cells, share = int(is_on_ground.sum()), float(is_on_ground.mean())
    if n_cells < FEWEST_CELLS or share < LEAST_SHARE or abs(plane[0]) > REACH:
        return None
    spread = float(np.sqrt(np.mean(off[is_on_ground] ** 2)))
    sigma_height, sigma_x, sigma_y = (spread * np.sqrt(ALIKE * np.diag(np.linalg.inv(normal)))).tolist()
    height, slope_x, slope_y = plane.tolist()
    return GroundFit(
        laid(pose, height, slope_x, slope_y), height, math.atan(math.hypot(slope_x, slope_y)), spread, n_cells, share,
        sigma_height, max(sigma_x, sigma_y),
    )  # fmt: skip


def fit_plane(
    points: NDArray[np.float64], below: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The plane that most points agree on, from several tilts.

    Parameters
    ----------
    points : array, shape (n, 3)
        About the sensor, levelled, m.
    below : array, shape (n,)
        How far each lies below the plane that is looked for, m.
    reach : float
        How far at most, m.

    Returns
    -------
    plane : array, shape (3,)
        Height, m, and slopes along x and y.
    normal : array, shape (3, 3)
        Its normal equations.
    """
    from maxcon.refine.ground import kernels

    starts = STARTS + [kernels.most_frequent(points, below, NEAR, reach, BIN), 0.0, 0.0]
    plane, normal = np.empty(3), np.empty((3, 3))
    kernels.fit_planes(points, below, starts, SCALES, STIFFNESS, max(1, len(points) // ENOUGH), plane, normal)
    return plane, normal


def _below_ground(scan: Scan, point_map: PointMap, pose: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest points of the scan's cells, levelled, about the sensor, (m, 3), and how far they lie below the ground, m.

    Where the map has several levels, of the one that most points near the sensor are nearest to.
    """
    from maxcon.refine.ground import kernels

    rotation = np.ascontiguousarray(rotation_matrices(pose.roll, pose.pitch, 0.0))
    points = kernels.lowest_of_cells(scan.points, rotation, CELL, NEAREST, FARTHEST, THICKNESS)
    patch = point_map.ground_around(pose.x, pose.y, FARTHEST)
    corner = (patch.first[0] * patch.edge, patch.first[1] * patch.edge)
    turn = (math.cos(pose.heading), math.sin(pose.heading))
    below = np.empty(len(points))
    height = 0.0
    for _ in range(2):
        position = (pose.x, pose.y, pose.z)
        kernels.heights_below(points, patch.heights, corner, patch.edge, position, turn, height, below)
        has_ground = np.isfinite(below)
        if len(patch.heights) == 1:
            break
        height = kernels.most_frequent(points, below, NEAR, REACH, BIN)
    return points[has_ground], below[has_ground]


def laid(pose: Pose, height: float, slope_x: float, slope_y: float) -> Pose:
    """The pose, raised and tilted as a plane in its levelled axes says."""
    slope = math.hypot(slope_x, slope_y)
    angle = math.atan(slope)
    x, y = (slope_y / slope, -slope_x / slope) if slope > 0.0 else (1.0, 0.0)
    cross = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    rotation = turn @ rotation_matrices(pose.roll, pose.pitch, 0.0)
    return pose.with_height_and_tilt_of(Pose.from_rotation([0.0, 0.0, pose.z + height], rotation))
