# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What an objective and its scores are called in a picture."""

from maxcon.search.objectives import Objective

__all__ = ["title_of", "unit_of"]


def title_of(objective: Objective) -> str:
    """Return the title of an objective, or the name of its class if a user's own has none."""
    return str(getattr(objective, "title", type(objective).__name__))


def unit_of(objective: Objective) -> str:
    """Return the unit of an objective's scores, or "score" if it states none."""
    return str(getattr(objective, "unit", "score"))
