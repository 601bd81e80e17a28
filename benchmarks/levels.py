# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Levels of a prior's error, as they are named on command lines."""

import math

from maxcon.errors import OptionError
from maxcon.lab.study.prior_trials import prior_level

LEVELS = tuple(
    prior_level(*level) for level in ((1.0, 1.0), (3.0, 2.0), (6.0, 5.0), (12.0, 10.0), (18.0, 15.0), (25.0, 20.0))
)
"""From a good satellite fix to one between high houses, and a heading that was kept by dead reckoning."""


def parse_level(word):
    """Return the level of a word such as 12:10, metres and degrees."""
    try:
        offset, heading_deg = (float(number) for number in word.split(":"))
    except ValueError:
        offset, heading_deg = math.nan, math.nan
    if not (0.0 < offset < math.inf and 0.0 < heading_deg <= 180.0):
        raise OptionError(
            f"Expected a level as METRES:DEGREES, both above 0, of at most 180 degrees, got {word!r}."
            " Write 12:10 for 12 m and 10 degrees."
        )
    return prior_level(offset, heading_deg)
