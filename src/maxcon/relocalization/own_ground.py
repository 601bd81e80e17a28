# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How a scanner stands above the ground of its own scan: height, roll and pitch without any map."""

import numpy as np

from maxcon.geometry import Pose
from maxcon.refine.ground.levelling import CELL, FARTHEST, FEWEST_CELLS, NEAREST, THICKNESS, fit_plane, laid
from maxcon.scan import Scan

__all__ = ["above_own_ground"]

HIGHEST = 5.0
"""Scanners stand up to so high above the ground, m."""


def above_own_ground(scan: Scan) -> Pose | None:
    """Find the plane that most of the lowest points around a scanner lie on.

    Parameters
    ----------
    scan : Scan
        Sensor frame; z within some degrees of up.

    Returns
    -------
    Pose or None
        T_ground_sensor: its z is the scanner's height above the plane, its roll and pitch lay the plane level; x, y and
        heading are 0. None where too few cells of half a metre have points.
    """
    from maxcon.refine.ground import kernels

    points = kernels.lowest_of_cells(scan.points, np.eye(3), CELL, NEAREST, FARTHEST, THICKNESS)
    if len(points) < FEWEST_CELLS:
        return None
    below = np.ascontiguousarray(-points[:, 2])
    plane, _ = fit_plane(points, below, HIGHEST)
    return laid(Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), *plane.tolist())
