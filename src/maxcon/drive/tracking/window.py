# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a scan measures, how well, and in which window around a prediction it may be found."""

import math

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.tracking.uncertain_pose import PLANAR, UncertainPose
from maxcon.estimate import Estimate
from maxcon.search.space import PAPER_CELL, SearchSpace

__all__ = ["FARTHEST_REACH", "HEIGHTS_AND_TILTS", "HEIGHT_SIGMA", "TILT_SIGMA", "measured_covariance", "window"]

# Of an estimate without a covariance: a cell's and a heading step's own, and what the map and the scan add, m and rad.
MAP_SIGMA, MAP_HEADING_SIGMA = 0.02, math.radians(0.1)
# What a prior's height, roll and pitch are held to be worth, m and rad: the search takes them as they come.
HEIGHT_SIGMA, TILT_SIGMA = 0.1, math.radians(0.3)
HEIGHTS_AND_TILTS = np.diag([np.inf, np.inf, HEIGHT_SIGMA**2, TILT_SIGMA**2, TILT_SIGMA**2, np.inf])
"""Covariance of a prior as a measurement of height, roll and pitch alone, shape (6, 6)."""
# A window of a larger half width (m) is not searched: only a prior helps then. Turns are not searched beyond.
FARTHEST_REACH, LARGEST_TURN_DEG = 12.0, 10.0


def window(predicted: UncertainPose, sigmas: float, space: SearchSpace) -> SearchSpace:
    """Return where a scan may measure a predicted pose to be: cells and steps are those of `space`.

    Parameters
    ----------
    predicted : UncertainPose
        In the middle of the window.
    sigmas : float
        Half widths in standard deviations of the innovation, which is the prediction's error and the measurement's.
    space : SearchSpace
        The wide one.

    Notes
    -----
    A half width beyond `FARTHEST_REACH` only says so: it is cut at twice that.
    """
    return SearchSpace.from_covariance(
        predicted.planar_covariance + np.diag(_cell_variances(space)[PLANAR]),
        k=sigmas,
        cell=space.cell,
        heading_step_deg=space.heading_step_deg,
        largest_half_width=2.0 * FARTHEST_REACH,
        largest_heading_half_width_deg=max(LARGEST_TURN_DEG, space.heading_half_width_deg),
    )


def measured_covariance(estimate: Estimate, space: SearchSpace) -> NDArray[np.float64]:
    """Covariance of an estimate as a measurement, shape (6, 6): its own, or a best cell's where it has none.

    A best cell measures x, y and heading: within the cell and the step any value is as likely (edge / sqrt(12)), and
    map and scan add 2 cm and 0.1 degrees.
    """
    is_known = np.isfinite(np.diag(estimate.covariance)[PLANAR]).all()
    return estimate.covariance if is_known else np.diag(_cell_variances(space))


def _cell_variances(space: SearchSpace) -> NDArray[np.float64]:
    space = space.at(PAPER_CELL)
    cell = space.cell_edge**2 / 12.0 + MAP_SIGMA**2
    step = math.radians(space.step_deg) ** 2 / 12.0 + MAP_HEADING_SIGMA**2
    return np.array([cell, cell, np.inf, np.inf, np.inf, step])
