# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Thinning a scan: near surfaces have most of its points, and would outvote the far ones."""

import numpy as np
from numpy.typing import NDArray

from maxcon.system.compiled import read_only_view

__all__ = ["one_per_cube"]


def one_per_cube(
    points: NDArray[np.float64], normals: NDArray[np.float64], edge: float, *, by_lot: bool = False
) -> NDArray[np.int64]:
    """Numbers of one measured point of those in each cube of a grid, in ascending order.

    A point with a normal comes before one without, then the nearest to the middle of the cube, then the one of the
    smallest x, y, z: which points are kept does not depend on the order they come in.

    Parameters
    ----------
    points : array, shape (n, 3)
        m. The grid has a corner at (0, 0, 0) and the axes of the points.
    normals : array, shape (n, 3)
        Unit normals, zeros for none.
    edge : float
        Of a cube, m, above 0.
    by_lot : bool
        Whether a hash of the coordinates stands for the distance from the middle: of the points of a noisy surface the
        middle prefers those on its own side, which moves a pose by millimetres. The grid then stands askew to the axes:
        of a wall along a side of the cubes the few points beyond it would be as many as all the rest.

    Returns
    -------
    array, shape (m,), int64
    """
    from maxcon.geometry import scan_thinning_kernels

    kept = scan_thinning_kernels.one_per_cube(read_only_view(points), read_only_view(normals), edge, by_lot)
    return np.sort(kept)
