# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which search space the options of `maxcon localize` mean: fixed half widths, or the prior's standard deviations."""

import math
from typing import TYPE_CHECKING

from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.search_space import SearchSpace

__all__ = ["chosen_space"]

SIGMAS = 3.0


def chosen_space(
    cell: float | None,
    heading_step_deg: float | None,
    *,
    half_width: float | None,
    heading_half_width_deg: float | None,
    sigma_position: float | None,
    sigma_heading_deg: float | None,
    sigmas: float | None,
    height_half_width: float | None = None,
) -> "SearchSpace":
    """Return the space of the half widths (m, degrees), or of so many standard deviations; None for not given.

    The half width in height, m, goes with either.

    Raises
    ------
    OptionError
        If both are given, or one standard deviation without the other, or a negative one.
    SearchSpaceError
        If there is no such space.
    """
    from dataclasses import replace

    from maxcon.search_space import SearchSpace

    height = 0.0 if height_half_width is None else height_half_width
    if sigma_position is None and sigma_heading_deg is None and sigmas is None:
        usual = SearchSpace()
        return SearchSpace(
            usual.half_width if half_width is None else half_width,
            cell,
            usual.heading_half_width_deg if heading_half_width_deg is None else heading_half_width_deg,
            heading_step_deg,
            height,
        )
    if half_width is not None or heading_half_width_deg is not None:
        fixed = "--half-width" if half_width is not None else "--heading-half-width-deg"
        raise OptionError(
            f"Expected either half widths or standard deviations of the prior, got {fixed} beside them."
            " Leave one kind out."
        )
    if sigma_position is None or sigma_heading_deg is None:
        missing = "--sigma-position" if sigma_position is None else "--sigma-heading-deg"
        raise OptionError(
            f"Expected --sigma-position and --sigma-heading-deg together, got no {missing}. Give it, 0 if it is exact."
        )
    for name, value in (("--sigma-position", sigma_position), ("--sigma-heading-deg", sigma_heading_deg)):
        if not 0.0 <= value < math.inf:
            raise OptionError(f"Expected {name} to be a standard deviation >= 0, got {value}.")
    k = SIGMAS if sigmas is None else sigmas
    if not 0.0 < k < math.inf:
        raise OptionError(f"Expected --sigmas > 0, got {k}. Left out it is 3.")
    sigma_heading = math.radians(sigma_heading_deg)
    variance, heading_variance = sigma_position * sigma_position, sigma_heading * sigma_heading
    covariance = [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, heading_variance]]
    plane = SearchSpace.from_covariance(covariance, k=k, cell=cell, heading_step_deg=heading_step_deg)
    return replace(plane, height_half_width=height)
