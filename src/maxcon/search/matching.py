# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What every search agrees on: what a match counts and weighs, and where a scan point comes to lie."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose, rotation_matrices
from maxcon.map import PointMap
from maxcon.map.layout import LEVEL_FACTORS
from maxcon.scan import Scan
from maxcon.search.space import SearchSpace

__all__ = [
    "CONTRIBUTION_STEP",
    "ROUNDER",
    "UprightScan",
    "cells_of",
    "check_all_fit",
    "check_one_height",
    "check_threads",
    "level_of",
    "turn",
    "upright",
]

CONTRIBUTION_STEP = 2.0**-24
"""What a match adds to N is rounded to whole multiples of this, so that float64 sums are exact, and
equal in any order, up to 2^29 matches in a cell (D8)."""

ROUNDER = 1.5 * 2.0**52 * CONTRIBUTION_STEP
"""Adding and subtracting this rounds a float64 to whole multiples of the step, ties to even, as numpy.rint does."""

MOST_CELLS = 2**26
"""Most cells of a space that are all looked at; an accumulator of so many takes 2 GiB, 32 bytes each."""


@dataclass(frozen=True, slots=True)
class UprightScan:
    """A scan set upright: turned by the prior's roll and pitch, raised by its z; the heading is still to come (D2).

    Parameters
    ----------
    points : array, shape (n, 3)
        m; x and y about the sensor, z in the local frame of the map.
    normals : array, shape (n, 3)
        Unit normals or zeros, same axes.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]


def _rotate(vectors: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """R v for each row, term by term: a row's result must not depend on its place, as with BLAS it may."""
    x, y, z = vectors.T
    return np.column_stack([x * row[0] + y * row[1] + z * row[2] for row in rotation])


def upright(scan: Scan, prior: Pose) -> UprightScan:
    """Turn a scan by the prior's roll and pitch, and raise it by its z (D2)."""
    rotation = rotation_matrices(prior.roll, prior.pitch, 0.0)
    points = _rotate(scan.points, rotation)
    points[:, 2] += prior.z
    return UprightScan(points, _rotate(scan.normals, rotation))


def turn(vectors: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    """Rz(heading) v for each row of `vectors`, shape (n, 3)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    x, y, z = vectors.T
    return np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])


def level_of(point_map: PointMap, space: SearchSpace) -> PointMap:
    """Return the level of a map whose voxels are the cells of a space.

    Raises
    ------
    SearchSpaceError
        If there is none.
    """
    for factor in LEVEL_FACTORS:
        if np.isclose(space.cell_edge, point_map.cell * factor, rtol=1e-9, atol=0.0):
            return point_map.level(factor)
    raise SearchSpaceError(
        f"Expected the cell edge of the search space to be the map's voxel edge, {point_map.cell:g} m, or 2, 4, ... 32"
        f" times that, got {space.cell_edge:g} m. Build the map with that cell, or give the space none."
    )


def cells_of(space: SearchSpace, point_map: PointMap) -> SearchSpace:
    """Return a search space with cells: the map's voxels if it has none, as a shift by a cell is one by a voxel (D4).

    Raises
    ------
    SearchSpaceError
        If its cells are not the map's voxels.
    """
    space = space.at(point_map.cell)
    if not np.isclose(space.cell_edge, point_map.cell, rtol=1e-9, atol=0.0):
        raise SearchSpaceError(
            f"Expected the cell edge of the search space to be the map's voxel edge, {point_map.cell:g} m,"
            f" got {space.cell_edge:g} m. Search in a level of the map that has it, or give the space no cell."
        )
    return space


def check_one_height(space: SearchSpace) -> None:
    """Refuse a search space of several heights where the cells of one are asked for.

    Raises
    ------
    SearchSpaceError
        If there are several.
    """
    if space.n_heights > 1:
        raise SearchSpaceError(
            f"Expected a search space of one height, got {space.n_heights}. Search its `plane` around each of its"
            " `priors`, as `search.accumulators` does, or use `search.branch_and_bound`."
        )


def check_all_fit(space: SearchSpace) -> None:
    """Refuse a search space that has too many cells to look at all of them at once.

    Raises
    ------
    SearchSpaceError
        If it has more than 2^26.
    """
    if space.n_cells > MOST_CELLS:
        raise SearchSpaceError(
            f"Expected at most {MOST_CELLS:,} cells in an exhaustive search, got {space.n_cells:,}."
            " Narrow the search space, or enlarge the cell or the heading step."
        )


def check_threads(n_threads: int) -> None:
    """Refuse to search on no thread.

    Raises
    ------
    OptionError
        If there is none.
    """
    if n_threads < 1:
        raise OptionError(f"Expected `n_threads` to be 1 or more, got {n_threads}. One is the default.")
