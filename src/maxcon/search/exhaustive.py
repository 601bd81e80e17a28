"""Exhaustive search: the definition's accumulator, compiled (D5, D7), at one height or at each of several."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import (
    Accumulator,
    Multiplicity,
    Weighting,
    cells_of,
    check_all_fit,
    check_one_height,
    check_threads,
    highest,
)
from maxcon.search.objectives import Objective
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.space import SearchSpace


def exhaustive(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
    n_threads: int = 1,
) -> Accumulator:
    """Moments of every cell of the search space; equal to `reference.voxels`, to the last bit.

    Parameters
    ----------
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge. Points outside of the map match nothing.
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells, of one height; at most 2^26 (2 GiB of moments).
    multiplicity : {"occupied", "points"}
        Whether a match counts once, or as often as the voxel has map points (D4).
    weighting : {"cosine", "published", "one"}
        Weight of a match in N, see `Weighting` (D5).
    n_threads : int
        Threads that share out the headings; the result does not depend on it (D8).

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's, or the space has several heights or too many cells.
    OptionError
        If an option has a value that it cannot take.
    ArrayError
        If the prior lies so far out that voxels have no index there (64,000 km at 6 cm).
    """
    space = cells_of(space, point_map)
    check_one_height(space)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    check_threads(n_threads)
    check_all_fit(space)
    prepared = PreparedScan.prepare(scan, point_map, prior, space, multiplicity, weighting)
    moments = prepared.moments_of_headings(np.arange(len(space.headings)), n_threads)
    return Accumulator(moments, space, prior)


def accumulators(
    search: Callable[..., Accumulator], scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, **options: Any
) -> Iterator[Accumulator]:
    """Yield the accumulator of each height, from the lowest on: the definition of a search over heights.

    `search` is `search.reference.voxels` or `search.exhaustive`, called with the other arguments and `options` around
    the prior raised to each height.
    """
    for raised in space.priors(prior):
        yield search(scan, point_map, raised, space.plane, **options)


def highest_of(heights: Iterable[Accumulator], objective: Objective) -> tuple[int, Accumulator]:
    """Number and accumulator of the height that has the cell of the highest score.

    At ties the first in the order (heading, height, y, x) wins (D8); `SearchSpaceError` if there is no height.
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
