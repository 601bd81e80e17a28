# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Axes along which N is summed, to bound it."""

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["N_AXES", "Axis"]

# The nearest of 64 axes is at most 1.4 degrees off, which hardly loosens a bound: (sin 1.4 deg)^2 is 0.0006.
N_AXES = 64


@dataclass(frozen=True, slots=True)
class Axis:
    """One of the N_AXES horizontal directions along which the matches of a cell are summed.

    Parameters
    ----------
    number : int
        Its azimuth in steps of pi / N_AXES, from 0 to N_AXES - 1.
    """

    number: int

    @classmethod
    def near(cls, azimuth: float) -> "Axis":
        """Return the axis nearest to an azimuth, rad."""
        return cls(round(azimuth / math.pi * N_AXES) % N_AXES)

    @property
    def across(self) -> "Axis":
        """The axis at right angles."""
        return Axis((self.number + N_AXES // 2) % N_AXES)

    @property
    def vector(self) -> tuple[np.float32, np.float32]:
        """Unit vector (x, y)."""
        azimuth = self.number * math.pi / N_AXES
        return np.float32(math.cos(azimuth)), np.float32(math.sin(azimuth))
