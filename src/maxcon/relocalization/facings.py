# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Facings: the sectors of azimuth that surfaces face, as bits of a byte; points match voxels of their facing only."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["ANY", "N_SECTORS", "facings_of_points", "facings_of_voxels"]

N_SECTORS = 7
"""Sectors of azimuth, a bit of a byte each; the eighth bit is set in every voxel with points."""
SECTOR = 2.0 * np.pi / N_SECTORS
ANY = N_SECTORS
"""Number of the bit that every voxel with points has."""
# A voxel is in every sector whose middle is within 60 degrees of its normal, flattened.
LEAST_COSINE = 0.5
# A point of the scan has a facing where its normal is within 60 degrees of horizontal.
LEAST_HORIZONTAL = 0.5


def facings_of_voxels(normals: NDArray[np.float32], *, is_signed: bool) -> NDArray[np.uint8]:
    """Facings (n,) of voxels with these normals (n, 3), map axes: all sectors near the normal, and bit `ANY`."""
    bits = np.full(len(normals), 1 << ANY, np.uint8)
    for sector in range(N_SECTORS):
        along = normals[:, 0] * np.cos(sector * SECTOR) + normals[:, 1] * np.sin(sector * SECTOR)
        if not is_signed:
            along = np.abs(along)
        bits[along > LEAST_COSINE] |= np.uint8(1 << sector)
    return bits


def facings_of_points(normals: NDArray[np.float64], headings: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Bit (h, n) that a voxel must have to match points with levelled normals (n, 3) at headings (h,), rad.

    A point without a normal, or with one far from horizontal, matches any voxel.
    """
    has_facing = np.hypot(normals[:, 0], normals[:, 1]) > LEAST_HORIZONTAL
    azimuths = np.arctan2(normals[:, 1], normals[:, 0])
    sectors = np.floor((azimuths + headings[:, None]) / SECTOR + 0.5).astype(np.int64) % N_SECTORS
    return np.where(has_facing, sectors, ANY).astype(np.uint8)
