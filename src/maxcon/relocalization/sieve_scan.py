# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SieveScan: the points of a scan as large voxels above the ground, at every heading."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.relocalization.facings import facings_of_points
from maxcon.relocalization.regions import REACH
from maxcon.scan import Scan
from maxcon.search.matching import upright

__all__ = ["SieveScan", "Turned"]

# Points lower than this above the scan's ground do not take part, m: what is there may be the ground itself.
LOWEST = 0.4


@dataclass(frozen=True, slots=True)
class Turned:
    """Points at some headings.

    Parameters
    ----------
    layers : array, shape (n,), int64
        Height of each point above the ground, in voxels.
    columns : array, shape (h, n, 2), int32
        (x, y) voxels from the cell in whose middle the scanner stands to that of the point.
    facings : array, shape (h, n), uint8
        Number of the bit that a voxel must have to match the point, see `facings_of_points`.
    """

    layers: NDArray[np.int64]
    columns: NDArray[np.int32]
    facings: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class SieveScan:
    """Points of a scan that take part, levelled and about the scanner, from the ground up.

    Parameters
    ----------
    points : array, shape (n, 3)
        x and y about the scanner, z above the ground, m.
    normals : array, shape (n, 3)
        Same axes.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]

    @classmethod
    def of(cls, scan: Scan, above_ground: Pose, highest: float) -> "SieveScan":
        """Level a scan by its height, roll and pitch above its own ground; points above `highest` (m) are left out.

        Points come from the lowest to the highest, so that what is read of a map lies together.
        """
        levelled = upright(scan, above_ground)
        points = levelled.points
        away = np.hypot(points[:, 0], points[:, 1])
        takes_part = (points[:, 2] >= LOWEST) & (points[:, 2] < highest) & (away < REACH)
        order = np.argsort(points[takes_part, 2], kind="stable")
        return cls(points[takes_part][order], levelled.normals[takes_part][order])

    def __len__(self) -> int:
        return len(self.points)

    def turned(self, headings: NDArray[np.float64], cell: float) -> Turned:
        """Voxels (edge `cell`, m) of the points at headings (h,), rad, of a scanner in the middle of a cell."""
        cosines = np.array([math.cos(heading) for heading in headings.tolist()])[:, None]
        sines = np.array([math.sin(heading) for heading in headings.tolist()])[:, None]
        x, y, z = self.points.T
        turned = np.stack([x * cosines - y * sines, x * sines + y * cosines], axis=2)
        columns = np.floor(turned / cell + 0.5).astype(np.int32)
        layers = np.floor(z / cell).astype(np.int64)
        return Turned(layers, columns, facings_of_points(self.normals, headings))
