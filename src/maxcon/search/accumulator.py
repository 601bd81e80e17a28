# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Accumulator: the moments of every cell of a search space (D5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.geometry import Pose
from maxcon.search.objectives import Moments, Objective, Scores, checked_scores
from maxcon.search.space import Cell, SearchSpace

__all__ = ["Accumulator", "highest"]


@dataclass(frozen=True, slots=True)
class Accumulator:
    """What one pass over all matches leaves: every objective is a function of it.

    Parameters
    ----------
    moments : array, shape (headings, ny, nx, 4)
        Count, Nxx, Nxy and Nyy of each cell (equation (4)).
    space : SearchSpace
        The cells.
    prior : Pose
        The pose the cells lie around, local frame.
    """

    moments: Moments
    space: SearchSpace
    prior: Pose

    def __post_init__(self) -> None:
        expected = (*self.space.shape, 4)
        if self.moments.shape != expected:
            raise ArrayError(f"Expected `moments` to have shape {expected}, got {self.moments.shape}.")

    def score(self, objective: Objective) -> Scores:
        """Scores of all cells, shape (headings, ny, nx).

        Raises
        ------
        ArrayError
            If the objective returns scores of another shape, or NaN.
        """
        return checked_scores(objective.score(self.moments), self.space.shape)

    def best_cell(self, objective: Objective) -> Cell:
        """Return the cell with the highest score; the first in index order at ties (D8).

        Raises
        ------
        ArrayError
            If the objective returns scores of another shape, or NaN.
        """
        return highest(self.score(objective))

    def normal_matrix(self, cell: Cell) -> NDArray[np.float64]:
        """N of one cell, shape (2, 2)."""
        _, nxx, nxy, nyy = self.moments[cell].astype(np.float64)
        return np.array([[nxx, nxy], [nxy, nyy]])


def highest(scores: Scores) -> Cell:
    """Return the cell with the highest of the scores of all cells, the first in index order at ties (D8)."""
    return cast(Cell, tuple(int(index) for index in np.unravel_index(int(np.argmax(scores)), scores.shape)))
