# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options of the method by the words of the command line, without the imports of what they stand for."""

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxcon.objectives import Objective

__all__ = ["MultiplicityName", "ObjectiveName", "SearchName", "WeightingName"]


class ObjectiveName(StrEnum):
    """Objectives by the names of the command line."""

    HELMERT = "helmert"
    COUNT = "count"
    MAX_EIGENVALUE = "max-eigenvalue"

    @property
    def objective(self) -> "Objective":
        """The objective of that name."""
        from maxcon.objectives import Count, Helmert, MaxEigenvalue

        objectives: dict[ObjectiveName, type[Objective]] = {
            ObjectiveName.HELMERT: Helmert,
            ObjectiveName.COUNT: Count,
            ObjectiveName.MAX_EIGENVALUE: MaxEigenvalue,
        }
        return objectives[self]()


class MultiplicityName(StrEnum):
    """Multiplicities; search.Multiplicity without its imports."""

    OCCUPIED = "occupied"
    POINTS = "points"


class WeightingName(StrEnum):
    """Weightings; search.Weighting without its imports."""

    COSINE = "cosine"
    PUBLISHED = "published"
    ONE = "one"


class SearchName(StrEnum):
    """Ways to find the best cell; search.SearchMethod as words on a command line."""

    EXHAUSTIVE = "exhaustive"
    BRANCH_AND_BOUND = "branch-and-bound"
