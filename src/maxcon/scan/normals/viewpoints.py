# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Viewpoints: which of several scanners each point of an epoch comes from, and where the scanners are mounted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.geometry.pose import Pose
from maxcon.scan.normals.scan_normals import estimate_scan_normals

__all__ = ["Viewpoints"]


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoints:
    """Where the points of an epoch were measured from, by several scanners of one vehicle.

    Parameters
    ----------
    scanners : array, shape (n,), int
        Index into `poses`: which scanner each point comes from.
    poses : tuple of Pose
        T_vehicle_sensor of each scanner.

    Raises
    ------
    ArrayError
        If a scanner's index is outside of `poses`.
    """

    scanners: NDArray[np.int64]
    poses: tuple[Pose, ...]

    def __post_init__(self) -> None:
        if len(self.scanners) and not 0 <= self.scanners.min() <= self.scanners.max() < len(self.poses):
            raise ArrayError(
                f"Expected `scanners` from 0 to {len(self.poses) - 1}, got {self.scanners.min()} to"
                f" {self.scanners.max()}."
            )

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return unit normals, shape (n, 3), of points, shape (n, 3), m, both in the vehicle's frame.

        They are estimated for each scanner by itself and turned to it: a point's neighbours lie on rings around its own
        scanner, and rings of two scanners cross. Zeros where the neighbours do not determine a plane.
        """
        normals = np.zeros_like(points)
        for number, pose in enumerate(self.poses):
            rows = np.flatnonzero(self.scanners == number)
            points_sensor = (points[rows] - pose.position) @ pose.rotation
            normals[rows] = estimate_scan_normals(points_sensor) @ pose.rotation.T
        return normals
