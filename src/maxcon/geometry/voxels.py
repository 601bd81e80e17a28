# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coordinates to voxel indices and back, in one place (D4)."""

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError

__all__ = ["voxel_centers", "voxel_indices"]

# Indices stay in int32 with room for a search space on every side: at 6 cm that is 64,000 km.
INDEX_LIMIT = 2**30


def voxel_indices(points: NDArray[np.float64], cell: float) -> NDArray[np.int32]:
    """Index floor(coordinate / cell) of the voxel each point falls in.

    Parameters
    ----------
    points : array, shape (n, 3)
        Local frame, m, finite.
    cell : float
        Edge of a voxel, m.

    Returns
    -------
    array, shape (n, 3), int32
        (x, y, z) indices.

    Raises
    ------
    ArrayError
        If a point lies more than 2^30 voxels from the origin (64,000 km at 6 cm).
    """
    scaled = np.floor(points / cell)
    if scaled.size and max(scaled.max(), -scaled.min()) >= INDEX_LIMIT:
        raise ArrayError(
            f"Expected points within {INDEX_LIMIT * cell:.3g} m of the local origin, got"
            f" {np.abs(points).max():.3g} m. Express them in a local frame."
        )
    return scaled.astype(np.int32)


def voxel_centers(indices: NDArray[np.int32], cell: float) -> NDArray[np.float64]:
    """Centre of each voxel, shape (n, 3), local frame, m."""
    return (indices.astype(np.float64) + 0.5) * cell
