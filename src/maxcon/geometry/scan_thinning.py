# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Thinning a scan: near surfaces have most of its points, and would outvote the far ones."""

import numpy as np
from numpy.typing import NDArray

from maxcon._system.compiled import read_only_view

__all__ = ["one_per_cube"]


def one_per_cube(
    points: NDArray[np.float64], normals: NDArray[np.float64], edge: float, *, by_lot: bool = False
) -> NDArray[np.int64]:
    """Numbers of the points that are kept: one of those in each cube of a grid, in ascending order.

    A point with a normal is preferred to one without, then the nearest to the middle of the cube, then the one of the
    smallest x, y, z: which points are kept does not depend on the order they come in.

    Parameters
    ----------
    points : array, shape (n, 3)
        m, any frame. The grid has a corner at (0, 0, 0) and the axes of that frame.
    normals : array, shape (n, 3)
        Unit normals, zeros for none.
    edge : float
        Of a cube, m, above 0.
    by_lot : bool
        Whether a hash of the coordinates draws the point, and not the distance from the middle, which prefers the side
        of a noisy surface on which the middle lies, and so moves a pose by millimetres. The grid is then turned against
        the axes: else, where a wall runs along the sides of cubes, its few stray points beyond them would fill as many
        cubes as all others, and weigh as much.

    Returns
    -------
    array, shape (m,), int64
        Rows of `points`.
    """
    from maxcon.geometry import scan_thinning_kernels

    kept = scan_thinning_kernels.one_per_cube(read_only_view(points), read_only_view(normals), edge, by_lot)
    return np.sort(kept)
