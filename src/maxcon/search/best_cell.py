# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The best cell of a search, with what was found of the second best."""

from dataclasses import dataclass

from maxcon.geometry import Pose
from maxcon.search.objectives import Moments
from maxcon.search.space import Cell, SearchSpace

__all__ = ["BestCell"]


@dataclass(frozen=True, slots=True)
class BestCell:
    """What a search found: its best cell with score and moments, and Helmert's score of the runner-up over its own.

    The space is of one height, around the prior raised to it. Whether the cell lies at the rim of what is searched is
    told by whoever looked beyond; None where the space is all that is.
    """

    space: SearchSpace
    prior: Pose
    cell: Cell
    score: float
    moments: Moments
    runner_up: float
    is_at_rim: bool | None = None

    @property
    def pose(self) -> Pose:
        """T_map_sensor of the cell, local frame."""
        return self.space.pose(self.cell, self.prior)
