# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Place: the part of the map a scan can meet."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose

__all__ = ["Place"]

SQUARE = 20.0
"""Edge of the squares of the ground whose sensors share a place, m."""
REACH_STEP = 20.0
"""Reaches are rounded up to multiples of this, so that scans of nearly the same range share a place, m."""
DRIFT = 5.0
"""How far an iteration may carry the sensor before the scan's farthest points leave the place, m."""


@dataclass(frozen=True, slots=True)
class Place:
    """A square of the ground and all that a sensor inside it reaches.

    It follows from the start and the scan alone, so that an answer does not depend on what was localized
    before.

    column, row: index of the square, floor(coordinate / 20 m), local frame.
    reach: m.
    """

    column: int
    row: int
    reach: float

    @classmethod
    def of_scan(cls, points_sensor: NDArray[np.float64], around: Pose, gate: float, spread: float) -> "Place":
        """Place of a scan: its range, a correspondence gate and a spread of starts (m) beyond `around`."""
        largest_range = float(np.linalg.norm(points_sensor, axis=1).max(initial=0.0))
        reach = REACH_STEP * math.ceil((largest_range + gate + spread + DRIFT) / REACH_STEP)
        return cls(math.floor(around.x / SQUARE), math.floor(around.y / SQUARE), reach)

    @property
    def middle(self) -> tuple[float, float]:
        """Where the middle of the square lies in x and y, local frame, m."""
        return (self.column + 0.5) * SQUARE, (self.row + 0.5) * SQUARE

    @property
    def half_width(self) -> float:
        """From the middle to the edge of the square that holds all within reach, m."""
        return 0.5 * SQUARE + self.reach

    def reaches(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a sensor in the square reaches each point, shape (n, 3), local frame, m."""
        beyond = np.maximum(np.abs(points[:, :2] - self.middle) - 0.5 * SQUARE, 0.0)
        return np.asarray(np.hypot(beyond[:, 0], beyond[:, 1]) <= self.reach)
