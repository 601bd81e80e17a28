# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a search is to find, the incumbent that it begins with, and what it finds."""

from dataclasses import dataclass, field

from maxcon.search.cells import Candidates
from maxcon.search.objectives import Moments, Objective
from maxcon.search.space import Cell

__all__ = ["Found", "Standing", "Wanted"]


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
        Proved: no cell scores higher. It is the score, or that of the incumbent, if that is higher.
    rest : float
        Proved: no cell farther than the guard radius from the guarded one, at any heading, scores higher. It is the
        score of the runner-up if that reaches the asked share of the best score; otherwise at least that of the
        runner-up, and below that share.
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
    """What a search has to reach: the best cell of another height or place, or a share of its score.

    Parameters
    ----------
    score : float
        The least score of interest; no cell need have it.
    moments : array, shape (4,)
        Moments of that best cell: they give the axis to bound along.
    """

    score: float
    moments: Moments


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a search is to find; see `branch_and_bound`, whose parameters these are.

    Parameters
    ----------
    objective : Objective
        What a cell is worth.
    share : float
        Cells are looked for that reach this share of the best score; or of the guarded cell's, if there is one.
    guard_radius : float
        The runner-up lies farther than this from the guarded cell, or else from the best, m.
    guarded : tuple of 3 int, optional
        A cell.
    lists_all : bool
        Whether all cells that reach the share are found, not only the best and the runner-up.
    standing : Standing, optional
        What a cell must score at least.
    """

    objective: Objective
    share: float = 1.0
    guard_radius: float = 0.3
    guarded: Cell | None = None
    lists_all: bool = False
    standing: Standing | None = None
