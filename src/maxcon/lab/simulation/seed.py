# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Seed: what everything drawn at random is drawn from."""

from collections.abc import Sequence

from maxcon.errors import OptionError

__all__ = ["Seed", "check_seed"]

Seed = int | Sequence[int]
"""A seed as numpy.random.default_rng takes it; the same seed draws the same."""


def check_seed(seed: int) -> None:
    """Check the seed of a world, from which all its streams begin."""
    if seed < 0:
        raise OptionError(f"Expected a seed of 0 or more, got {seed}. Take another whole number.")
