# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of voxels: the plane through the points of the voxels around, turned to the sensor's side."""

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.voxel_moments import LAYER, ROW, VoxelMoments, voxel_keys

__all__ = ["plane_normals", "turn_to_side"]

# Neighbourhoods of 5^3 voxels: 30 cm at 6 cm. Where they leave the plane open (few points, a line, a
# bush), voxels of 2 and of 4 times the edge are tried.
REACH = 2
N_LEVELS = 3
COUNT_CAP = 8.0
LEAST_VOXELS = 4
FLATNESS = 0.3


def plane_normals(moments: VoxelMoments, cell: float, is_wanted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Unit normals of voxels, their sign open, from the smallest neighbourhood that determines a plane.

    Parameters
    ----------
    moments : VoxelMoments
        The voxels of a tile with its halo.
    cell : float
        Voxel edge, m.
    is_wanted : array, shape (n,), bool
        Voxels whose normal is asked for (not the halo's).

    Returns
    -------
    array, shape (n, 3)
        Zeros where no neighbourhood determines a plane, or none is asked for.
    """
    normals = np.zeros((len(moments), 3))
    if len(moments) < LEAST_VOXELS:  # at no level are there more
        return normals
    level, edge = moments, cell
    place = np.arange(len(moments))  # the voxel of this level that holds each voxel
    for number in range(N_LEVELS):
        if number > 0:
            parents = voxel_keys(level.indices >> 1)
            level, edge = level.coarser(edge), 2.0 * edge
            place = np.searchsorted(level.keys, parents)[place]
        is_open = is_wanted & ~normals.any(axis=1)
        is_asked = np.zeros(len(level), bool)
        is_asked[place[is_open]] = True
        normals[is_open] = _fit(level, edge, is_asked)[place[is_open]]
    return normals


def _fit(level: VoxelMoments, edge: float, is_asked: NDArray[np.bool_]) -> NDArray[np.float64]:
    from maxcon.mapping.build.kernels import neighbourhood_normals

    normals = np.zeros((len(level), 3))
    neighbourhood_normals(
        level.keys, level.counts, level.sums, level.outers, is_asked, edge, ROW, LAYER, REACH,
        COUNT_CAP, LEAST_VOXELS, FLATNESS, normals,
    )  # fmt: skip
    return normals


def turn_to_side(normals: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn normals to the side of the sensor; those whose side is not known become zeros.

    Parameters
    ----------
    normals : array, shape (n, 3)
        Unit normals or zeros.
    sides : array, shape (n, 3)
        Directions to the sensor, zeros where not known.
    """
    turned: NDArray[np.float64] = normals * np.sign((normals * sides).sum(axis=1))[:, None]
    return turned
