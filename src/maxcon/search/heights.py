# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Heights: a search over z too is a search of the same cells around the prior at each height (decision 17)."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from maxcon.accumulator import Accumulator, highest
from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose
from maxcon.objectives import Objective
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search_space import SearchSpace

__all__ = ["accumulators", "highest_of", "outwards"]


def accumulators(
    search: Callable[..., Accumulator],
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    **options: Any,
) -> Iterator[Accumulator]:
    """Yield the moments of all cells, height by height from the lowest on: the definition of a search over heights.

    Parameters
    ----------
    search : callable
        `search.reference.voxels` or `search.exhaustive`: what is asked at each height.
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge.
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        The cells of all heights.
    **options
        Of the search.

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
        heading, y, x = cell = highest(scores, accumulator.space)
        rank = (-float(scores[cell]), heading, height, y, x)
        if best is None or rank < best[0]:
            best = rank, accumulator
    if best is None:
        raise SearchSpaceError(
            "Expected the accumulators of at least one height, got none. Pass all of a space."
        )
    return best[0][2], best[1]


def outwards(space: SearchSpace) -> list[int]:
    """Numbers of the heights of a space, from that of the prior on."""
    middle = space.n_heights // 2
    return sorted(range(space.n_heights), key=lambda height: abs(height - middle))
