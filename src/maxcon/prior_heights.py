# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether the heights of a prior fit the ground of the map: those of receivers and of surveys often differ."""

import numpy as np

from maxcon.errors import TrajectoryError
from maxcon.point_map import PointMap
from maxcon.trajectory import Trajectory

__all__ = ["check_heights"]

LOWEST, HIGHEST = -5.0, 12.0
"""A sensor on a vehicle, and the errors of its receiver, lie between these above the ground, m."""
REACH, N_POSES = 5.0, 50


def check_heights(point_map: PointMap, prior: Trajectory, *, are_orthometric: bool = False) -> None:
    """Refuse heights of a prior, taken as they are, that lie far above or below the map's ground.

    Parameters
    ----------
    point_map : PointMap
        The map; without ground there is nothing to tell.
    prior : Trajectory
        T_map_sensor, global coordinates.
    are_orthometric : bool
        Whether its heights are above the geoid; else they are ellipsoidal.

    Raises
    ------
    TrajectoryError
        If the median of some poses inside the map does.
    """
    local = point_map.frame.to_local(prior.positions)
    above = []
    for x, y, z in local[:: max(1, len(local) // N_POSES)].tolist():
        if point_map.covers(x, y, REACH):
            heights = point_map.ground_around(x, y, REACH).heights
            known = heights[np.isfinite(heights)]
            if len(known):
                above.append(z - float(np.median(known)))
    if not above or LOWEST <= np.median(above) <= HIGHEST:
        return
    median = float(np.median(above))
    if are_orthometric:
        raise TrajectoryError(
            f"Expected the prior near the map's ground, got heights above the geoid {abs(median):.1f} m"
            f" {'above' if median > 0 else 'below'} it. Are the map's heights ellipsoidal? Then give the prior"
            " ellipsoidal heights too."
        )
    raise TrajectoryError(
        f"Expected the prior near the map's ground, got ellipsoidal heights of the receiver {abs(median):.1f} m"
        f" {'above' if median > 0 else 'below'} it. Are the map's heights above the geoid? Say how high that is above"
        f" the ellipsoid there: --geoid-height, about {median - 2.0:.0f} here."
    )
