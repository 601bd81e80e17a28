"""Ground plane fits: height, roll and pitch of a sensor from the ground of its scan, with and without a map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices
from maxcon.map import PointMap
from maxcon.map.ground import HEADROOM
from maxcon.scan import Scan
from maxcon.scan.scan import FARTHEST_GROUND

# A prior's height may be wrong by REACH (m). The fit begins where most cells nearer than NEAR agree, to within BIN
# either way: there a tilt does not yet amount to much.
REACH, BIN, NEAR = 2.5, 0.1, 12.0
# It begins at these tilts, with weights of these scales (m): cars and kerbs make one start end where few cells agree.
TILTS = (-0.02, 0.0, 0.02)
STARTS = np.array([[0.0, x, y] for x in TILTS for y in TILTS])
SCALES = np.array([0.3, 0.25, 0.2, 0.15, 0.12, 0.1, 0.1])
# Most cells may be those of parked cars, hedges or clutter: a scan's own ground is also looked for where so many cells
# lie higher. What has many cells so far under it, m, is no ground.
DEEP, UNDER = 0.85, 0.3
# Starts are tried with about so many of the cells.
ENOUGH = 500
# A prior is tilted by some TILT (rad); ground that differs by ROUGHNESS (m) between scan and map does so over many
# cells beside each other, of which ALIKE count as one.
TILT, ROUGHNESS, ALIKE = math.radians(2.0), 0.05, 20.0
STIFFNESS = ALIKE * (ROUGHNESS / TILT) ** 2
# A cell lies on the ground if it is not farther off than this (m). So many must, and that ratio of those that have
# ground in the map.
ON_GROUND = 0.15
FEWEST_CELLS, LEAST_RATIO = 60, 0.2
# Scanners stand up to so high above the ground, m.
HIGHEST = 5.0
# The slope below a scanner is that of the map's ground so far around, m, if it is known in so many cells.
AROUND = 8.0
FEWEST_SLOPE_CELLS = 20


@dataclass(frozen=True, slots=True)
class GroundFit:
    """Where the ground of a scan lies on that of the map.

    pose: the pose it was fitted at, ground-aligned: with the height, roll and pitch that put the scan on the ground.
    height: what that adds to its height, m.
    tilt: the angle by which it turns, rad.
    spread: root mean square of how far the cells on the ground lie off it, m.
    n_cells: cells of half a metre of the scan that lie on the ground.
    ratio: that of those with ground in the map, 0 to 1: cars, hedges and walls are not on it.
    sigma_height, sigma_tilt: standard deviations of height, m, and of the less determined tilt, rad, as far as the
        cells tell: not what the ground of another place is worth.
    """

    pose: Pose
    height: float
    tilt: float
    spread: float
    n_cells: int
    ratio: float
    sigma_height: float
    sigma_tilt: float


def fit_ground(scan: Scan, point_map: PointMap, pose: Pose) -> GroundFit | None:
    """Fit the ground of a scan to the ground of the map, at the place and heading of a pose.

    The lowest points in cells of half a metre are compared with the heights of the map below; the plane of corrections
    that most cells agree on is found by reweighted least squares from several tilts.

    scan: sensor frame.
    point_map: without ground there is nothing to fit to.
    pose: T_map_sensor, local frame; its height may be wrong by 2 m, roll and pitch by 2 degrees. On a slope another
        place has another height: the fit is right for the place that it is made at.
    Returns none where too little ground is known, or scan and map do not agree on it.
    """
    if not (point_map.has_ground and len(scan)):
        return None
    points, below = _below_ground(scan, point_map, pose)
    if len(points) < FEWEST_CELLS:
        return None
    plane, cofactors = _fit_plane(points, below, REACH)
    off = np.abs(below - plane[0] - points[:, :2] @ plane[1:])
    is_on_ground = off <= ON_GROUND
    n_cells = int(np.count_nonzero(is_on_ground))
    ratio = n_cells / len(points)
    if n_cells < FEWEST_CELLS or ratio < LEAST_RATIO or abs(plane[0]) > REACH:
        return None
    spread = float(np.sqrt(np.mean(off[is_on_ground] ** 2)))
    sigma_height, sigma_x, sigma_y = (spread * np.sqrt(ALIKE * np.diag(cofactors))).tolist()
    height, slope_x, slope_y = plane.tolist()
    return GroundFit(
        _aligned(pose, height, slope_x, slope_y), height, math.atan(math.hypot(slope_x, slope_y)), spread, n_cells,
        ratio, sigma_height, max(sigma_x, sigma_y),
    )  # fmt: skip


def shares_off_ground(scan: Scan, point_map: PointMap, pose: Pose) -> tuple[float, float]:
    """Of a scan's lowest points at a pose, the shares clearly below and far above the map's ground; 0 if few are known.

    Far is farther than a fit reaches, `REACH`.
    """
    if not (point_map.has_ground and len(scan)):
        return 0.0, 0.0
    _, below = _below_ground(scan, point_map, pose)
    if len(below) < FEWEST_CELLS:
        return 0.0, 0.0
    return float(np.mean(below > UNDER)), float(np.mean(below < -REACH))


def other_storeys(point_map: PointMap, pose: Pose) -> list[float]:
    """How far the next storeys of the map's ground lie above (and below, negative) the one under a pose, m."""
    heights = point_map.ground_around(pose.x, pose.y, AROUND).heights
    if len(heights) < 2:
        return []
    own = np.where(heights <= pose.z, heights, -np.inf).max(axis=0)
    lowest = np.fmin.reduce(heights)
    away = heights - np.where(np.isfinite(own), own, lowest)
    found = []
    for side in (1.0, -1.0):
        nearest = np.where(side * away >= HEADROOM, side * away, np.inf).min(axis=0)
        known = nearest[nearest <= HIGHEST]
        if len(known) >= FEWEST_SLOPE_CELLS:
            found.append(side * float(np.median(known)))
    return found


