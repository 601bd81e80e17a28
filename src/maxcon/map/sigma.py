# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a map is known."""

import math

from maxcon.errors import ArrayError

__all__ = ["UNKNOWN_SIGMA", "check_sigma"]

UNKNOWN_SIGMA = 0.02
"""Of a map of which it is not known, m: what a mapping vehicle's trajectory is usually good to."""


def check_sigma(sigma: float) -> None:
    """Refuse a standard deviation of a map's position (m) that is none.

    Raises
    ------
    ArrayError
        If it is negative or not finite.
    """
    if not 0.0 <= sigma < math.inf:
        raise ArrayError(f"Expected `sigma` of the map >= 0 m, got {sigma}. Leave it out if you do not know it.")
