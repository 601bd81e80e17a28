# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""From the best cell to a continuous pose, and how well that is known."""

from maxcon.refine.adjustment import HEIGHT_SIGMA, TILT_SIGMA, Refined, refine
from maxcon.refine.covariance import covariance, map_covariance
from maxcon.refine.walls import WallShare, least_wall_share

__all__ = [
    "HEIGHT_SIGMA",
    "TILT_SIGMA",
    "Refined",
    "WallShare",
    "covariance",
    "least_wall_share",
    "map_covariance",
    "refine",
]
