# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a search finds, and what it begins with where another has found something already."""

from dataclasses import dataclass, field

from maxcon.objectives import Moments
from maxcon.search.cell_scores import Candidates
from maxcon.search_space import Cell

__all__ = ["Found", "Standing"]


@dataclass(frozen=True, slots=True)
class Found:
    """The best cell of a search space, and what was proved of the others.

    Parameters
    ----------
    cell : tuple of 3 int
        (heading, y, x) of the best cell, the first in index order at ties (D8).
    score : float
        Its score.
    moments : array, shape (4,)
        Its count, Nxx, Nxy and Nyy.
    bound : float
        Proved: no cell scores higher. It is the score, since the search does not end before.
    rest : float
        Proved: no cell farther than the guard radius from the guarded one, at any heading, scores higher. It is the
        score of the runner-up if that reaches the asked share of the best score; otherwise it lies between the two.
    n_scored : int
        Cells whose moments were computed, a few of them twice; all others were only bounded.
    height : int
        Number of the height of the best cell, see `SearchSpace.raised`; at others nothing is proved of the rest.
    reaching : Candidates
        If asked for: every cell that reaches the asked share of the best score, at the height of the best cell, and
        what it scores. A few may be there twice.
    """

    cell: Cell
    score: float
    moments: Moments
    bound: float
    rest: float
    n_scored: int
    height: int = 0
    reaching: Candidates = field(default_factory=Candidates.none)


@dataclass(frozen=True, slots=True)
class Standing:
    """Score and moments of the best cell of other heights: only cells that score as much are looked for."""

    score: float
    moments: Moments
