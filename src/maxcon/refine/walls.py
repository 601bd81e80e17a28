# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How many of the wall points of a scan lie on walls of the map at a refined pose, facing by facing."""

import math
from dataclasses import dataclass

import numpy as np

from maxcon.refine.adjustment import Refined

__all__ = ["WallShare", "least_wall_share"]

# A wall point has a normal with a vertical part below LEVEL; it is found if a plane of the map lies within this, m.
LEVEL = 0.5
FOUND_WITHIN = 0.08
N_FACINGS = 6
FEWEST_POINTS = 20
# Added to the numbers of found and of all points: 2 of 20 are less certain than 20 of 200.
FOUND_BEFORE, ALL_BEFORE = 2, 4


@dataclass(frozen=True, slots=True)
class WallShare:
    """Of the wall points of one facing, how many lie on walls of the map.

    Parameters
    ----------
    azimuth : float
        Middle of the facing, rad from +x, 0 to pi: both sides of a wall are one facing.
    n_points, n_found : int
        Wall points of the facing, and those within 8 cm of a wall of the map.
    """

    azimuth: float
    n_points: int
    n_found: int

    @property
    def share(self) -> float:
        """Found over all, 0 to 1, drawn to a half where there are few."""
        return (self.n_found + FOUND_BEFORE) / (self.n_points + ALL_BEFORE)

    @property
    def words(self) -> str:
        """The share as part of a sentence for a reader."""
        facing = f"{math.degrees(self.azimuth):.0f} degrees from +x (of 180)"
        return f"of {self.n_points} wall points facing {facing} {self.n_found} lie on the map"


def least_wall_share(refined: Refined) -> WallShare | None:
    """The lowest share over six facings of 30 degrees each; None where no facing has 20 wall points.

    At a wrong place along a street the walls along it fit all the same; those across do not.
    """
    from maxcon.refine import group_kernels

    n_points, n_found = np.zeros(N_FACINGS, np.int64), np.zeros(N_FACINGS, np.int64)
    group_kernels.count_walls(
        refined.normals, refined.residuals, refined.pose.rotation, LEVEL, FOUND_WITHIN, n_points, n_found
    )
    shares = [
        WallShare((k + 0.5) * math.pi / N_FACINGS, int(n_points[k]), int(n_found[k]))
        for k in range(N_FACINGS)
        if n_points[k] >= FEWEST_POINTS
    ]
    return min(shares, key=lambda each: each.share, default=None)