def fit_ground_plane(scan: Scan, roll: float = 0.0, pitch: float = 0.0) -> Pose | None:
    """Fit a plane to the lowest points around a scanner, without any map.

    Returns T_ground_sensor: its z is the height above the plane, its roll and pitch make the plane level; x, y and
    heading are 0. None where too few cells of half a metre have points. With the roll and pitch given, rad, the scan's
    z is within some degrees of up.
    """
    points = scan.lowest_points(roll, pitch) @ rotation_matrices(roll, pitch, 0.0).T
    if len(points) < FEWEST_CELLS:
        return None
    plane, _ = _fit_plane(points, np.ascontiguousarray(-points[:, 2]), HIGHEST)
    return _aligned(Pose(0.0, 0.0, 0.0, roll, pitch, 0.0), *plane.tolist())


def pose_above_ground(point_map: PointMap, x: float, y: float, heading: float, T_ground_sensor: Pose) -> Pose:
    """Return T_map_sensor of a scanner at a place (local frame, m) and heading (rad) of a map with ground.

    Its height, roll and pitch are those above its own ground plane, as `fit_ground_plane` found them, put on the map's.
    """
    pose = Pose(x, y, T_ground_sensor.z, T_ground_sensor.roll, T_ground_sensor.pitch, heading)
    patch = point_map.ground_around(x, y, AROUND)
    rows, columns = np.nonzero(np.isfinite(patch.heights[0]))
    if len(rows) == 0:
        return pose
    heights = patch.heights[0][rows, columns].astype(np.float64)
    if len(rows) < FEWEST_SLOPE_CELLS:
        return _aligned(pose, float(np.median(heights)), 0.0, 0.0)
    east = (patch.first[0] + columns + 0.5) * patch.edge - x
    north = (patch.first[1] + rows + 0.5) * patch.edge - y
    sides = np.column_stack([np.ones(len(rows)), east, north])
    (height, slope_x, slope_y), *_ = np.linalg.lstsq(sides, heights, rcond=None)
    cosine, sine = math.cos(heading), math.sin(heading)
    along, across = slope_x * cosine + slope_y * sine, slope_y * cosine - slope_x * sine
    return _aligned(pose, float(height), float(along), float(across))


