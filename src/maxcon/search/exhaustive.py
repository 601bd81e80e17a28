# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The exhaustive search: the definition's accumulator, compiled (D5, D7)."""

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.matching import cells_of, check_all_fit, check_one_height, check_threads
from maxcon.search.options import Multiplicity, Weighting
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.space import SearchSpace

__all__ = ["exhaustive"]


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
        Voxels of the space's cell edge. A scan or space that reaches past the map finds nothing there.
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells to try, of one height; at most 2^26 of them (2 GiB of moments).
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    weighting : {"cosine", "published", "one"}
        Weight of a match in N, see `Weighting` (D5).
    n_threads : int
        Headings are shared out among that many threads; the result does not depend on it (D8).

    Returns
    -------
    Accumulator
        Moments, shape (headings, ny, nx, 4), float64.

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's, or the space has several heights or too many cells.
    OptionError
        If the multiplicity or the weighting is unknown or there is no thread.
    ArrayError
        If the prior lies so far out that voxels have no index there (64,000 km at 6 cm).
    """
    space = cells_of(space, point_map)
    check_one_height(space)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    check_threads(n_threads)
    check_all_fit(space)
    prepared = PreparedScan.prepare(scan, point_map, prior, space, multiplicity, weighting)
    return prepared.accumulated(n_threads)
