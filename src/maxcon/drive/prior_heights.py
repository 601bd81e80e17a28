# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether the heights of a prior fit the ground of the map: those of receivers and of surveys often differ."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import TrajectoryError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan.trajectory import Trajectory

__all__ = ["check_heights", "heights_in_words"]

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
    median = _above_ground(point_map, point_map.frame.to_local(prior.positions))
    if LOWEST <= median <= HIGHEST:
        return
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


def heights_in_words(point_map: PointMap, priors: Sequence[Pose]) -> str:
    """Return what may be wrong with the heights of priors, local frame; empty if they are near the map's ground."""
    median = _above_ground(point_map, np.array([prior.position for prior in priors]).reshape(-1, 3))
    if LOWEST <= median <= HIGHEST:
        return ""
    side, kinds = ("below", "above the geoid, and the map's above the ellipsoid")
    if median > 0.0:
        side, kinds = ("above", "above the ellipsoid, and the map's above the geoid")
    return (
        f"the prior lies {abs(median):.1f} m {side} the map's ground. Are its heights {kinds}? Take about"
        f" {median - 2.0:.0f} m off its z"
    )


def _above_ground(point_map: PointMap, positions: NDArray[np.float64]) -> float:
    """Median height above the map's ground of some of the positions (local frame), m; 0 where no ground is known."""
    above = []
    for x, y, z in positions[:: max(1, len(positions) // N_POSES)].tolist():
        if point_map.covers(x, y, REACH):
            heights = point_map.ground_around(x, y, REACH).heights
            known = heights[np.isfinite(heights)]
            if len(known):
                above.append(z - float(np.median(known)))
    return float(np.median(above)) if above else 0.0
