# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Definition of hits and misses of a ray, in plain NumPy; `ray_kernels` does the same for many (D7).

A ray hits a voxel if it ended in it or in one of the 26 around: noise moves an end by less than that, mostly.

A ray misses a voxel if it crossed the surface in it and ended clearly behind. The surface is the plane through the
mean of the voxel's points, along their normal. The ray must cross this plane inside of the voxel, not at a flat angle,
and both the sensor and the end must lie farther from the plane than noise explains, on either side. So a road seen at a
flat angle is not carved: its rays end on the very plane that they pass through. A voxel without a normal is crossed if
the ray passes its mean within half an edge, and ends twice as far behind.

A pulse without a return is no ray: from glass, water and the sky nothing follows.
"""

import numpy as np
from numpy.typing import NDArray


def is_hit(end: NDArray[np.float64], voxels: NDArray[np.integer], cell: float) -> NDArray[np.bool_]:
    """Whether a ray that ended at `end`, shape (3,), m, hit each of the voxels, indices of shape (n, 3)."""
    there = np.floor(end / cell).astype(np.int64)
    return np.asarray((np.abs(voxels - there) <= 1).all(axis=1))


def is_miss(
    origin: NDArray[np.float64],
    end: NDArray[np.float64],
    voxels: NDArray[np.integer],
    means: NDArray[np.float64],
    normals: NDArray[np.float64],
    cell: float,
    margin: float,
    least_cosine: float,
    reach: float,
) -> NDArray[np.bool_]:
    """Whether a ray missed each of the voxels: it saw through the surface there.

    origin, end: shape (3,); where the sensor was and where the ray ended, local frame, m.
    voxels: shape (n, 3), int; indices of the voxels.
    means, normals: shape (n, 3); mean of the points of each, local frame, m; unit normal, or zeros.
    cell: edge of a voxel, m.
    margin: how far behind a surface the end must lie, m.
    least_cosine: of the angle between ray and normal.
    reach: voxels farther along the ray are not judged, m.
    """
    length = float(np.sqrt(((end - origin) ** 2).sum()))
    if length == 0.0:
        return np.zeros(len(voxels), bool)
    along = (end - origin) / length
    cosines = normals @ along
    has_normal = normals.any(axis=1)
    is_steep = np.abs(cosines) >= least_cosine
    to_mean = means - origin
    to_plane = np.divide((to_mean * normals).sum(axis=1), cosines, out=np.full(len(voxels), np.inf), where=is_steep)
    at = np.where(has_normal, to_plane, to_mean @ along)  # m along the ray
    is_ahead = (at > 0.0) & (at < min(length, reach))
    at = np.where(is_ahead, at, 0.0)
    crossing = origin + at[:, None] * along
    is_inside = (np.floor(crossing / cell).astype(np.int64) == voxels).all(axis=1)
    steepness = np.where(has_normal, np.abs(cosines), 0.5)
    is_clear = (at * steepness >= margin) & ((length - at) * steepness >= margin)
    is_close = has_normal | (((crossing - means) ** 2).sum(axis=1) <= (0.5 * cell) ** 2)
    return np.asarray(is_ahead & is_inside & is_clear & is_close & (is_steep | ~has_normal))
