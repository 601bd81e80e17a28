# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of sparse scans, turned to the sensor.

A ring scanner's points lie 0.2 degrees apart along a ring and 2 degrees apart across: the nearest neighbours
of a point are all on its own ring, and say nothing of the surface. So neighbours are taken by angle, from a
window around the point that grows until more than one ring is in it, wherever the next rings are: they may be
evenly spaced or not, smeared by the motion of the sensor, thinned, or missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.geometry.arrays import as_points
from maxcon.geometry.pose import Pose


def estimate_scan_normals(
    points: NDArray[np.float64], is_asked: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Unit normals (n, 3) of a scan's points (n, 3), m, sensor frame, turned to the sensor; zeros where none is found.

    Only those asked for (n,) are estimated. Windows reach 6.9 degrees above and below a point: nearer than 1.25 m there
    are none. The same points in another order have the same normals, to the last bit.
    """
    from maxcon.scan.normal_kernels import scan_planes
    from maxcon.scan.window_kernels import azimuths_of, elevations_of, extremes

    points = np.ascontiguousarray(as_points(points, "points"))
    normals = np.empty_like(points)
    if len(points) == 0:
        return normals
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    lowest, highest = extremes(elevations)
    asked = np.ones(len(points), np.bool_) if is_asked is None else is_asked
    scan_planes(points, elevations, azimuths, lowest, highest, asked, normals)
    return normals


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """Where the points of an epoch were measured from, by several scanners of one vehicle."""

    scanners: NDArray[np.int64]  # (n,): index into `poses`: which scanner each point comes from
    poses: tuple[Pose, ...]  # T_vehicle_sensor of each scanner

    def __post_init__(self) -> None:
        if len(self.scanners) and not 0 <= self.scanners.min() <= self.scanners.max() < len(self.poses):
            raise ArrayError(
                f"Expected `scanners` from 0 to {len(self.poses) - 1}, got {self.scanners.min()} to"
                f" {self.scanners.max()}."
            )

    def normals(self, points: NDArray[np.float64], is_asked: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return unit normals, (n, 3), of points, (n, 3), m, in the vehicle's frame, for each scanner by itself."""
        normals = np.zeros_like(points)
        for number, pose in enumerate(self.poses):
            rows = np.flatnonzero(self.scanners == number)
            points_sensor = (points[rows] - pose.position) @ pose.rotation
            asked = None if is_asked is None else is_asked[rows]
            normals[rows] = estimate_scan_normals(points_sensor, asked) @ pose.rotation.T
        return normals