def _fit_plane(
    points: NDArray[np.float64], below: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The plane (height, slopes along x and y) that most points agree on, from several tilts; its cofactors.

    points : (n, 3), about the sensor, roll and pitch applied, m; below : (n,), how far each lies below the plane that
    is looked for, at most `reach`, m.
    """
    from maxcon.refine import ground_kernels

    def fitted(height: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        plane, cofactors = np.empty(3), np.empty((3, 3))
        starts, stride = STARTS + [height, 0.0, 0.0], max(1, len(points) // ENOUGH)
        ground_kernels.fit_planes(points, below, starts, SCALES, STIFFNESS, stride, plane, cofactors)
        return plane, cofactors

    def support(fit: tuple[NDArray[np.float64], NDArray[np.float64]]) -> int:
        under = below - fit[0][0] - points[:, :2] @ fit[0][1:]
        return int(np.count_nonzero(np.abs(under) <= ON_GROUND) - np.count_nonzero(under > UNDER))

    k = int(DEEP * len(below))
    usual, deep = ground_kernels.most_frequent(points, below, NEAR, reach, BIN), float(np.partition(below, k)[k])
    if abs(deep - usual) <= UNDER:
        return fitted(usual)
    return max(fitted(usual), fitted(deep), key=support)


def _below_ground(scan: Scan, point_map: PointMap, pose: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest points of the scan's cells, about the sensor, (m, 3), and how far they lie below the map's ground, m.

    The pose's roll and pitch are applied. Of several levels of ground, the one that most points near the sensor are
    nearest to; what is higher than the sensor may be a ceiling there, just below the next level.
    """
    from maxcon.refine import ground_kernels

    points = scan.lowest_points(pose.roll, pose.pitch) @ rotation_matrices(pose.roll, pose.pitch, 0.0).T
    patch = point_map.ground_around(pose.x, pose.y, FARTHEST_GROUND)
    if len(patch.heights) > 1:
        points = points[points[:, 2] < 0.0]
    corner = (patch.first[0] * patch.edge, patch.first[1] * patch.edge)
    turn = (math.cos(pose.heading), math.sin(pose.heading))
    below = np.empty(len(points))
    height = 0.0
    for _ in range(2):
        position = (pose.x, pose.y, pose.z)
        ground_kernels.heights_below(points, patch.heights, corner, patch.edge, position, turn, height, below)
        if len(patch.heights) == 1:
            break
        height = ground_kernels.most_frequent(points, below, NEAR, REACH, BIN)
    has_ground = np.isfinite(below)
    return points[has_ground], below[has_ground]


def _aligned(pose: Pose, height: float, slope_x: float, slope_y: float) -> Pose:
    """The pose, raised and tilted by a plane, z = height + slope_x x + slope_y y about it, roll and pitch applied."""
    # The shortest turn that puts the normal of the plane, (-slope_x, -slope_y, 1) scaled by `cosine`, upright.
    cosine = 1.0 / math.sqrt(1.0 + slope_x**2 + slope_y**2)
    a, b, half = cosine * slope_x, cosine * slope_y, cosine**2 / (1.0 + cosine)
    xx, xy, yy = 1.0 - half * slope_x**2, -half * slope_x * slope_y, 1.0 - half * slope_y**2
    turn = np.array([[xx, xy, -a], [xy, yy, -b], [a, b, cosine]])
    rotation = turn @ rotation_matrices(pose.roll, pose.pitch, 0.0)
    return pose.with_height_and_tilt_of(Pose.from_rotation([0.0, 0.0, pose.z + height], rotation))
