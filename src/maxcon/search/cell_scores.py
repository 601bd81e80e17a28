# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Cells that may be the best, and the scores of those that were looked at."""

import math
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import BoundedByCount, Moments, Objective, Scores
from maxcon.search.bounds import Bounds, HeadingPass
from maxcon.search_space import Cell

__all__ = ["Candidates", "CellScores"]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Cells that may be looked for, shape (n, 3), and what they score at most, (n,)."""

    cells: NDArray[np.int64]
    upper: Scores

    @classmethod
    def none(cls) -> "Candidates":
        """No cell."""
        return cls(np.empty((0, 3), np.int64), np.empty(0))

    def joined(self, other: "Candidates") -> "Candidates":
        """These and others."""
        return Candidates(
            np.concatenate([self.cells, other.cells]), np.concatenate([self.upper, other.upper])
        )

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.int64]) -> "Candidates":
        return Candidates(self.cells[which], self.upper[which])


@dataclass
class CellScores:
    """Scores of single cells, equal to those of the exhaustive search.

    Parameters
    ----------
    bounds : Bounds
        The scan, its prior and the space.
    objective : Objective
        What a cell is worth.
    guard_radius : float
        The runner-up lies farther than this from the guarded cell, m.
    guarded : tuple of 3 int, optional
        That cell; the best one so far if not given.
    best : float
        Highest score so far.
    cell : tuple of 3 int
        Its cell, the first in index order at ties (D8).
    scored : dict
        Score and moments of each cell that was scored.
    """

    bounds: Bounds
    objective: Objective
    guard_radius: float
    guarded: Cell | None = None
    best: float = -math.inf
    cell: Cell = (0, 0, 0)
    scored: dict[Cell, tuple[float, Moments]] = field(default_factory=dict)
    _turned: dict[int, HeadingPass] = field(default_factory=dict)

    def score(self, cells: NDArray[np.int64]) -> None:
        """Score cells that are not yet, and keep the best."""
        new = np.array([cell for cell in map(tuple, cells.tolist()) if cell not in self.scored], np.int64)
        for heading in np.unique(new[:, 0]) if len(new) else ():
            mine = new[new[:, 0] == heading]
            with_all = isinstance(self.objective, BoundedByCount)
            moments = self.moments(int(heading), mine, with_all=with_all)
            for cell, score, four in zip(
                mine.tolist(), self.objective.score(moments).tolist(), moments, strict=True
            ):
                at = cast(Cell, tuple(cell))
                self.scored[at] = score, four
                if (-score, at) < (-self.best, self.cell):
                    self.best, self.cell = score, at

    def moments(self, heading: int, cells: NDArray[np.int64], *, with_all: bool) -> Moments:
        """Moments of some cells of one heading, shape (n, 4), to the last bit those of the exhaustive search.

        Without points that have no normal only N is whole.
        """
        from maxcon.search import exact_kernels

        if heading not in self._turned:
            self._turned[heading] = self.bounds.heading_pass(np.array([heading]))
        turned, searched = self._turned[heading], self.bounds.field
        offsets = cells[:, :0:-1] + turned.offsets[0]
        ends = searched.starts[1:] if with_all else searched.middles
        moments = np.zeros((len(cells), 4))
        tiles = searched.visited(turned.visits, int(offsets.min()), int(offsets.max()))
        for numbers, layers, tile in tiles:
            exact_kernels.moments_of_cells(
                offsets, turned.visits[numbers, 0], searched.starts, ends, searched.ranks, layers, turned.columns[0],
                turned.turned[0], *tile, searched.is_weighted, searched.is_signed, moments,
            )  # fmt: skip
        return moments

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one."""
        offsets = cells[:, 1:] - np.array((self.guarded or self.cell)[1:])
        return np.asarray(np.hypot(offsets[:, 0], offsets[:, 1]) * self.bounds.space.cell > self.guard_radius)

    def runner_up(self) -> float:
        """Highest score beyond the guard radius among the cells that were scored."""
        is_beyond = self.is_beyond(np.array(list(self.scored), np.int64))
        scores = np.array([score for score, _ in self.scored.values()])
        return float(scores.max(where=is_beyond, initial=0.0))
