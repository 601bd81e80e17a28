# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of sparse scans, turned to the sensor.

A ring scanner's points lie 0.2 degrees apart along a ring and 2 degrees apart across: the nearest neighbours
of a point are all on its own ring, and say nothing of the surface. So neighbours are taken by angle, from a
window around the point that grows until more than one ring is in it, wherever the next rings are: they may be
evenly spaced or not, smeared by the motion of the sensor, thinned, or missing.
"""

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.arrays import as_points

__all__ = ["estimate_scan_normals"]


def estimate_scan_normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of a scan's points, turned to the sensor.

    Parameters
    ----------
    points : array, shape (n, 3)
        Sensor frame, m, in any order; the sensor is at (0, 0, 0).

    Returns
    -------
    array, shape (n, 3)
        Sensor frame; zeros where the neighbours are too few, lie on one ring or on no plane (bushes, edges). Points
        of the ground mostly have none: seen at a flat angle, its rings lie too far apart.

    Raises
    ------
    ArrayError
        If the shape is not (n, 3) or a coordinate is not finite.

    Notes
    -----
    Windows reach at most 6.9 degrees above and below a point, rounded up to whole cells of a grid: neighbours lie
    at most 10.5 degrees above or below it. Points nearer than 1.25 m have no normals: 15 cm are more than 6.9
    degrees there. The same points in another order have the same normals, to the last bit.
    """
    from maxcon.scan.normals.angle_kernels import azimuths_of, elevations_of, extremes
    from maxcon.scan.normals.scan_kernels import scan_planes

    points = np.ascontiguousarray(as_points(points, "points"))
    normals = np.empty_like(points)
    if len(points) == 0:
        return normals
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    lowest, highest = extremes(elevations)
    scan_planes(points, elevations, azimuths, lowest, highest, normals)
    return normals
