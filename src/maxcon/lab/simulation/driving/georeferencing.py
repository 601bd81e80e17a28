# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of a mapping vehicle's trajectory after post-processing: centimetres, slowly changing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.lab.simulation.seed import Seed

__all__ = ["GeoreferencingErrors", "draw_georeferencing_errors"]

DEVIATION = 0.02
"""Standard deviation per axis, m."""
CORRELATION_TIME = 30.0
"""s; two errors this far apart in time correlate by exp(-1/4), and a round apart not at all."""


@dataclass(frozen=True, slots=True, eq=False)
class GeoreferencingErrors:
    """Errors of a trajectory, and so of the points that were placed by it, over time.

    times: shape (k,); s, rising.
    offsets: shape (k, 3); what is added to true positions, m.
    """

    times: NDArray[np.float64]
    offsets: NDArray[np.float64]

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Errors at `times` (s), shape (n, 3), m."""
        wanted = np.asarray(times, dtype=np.float64)
        return np.stack([np.interp(wanted, self.times, column) for column in self.offsets.T], axis=1)


def draw_georeferencing_errors(
    seed: Seed, start: float, end: float, deviation: float = DEVIATION
) -> GeoreferencingErrors:
    """Return errors from `start` to `end` (s): a smooth stationary process per axis.

    seed: the same seed gives the same errors.
    start, end: first and last time, s.
    deviation: standard deviation per axis, m.

    White noise, one value per second, smoothed by a Gaussian. Errors dt apart correlate by
    exp(-dt^2 / (4 CORRELATION_TIME^2)): by less than 0.001 after 160 s, and a round takes longer.
    """
    rng = np.random.default_rng(seed)
    reach = round(4.0 * CORRELATION_TIME)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / CORRELATION_TIME) ** 2)
    weights *= deviation / np.linalg.norm(weights)
    times = np.arange(np.floor(start), np.ceil(end) + 1.0)
    noise = rng.standard_normal((3, len(times) + 2 * reach))
    offsets = np.stack([np.convolve(row, weights, mode="valid") for row in noise], axis=1)
    return GeoreferencingErrors(times, offsets)
