# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A search space, scored by an objective: its best cell, the range of its scores, and which headings to draw."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maxcon.geometry import Pose, wrap_angle
from maxcon.search.accumulator import Accumulator, highest
from maxcon.search.objectives import Objective, Scores
from maxcon.search.space import Cell, SearchSpace

__all__ = ["SearchSpaceView", "chosen_headings"]


@dataclass(frozen=True)
class SearchSpaceView:
    """An accumulator, scored by an objective.

    Parameters
    ----------
    accumulator : Accumulator
        The moments of every cell.
    objective : Objective
        Scores the cells.
    title : str
        Title of its panel; the objective's if empty.
    """

    accumulator: Accumulator
    objective: Objective
    title: str = ""

    @property
    def space(self) -> SearchSpace:
        """The cells."""
        return self.accumulator.space

    @cached_property
    def scores(self) -> Scores:
        """Score of every cell, shape (headings, ny, nx)."""
        return self.accumulator.score(self.objective)

    @cached_property
    def best(self) -> Cell:
        """The cell with the highest score."""
        return highest(self.scores)

    @property
    def has_best(self) -> bool:
        """Whether any cell scores higher than another."""
        return bool(self.scores[self.best] > self.scores.min())

    @property
    def best_offset(self) -> tuple[float, float]:
        """Offset (x, y) of the best cell from the prior, m."""
        _, iy, ix = self.best
        return float(self.space.offsets[ix]), float(self.space.offsets[iy])

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Scores at the ends of the colour scale: 0 (or the lowest, if negative) and the highest."""
        finite = self.scores[np.isfinite(self.scores)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        low = min(low, 0.0)
        return low, high if high > low else low + 1.0

    def has_best_at(self, heading: int) -> bool:
        """Whether there is a best cell, and at this heading."""
        return self.has_best and heading == self.best[0]

    def offset(self, pose: Pose) -> tuple[float, float]:
        """Offset (x, y) of a pose from the prior, m."""
        return pose.x - self.accumulator.prior.x, pose.y - self.accumulator.prior.y

    def heading_nearest(self, pose: Pose, among: Sequence[int]) -> int:
        """Return the index, of those `among`, of the heading nearest to that of a pose."""
        turns = self.space.headings
        turn = wrap_angle(pose.heading - self.accumulator.prior.heading)
        return min(among, key=lambda heading: abs(float(turns[heading]) - turn))


def chosen_headings(n_headings: int, best: int, limit: int = 9) -> list[int]:
    """Return indices of at most `limit` headings, evenly and as widely spaced as fits, with the best among them."""
    widest = max(1, (n_headings - 1) // max(1, limit - 1))
    for step in range(widest, 0, -1):
        chosen = range(best % step, n_headings, step)
        if len(chosen) >= limit:
            break
    return sorted(sorted(chosen, key=lambda heading: abs(heading - best))[:limit])
