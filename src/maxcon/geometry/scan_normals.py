# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of sparse ring scans, turned to the sensor.

A ring scanner's points lie 0.2 degrees apart along a ring and 2 degrees apart across: the nearest neighbours
of a point are all on its own ring, and say nothing of the surface. So neighbours are taken by angle, from
the point's ring and the rings above and below.
"""

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.arrays import as_points

__all__ = ["RingLayout", "estimate_scan_normals", "ring_layout"]

HISTOGRAM_STEP = np.radians(0.2)
LEAST_POINTS = 64
DENSE_SPACING = np.radians(0.6)
LARGEST_SPACING = np.radians(4.0)


class RingLayout:
    """How far apart the points of a scan lie, as seen from the sensor.

    Attributes
    ----------
    ring_spacing : float
        Between rings, rad; 0.6 degrees where rings cannot be told apart.
    point_spacing : float
        Between neighbours on a ring, in the mean over the scan, rad.
    """

    def __init__(self, ring_spacing: float, point_spacing: float) -> None:
        self.ring_spacing = ring_spacing
        self.point_spacing = point_spacing

    def __repr__(self) -> str:
        return f"RingLayout({self.ring_spacing!r}, {self.point_spacing!r})"


def ring_layout(elevations: NDArray[np.float64]) -> RingLayout:
    """Layout of a scan from the elevations (rad) of its points, by counting the peaks of their histogram."""
    if len(elevations) < LEAST_POINTS:
        return RingLayout(np.radians(2.0), np.radians(2.0))
    from maxcon.geometry.angle_kernels import count_in_bins, quantiles

    low, high = quantiles(elevations, np.array([0.005, 0.995]))
    if high == low:
        return RingLayout(float(DENSE_SPACING), 2.0 * np.pi / len(elevations))
    bins = max(1, int((high - low) / HISTOGRAM_STEP))
    histogram = count_in_bins(elevations, np.linspace(low, high, bins + 1)).astype(np.float64)
    (high_count,) = quantiles(histogram, np.array([0.98]))
    is_peak = histogram > 0.2 * high_count
    n_rings = int(np.count_nonzero(np.diff(is_peak.astype(np.int8), prepend=0) == 1))
    is_continuous = n_rings < 4 or is_peak.mean() > 0.7
    spacing = DENSE_SPACING if is_continuous else (high - low) / (n_rings - 1)
    spacing = float(np.clip(spacing, DENSE_SPACING, LARGEST_SPACING))
    rows = max(1.0, (high - low) / spacing)
    return RingLayout(spacing, float(2.0 * np.pi * rows / len(elevations)))


def estimate_scan_normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of a scan's points, turned to the sensor.

    Parameters
    ----------
    points : array, shape (n, 3)
        Sensor frame, m, in any order; the sensor is at (0, 0, 0).

    Returns
    -------
    array, shape (n, 3)
        Sensor frame; zeros where the neighbours are too few, lie on a line or on no plane (bushes, edges).

    Raises
    ------
    ArrayError
        If the shape is not (n, 3) or a coordinate is not finite.
    """
    from maxcon.geometry.angle_kernels import azimuths_of, elevations_of, extremes
    from maxcon.geometry.scan_kernels import ring_normals

    points = np.ascontiguousarray(as_points(points, "points"))
    normals = np.empty_like(points)
    if len(points) == 0:
        return normals
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    lowest, highest = extremes(elevations)
    layout = ring_layout(elevations)
    ring_normals(
        points, elevations, azimuths, lowest, highest, layout.ring_spacing, layout.point_spacing, normals
    )
    return normals
