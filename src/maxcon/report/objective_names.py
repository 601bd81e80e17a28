# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What an objective and its scores are called in a picture."""

from maxcon.objectives import Objective

__all__ = ["title_of", "unit_of"]


def title_of(objective: Objective) -> str:
    """Return its title; for a user's own without one, the name of its class."""
    return str(getattr(objective, "title", type(objective).__name__))


def unit_of(objective: Objective) -> str:
    """Return what its scores are measured in; scores, where it does not say."""
    return str(getattr(objective, "unit", "score"))
