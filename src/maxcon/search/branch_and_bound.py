# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Branch and bound: the best cell of the exhaustive search, from bounds of all cells and the moments of few."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.accumulator import highest
from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.integrity import highest_beyond
from maxcon.objectives import BoundedByAxes, BoundedByCount, Moments, Objective, Scores
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search.bounds import Axis, Bounds, HeadingPass
from maxcon.search.cell_scores import Candidates, CellScores
from maxcon.search.exhaustive import exhaustive
from maxcon.search.field import Field
from maxcon.search.matching import Multiplicity, Weighting, check_cell_edge
from maxcon.search_space import Cell, SearchSpace

__all__ = ["Found", "branch_and_bound"]

# A first idea of the best cell comes from about so many scan points; so many of its best cells are scored.
SAMPLE_POINTS, SAMPLE_CELLS = 500, 4
# Voxels are left out of the bounds that together add less than this share of the best score.
LEFT_OUT = 0.15
# More candidates than this are bounded along the second axis too, before they are scored.
MOST_CANDIDATES = 48
# Where they leave more than this to be scored, an exhaustive search is faster.
HOPELESS = 200
# Candidates are scored so many at a time, from the most promising on.
AT_ONCE = 16


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
        Cells whose moments were computed; all others were only bounded.
    """

    cell: Cell
    score: float
    moments: Moments
    bound: float
    rest: float
    n_scored: int


def branch_and_bound(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    objective: Objective,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
    share: float = 1.0,
    guard_radius: float = 0.3,
    guarded: Cell | None = None,
) -> Found:
    """Find the best cell of a search space: the same as that of the exhaustive search, its score and moments too.

    Every cell is bounded by what its matches add to N along the axis that the best cell so far determines least: a
    single number, for which voxels that add little are not even looked at (design section 3, facts 2 and 3). Where
    more than a few cells could still be the best, they are bounded along the other axis too. What remains is scored,
    from the highest bound on, until no bound reaches the best score.

    Parameters
    ----------
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge.
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells. Memory does not grow with the number of headings.
    objective : Objective
        What a cell is worth. One without bounds (`BoundedByAxes`, `BoundedByCount`) is searched exhaustively.
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    weighting : {"cosine", "one"}
        Weight of a match in N: max(0, n_scan . n_map), or 1 (D5).
    share : float
        1 to find the best cell only; less, above 0, to find the runner-up too, if it reaches this share of the best.
    guard_radius : float
        The runner-up lies farther than this from the best cell, m.
    guarded : tuple of 3 int, optional
        The cell that it lies far from, and whose score it is compared with, if not the best one: that of another
        objective.

    Returns
    -------
    Found

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's, or bounds decide too little in a space too large to be searched exhaustively.
    OptionError
        If the multiplicity or the weighting is unknown, or the share or the guard radius out of range.
    ArrayError
        If the prior lies so far out that voxels have no index there.
    """
    check_cell_edge(space, point_map)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    if not 0.0 < share <= 1.0:
        raise OptionError(
            f"Expected `share` above 0 and at most 1, got {share}. With 1 only the best cell is found."
        )
    if not 0.0 <= guard_radius < math.inf:
        raise OptionError(f"Expected `guard_radius` >= 0 m, got {guard_radius}. The default is 0.3.")
    if isinstance(objective, BoundedByAxes | BoundedByCount):
        searched = Field.prepare(scan, point_map, prior, space, multiplicity, weighting)
        bounds = Bounds.of(searched, prior, space)
        scores_of_cells = CellScores(bounds, objective, guard_radius, guarded)
        found = _Search(bounds, objective, share, scores_of_cells).run()
        if found is not None:
            return found
    accumulator = exhaustive(scan, point_map, prior, space, multiplicity=multiplicity, weighting=weighting)
    scores = accumulator.score(objective)
    cell = highest(scores, space)
    rest = highest_beyond(scores, guarded or cell, space, guard_radius)
    score = float(scores[cell])
    return Found(cell, score, accumulator.moments[cell].copy(), score, rest, scores.size)


@dataclass
class _Search:
    """One search, and how far it has come."""

    bounds: Bounds
    objective: BoundedByAxes | BoundedByCount
    share: float
    scores: CellScores
    highest_left_out: float = 0.0

    def run(self) -> Found | None:
        """The best cell; None if bounds leave so much that an exhaustive search is faster."""
        scores = self.scores
        if not self.bounds.field.tiles:  # nothing to match: all cells are alike
            scores.score(np.zeros((1, 3), np.int64))
            return Found(scores.cell, scores.best, np.zeros(4), scores.best, scores.best, 1)
        if scores.guarded is not None:
            scores.score(np.array([scores.guarded]))
        candidates, is_sampled = Candidates.none(), False
        for heading_pass in self.bounds.passes():
            if not is_sampled:
                self._score_sample(heading_pass)
                is_sampled = True
            candidates = candidates.joined(self._bound(heading_pass))
            if len(candidates) > HOPELESS:
                return None
        self._decide(candidates)
        moments = scores.moments(scores.cell[0], np.array([scores.cell]), with_all=True)[0]
        rest = max(self.highest_left_out, scores.runner_up())
        return Found(scores.cell, scores.best, moments, scores.best, rest, len(scores.scored))

    @property
    def _asked(self) -> float:
        """Score from which on a cell is looked for."""
        guarded = self.scores.guarded
        return self.share * (self.scores.best if guarded is None else self.scores.scored[guarded][0])

    def _axes_of_scan(self) -> tuple[Axis, ...]:
        """Axis that the scan's normals determine least, and the other one; or the count."""
        if isinstance(self.objective, BoundedByCount):
            return (Axis.none(),)
        x, y, _ = self.bounds.field.normals
        xx, xy, yy = (float((a * b).sum()) for a, b in ((x, x), (x, y), (y, y)))
        return _axes(xx, xy, yy, turn=self.bounds.prior.heading)

    def _axes_of_best(self) -> tuple[Axis, ...]:
        """Axis that the matches in the best cell so far determine least, and the other one; or the count."""
        if isinstance(self.objective, BoundedByCount):
            return (Axis.none(),)
        _, moments = self.scores.scored[self.scores.cell]
        return _axes(*(float(moment) for moment in moments[1:]))

    def _score_sample(self, heading_pass: HeadingPass) -> None:
        """Score cells that are good for a sample of the scan: the better the best is early, the less is left."""
        axes = self._axes_of_scan()
        every = max(1, round(self.bounds.most(axes[0]) / self.bounds.fullest / SAMPLE_POINTS))
        upper = self._upper([heading_pass.along(axis, 0.0, every) for axis in axes])
        n_cells = min(SAMPLE_CELLS, upper.size)
        self.scores.score(
            _cells(heading_pass, np.sort(np.argpartition(upper, -n_cells, axis=None)[-n_cells:]))
        )

    def _bound(self, heading_pass: HeadingPass) -> Candidates:
        """Cells that may reach the asked share of the best score, of some headings."""
        axes = self._axes_of_best()
        least = (
            LEFT_OUT * max(self.scores.best, 0.0) / max(1.0, self.bounds.most(axes[0])) * self.bounds.fullest
        )
        along = heading_pass.along(axes[0], least)
        upper = self._upper([along])
        if np.count_nonzero(upper >= self._asked) > MOST_CANDIDATES:
            self.scores.score(_cells(heading_pass, np.argpartition(upper, -AT_ONCE, axis=None)[-AT_ONCE:]))
        if len(axes) > 1 and np.count_nonzero(upper >= self._asked) > MOST_CANDIDATES:
            here = np.flatnonzero((upper >= self._asked).any(axis=(1, 2)))
            other = self.bounds.heading_pass(heading_pass.headings[here]).along(axes[1], least)
            upper[here] = np.minimum(upper[here], self._upper([along[here], other]))
        is_left = upper >= self._asked
        self.highest_left_out = max(self.highest_left_out, float(upper.max(where=~is_left, initial=0.0)))
        places = np.flatnonzero(is_left)
        return Candidates(_cells(heading_pass, places), upper.reshape(-1)[places])

    def _upper(self, along: list[NDArray[np.float64]]) -> Scores:
        """Most that cells score, from what their matches add along one or both axes at most."""
        if isinstance(self.objective, BoundedByCount):
            return self.objective.bound_by_count(along[0])
        other = along[1] if len(along) > 1 else np.full_like(along[0], self.bounds.most(Axis.at(0.0)))
        return self.objective.bound_by_axes(along[0], other)

    def _decide(self, candidates: Candidates) -> None:
        """Score candidates until none is left that could be the best, or the runner-up that is asked for."""
        candidates = candidates[np.argsort(-candidates.upper, kind="stable")]
        place = 0
        while place < len(candidates) and candidates.upper[place] >= self.scores.best:
            self.scores.score(candidates.cells[place : place + AT_ONCE])
            place += AT_ONCE
        others = candidates[place:]
        others = others[self.scores.is_beyond(others.cells)]
        place = 0
        while place < len(others) and others.upper[place] >= max(self._asked, self.scores.runner_up()):
            self.scores.score(others.cells[place : place + AT_ONCE])
            place += AT_ONCE
        self.highest_left_out = max(self.highest_left_out, float(others.upper[place:].max(initial=0.0)))


def _cells(heading_pass: HeadingPass, places: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cells (n, 3) at some places of the bounds of a pass, numbered in index order."""
    n_cells = heading_pass.offsets[1] - heading_pass.offsets[0] + 1
    headings, y, x = np.unravel_index(places, (len(heading_pass.headings), n_cells, n_cells))
    return np.stack([heading_pass.headings[headings], y, x], axis=1)


def _axes(xx: float, xy: float, yy: float, turn: float = 0.0) -> tuple[Axis, Axis]:
    """Axes of the smaller and of the larger eigenvalue of a matrix, in a frame turned back by `turn`, rad."""
    strong = 0.5 * math.atan2(2.0 * xy, xx - yy) + turn
    return Axis.at(strong + 0.5 * math.pi), Axis.at(strong)
