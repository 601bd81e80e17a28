# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Seed: what everything drawn at random is drawn from."""

from collections.abc import Sequence

__all__ = ["Seed"]

Seed = int | Sequence[int]
"""A seed as numpy.random.default_rng takes it; the same seed draws the same."""
