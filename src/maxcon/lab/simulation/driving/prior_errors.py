# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of priors: independent from epoch to epoch, uniform within bounds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maxcon.geometry import Pose

__all__ = ["PriorErrors", "off_by"]


def off_by(reference: Pose, errors: Sequence[float]) -> Pose:
    """Return `reference` with errors of x, y, z (m), roll, pitch and heading (rad) added."""
    x, y, z, roll, pitch, heading = errors
    return Pose(
        reference.x + x,
        reference.y + y,
        reference.z + z,
        reference.roll + roll,
        reference.pitch + pitch,
        reference.heading + heading,
    )


@dataclass(frozen=True, slots=True)
class PriorErrors:
    """Bounds of the errors of a prior: each error is uniform within plus and minus its bound.

    offset: of x and of y, m.
    heading_deg: of the heading, degrees.
    z: of the height, m.
    tilt_deg: of roll and of pitch, degrees.
    """

    offset: float = 2.5
    heading_deg: float = 1.8
    z: float = 0.01
    tilt_deg: float = 0.05

    def prior(self, reference: Pose, rng: np.random.Generator) -> Pose:
        """Return a prior: `reference` with errors drawn from `rng`."""
        tilt, turn = math.radians(self.tilt_deg), math.radians(self.heading_deg)
        bounds = np.array([self.offset, self.offset, self.z, tilt, tilt, turn])
        return off_by(reference, (bounds * rng.uniform(-1.0, 1.0, 6)).tolist())
