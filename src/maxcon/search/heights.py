# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Heights: a search over z as well is one search of the same cells at each height of the prior (decision 17)."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator, highest
from maxcon.search.found import Found, Standing
from maxcon.search.objectives import Objective
from maxcon.search.space import SearchSpace

__all__ = ["accumulators", "best_of_heights", "highest_of"]


def accumulators(
    search: Callable[..., Accumulator], scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, **options: Any
) -> Iterator[Accumulator]:
    """Yield the moments of all cells, height by height from the lowest on: the definition of a search over heights.

    Parameters
    ----------
    search : callable
        Called at each height: `search.reference.voxels` or `search.exhaustive`.
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        The cells of all heights.
    **options
        Options of that search.

    Yields
    ------
    Accumulator
        Around the prior raised to the height.
    """
    for raised in space.priors(prior):
        yield search(scan, point_map, raised, space.plane, **options)


def highest_of(heights: Iterable[Accumulator], objective: Objective) -> tuple[int, Accumulator]:
    """Number and accumulator of the height that has the cell of the highest score.

    At ties the first in the order (heading, height, y, x) wins (D8); at one height `Accumulator.best_cell` finds it.
    """
    best: tuple[tuple[float, int, int, int, int], Accumulator] | None = None
    for height, accumulator in enumerate(heights):
        scores = accumulator.score(objective)
        heading, y, x = cell = highest(scores)
        rank = (-float(scores[cell]), heading, height, y, x)
        if best is None or rank < best[0]:
            best = rank, accumulator
    if best is None:
        raise SearchSpaceError("Expected the accumulators of at least one height, got none. Pass all of a space.")
    return best[0][2], best[1]


def _outwards(space: SearchSpace) -> list[int]:
    """Numbers of the heights of a space, from that of the prior on."""
    middle = space.n_heights // 2
    return sorted(range(space.n_heights), key=lambda height: abs(height - middle))


def best_of_heights(
    search: Callable[[int, float, Standing | None], Found], space: SearchSpace, share: float, standing: Standing | None
) -> Found:
    """Search height by height, from that of the prior outwards, for the best cell of all and its runner-up there.

    Parameters
    ----------
    search : callable
        Called with the number of a height, the share of the best score that cells must reach, and the incumbent;
        returns what is found there.
    space : SearchSpace
        The cells of all heights.
    share : float
        The share that is asked for at the height of the best cell.
    standing : Standing, optional
        The incumbent, if there is one before the search.
    """

    def rank(found: Found) -> tuple[float, int, int, int, int]:
        heading, y, x = found.cell
        return -found.score, heading, found.height, y, x

    first, *others = _outwards(space)
    best = search(first, share, standing)
    n_scored = best.n_scored
    for height in others:
        if standing is None or best.score > standing.score:
            standing = Standing(best.score, best.moments)
        found = search(height, 1.0, standing)
        n_scored += found.n_scored
        best = min(best, found, key=rank)
    if best.height != first and share < 1.0:  # so far nothing but the best cell was looked for there
        best = search(best.height, share, None)
        n_scored += best.n_scored
    return replace(best, n_scored=n_scored)
