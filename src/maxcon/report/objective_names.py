# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What an objective and its scores are called in a picture."""

from typing import NamedTuple

from maxcon.objectives import Count, Helmert, MaxEigenvalue, Objective

__all__ = ["ObjectiveName", "objective_name"]


class ObjectiveName(NamedTuple):
    """The words for an objective.

    Parameters
    ----------
    name : str
        The objective.
    unit : str
        What its scores are measured in.
    """

    name: str
    unit: str

    @property
    def label(self) -> str:
        """Name and unit, for a colour bar."""
        return f"{self.name} [{self.unit}]"


_NAMES: dict[type, ObjectiveName] = {
    Count: ObjectiveName("Count", "matches"),
    Helmert: ObjectiveName("Helmert's score", "1/tr Q"),
    MaxEigenvalue: ObjectiveName("Smallest eigenvalue of N", "1/max λ of Q"),
}


def objective_name(objective: Objective) -> ObjectiveName:
    """Return the words for an objective; for a user's own, the name of its class."""
    return _NAMES.get(type(objective), ObjectiveName(type(objective).__name__, "score"))
