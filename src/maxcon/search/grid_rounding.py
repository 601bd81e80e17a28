# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Half widths in whole steps."""

import math
from functools import lru_cache

from maxcon.errors import SearchSpaceError

__all__ = ["n_steps", "rounded_up"]

# Enough for 6 km at 6 cm; it keeps every number of cells finite.
MOST_STEPS = 100_000


@lru_cache(maxsize=4096)
def n_steps(half_width: float, step: float, what: str, unit: str) -> int:
    """How many steps make the half width, which must be a whole number."""
    if not (math.isfinite(half_width) and math.isfinite(step) and step > 0.0 and half_width >= 0.0):
        raise SearchSpaceError(
            f"Expected a half width >= 0 and a step > 0 for the {what}, got {half_width} {unit} and {step} {unit}."
            " The defaults are 3 m by 0.06 m and 2 degrees by 0.5 degrees."
        )
    steps = half_width / step
    if steps > MOST_STEPS:
        raise SearchSpaceError(
            f"Expected at most {MOST_STEPS:,} cells in the half width of the {what}, got {half_width:g} {unit} by"
            f" {step:g} {unit}. Narrow the search space, or take larger steps."
        )
    n_steps = round(steps)
    if abs(steps - n_steps) > 1e-6 * max(1.0, steps):
        raise SearchSpaceError(
            f"Expected the half width of the {what} to be a multiple of its step, got {half_width} {unit} and"
            f" {step} {unit}. Take {math.ceil(steps) * step:g} {unit}?"
        )
    return n_steps


def rounded_up(reach: float, step: float | None, largest: float | None = None, rim: float = 0.0) -> float:
    """Return the whole steps that hold `reach` and `rim` steps more, but no more than fit into `largest`.

    Without a step, what is reached is not rounded, and cut to `largest`.
    """
    if step is None:
        return min(reach, math.inf if largest is None else largest)
    steps = reach / step + rim if reach > 0.0 else 0.0
    most = math.inf if largest is None else largest / step
    if min(steps, most) > MOST_STEPS:
        return min(reach, largest or math.inf)  # refused, in the words for any half width
    whole = math.ceil(steps - 1e-9 * max(1.0, steps))
    if most < whole:
        whole = math.floor(most + 1e-6)
    return whole * step
