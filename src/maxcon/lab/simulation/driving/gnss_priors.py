# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of priors from GNSS and IMU in a street: metres, and nearly the same from one epoch to the next."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.lab.simulation.seed import Seed

__all__ = ["GnssErrors"]


@dataclass(frozen=True, slots=True)
class GnssErrors:
    """First-order Gauss-Markov errors of x, y, z, roll, pitch and heading, reflected at bounds.

    offset, offset_bound: standard deviation of x and y before the reflection (1.17 m after it), and their bound, m:
        multipath between houses, within the paper's search range of 3 m.
    heading_deg, heading_bound_deg: the same for the heading, degrees.
    z, z_bound: the same for the height, m; small, as it is taken for known from the map's ground.
    tilt_deg, tilt_bound_deg: the same for roll and pitch, degrees.
    correlation_time: time after which two errors correlate by 1/e, s.
    """

    offset: float = 1.3
    offset_bound: float = 2.7
    heading_deg: float = 0.6
    heading_bound_deg: float = 1.8
    z: float = 0.015
    z_bound: float = 0.04
    tilt_deg: float = 0.05
    tilt_bound_deg: float = 0.15
    correlation_time: float = 20.0

    def __post_init__(self) -> None:
        if not (min(*self.deviations, self.correlation_time) > 0.0 and (self.bounds >= self.deviations).all()):
            raise OptionError(
                f"Expected standard deviations and a correlation time above 0, and no bound below its deviation,"
                f" got {self}. Leave them out for the defaults."
            )

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviations of x, y, z (m), roll, pitch and heading (rad), shape (6,), before the reflection."""
        tilt, turn = math.radians(self.tilt_deg), math.radians(self.heading_deg)
        return np.array([self.offset, self.offset, self.z, tilt, tilt, turn])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Largest errors of x, y, z (m), roll, pitch and heading (rad), shape (6,)."""
        tilt, turn = math.radians(self.tilt_bound_deg), math.radians(self.heading_bound_deg)
        return np.array([self.offset_bound, self.offset_bound, self.z_bound, tilt, tilt, turn])

    def draw(self, n_times: int, step: float, seed: Seed) -> NDArray[np.float64]:
        """Errors at `n_times` times, `step` (s) apart, shape (n_times, 6), m and rad.

        The same seed and step give the same first errors, whatever `n_times` is.
        """
        rng = np.random.default_rng(seed)
        keeps = math.exp(-step / self.correlation_time)
        fresh = math.sqrt(1.0 - keeps**2)
        errors = np.empty((n_times, 6))
        last = self._bounded(self.deviations * rng.standard_normal(6))
        for row in errors:
            row[:] = last
            last = self._bounded(keeps * last + fresh * self.deviations * rng.standard_normal(6))
        return errors

    def _bounded(self, errors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Reflect errors, shape (6,), at their bounds, as often as it takes."""
        bounds = self.bounds
        return np.asarray(bounds - np.abs((errors + bounds) % (4.0 * bounds) - 2.0 * bounds))
