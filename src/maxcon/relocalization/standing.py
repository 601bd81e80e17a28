# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The full pose of a scanner at a place and heading: its height and tilt above its own ground, put on the map's."""

import math

import numpy as np

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.refine.ground.levelling import laid

__all__ = ["standing_on"]

# The slope is that of the ground so far around, m, if it is known in so many cells.
AROUND = 8.0
FEWEST_CELLS = 20


def standing_on(point_map: PointMap, x: float, y: float, heading: float, above_ground: Pose) -> Pose:
    """Return T_map_sensor of a scanner at a place and heading.

    Parameters
    ----------
    point_map : PointMap
        With ground around.
    x, y : float
        The place, local frame, m.
    heading : float
        rad.
    above_ground : Pose
        Height, roll and pitch of the scanner above its own ground.
    """
    pose = Pose(x, y, above_ground.z, above_ground.roll, above_ground.pitch, heading)
    patch = point_map.ground_around(x, y, AROUND)
    rows, columns = np.nonzero(np.isfinite(patch.heights[0]))
    if len(rows) == 0:
        return pose
    heights = patch.heights[0][rows, columns].astype(np.float64)
    if len(rows) < FEWEST_CELLS:
        return laid(pose, float(np.median(heights)), 0.0, 0.0)
    east = (patch.first[0] + columns + 0.5) * patch.edge - x
    north = (patch.first[1] + rows + 0.5) * patch.edge - y
    sides = np.column_stack([np.ones(len(rows)), east, north])
    (height, slope_x, slope_y), *_ = np.linalg.lstsq(sides, heights, rcond=None)
    cosine, sine = math.cos(heading), math.sin(heading)
    along, across = slope_x * cosine + slope_y * sine, slope_y * cosine - slope_x * sine
    return laid(pose, float(height), float(along), float(across))
