# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: scan points grouped by the surface they lie on, and wall points counted. Arrays in, arrays out."""

import numpy as np
from numba import njit

__all__ = ["count_walls", "number_groups"]

# Cubes along an axis that have a number each: 400 km of 3 m. FACTOR, a large odd number, mixes the bits of a hash.
CUBES = np.int64(2**17)
FACTOR = 0x9E3779B97F4A7C15


@njit(nogil=True, cache=True)
def _bounds(n):
    """Unit vectors on the borders between the n sectors of a half turn, (n - 1, 2)."""
    bounds = np.empty((n - 1, 2))
    for k in range(n - 1):
        azimuth = (k + 1) * np.pi / n
        bounds[k, 0], bounds[k, 1] = np.cos(azimuth), np.sin(azimuth)
    return bounds


@njit(nogil=True, cache=True)
def _sector(x, y, bounds):
    """Number of the sector of a half turn in which a direction or its opposite lies, and whether it is the opposite."""
    is_opposite = y < 0.0 or (y == 0.0 and x < 0.0)
    if is_opposite:
        x, y = -x, -y
    sector = 0
    for k in range(bounds.shape[0]):
        sector += bounds[k, 0] * y >= bounds[k, 1] * x
    return sector, is_opposite


@njit(nogil=True, cache=True)
def _number(key, table, keys, n):
    """Number of a key: its place among the first `n` of `keys`, or `n` if it is new, and then added there.

    table : (2^k,), hash table of numbers, -1 where it is free; at least twice as large as there can be keys.
    """
    mask = np.uint64(table.shape[0] - 1)
    slot = ((np.uint64(key) * np.uint64(FACTOR)) >> np.uint64(32)) & mask
    while table[slot] >= 0:
        if keys[table[slot]] == key:
            return table[slot]
        slot = (slot + np.uint64(1)) & mask
    table[slot], keys[n] = n, key
    return n


@njit(nogil=True, cache=True)
def number_groups(points, planes, weights, position, edge, n_facings, steepest, clusters, walls):
    """Number the clusters (points of one facing in one cube) and the walls (of one facing, at one distance).

    For `covariance`. The distance is that of the plane from the sensor. points : (n, 3), sensor frame, m; planes :
    (n, 4), as `find_partners` made them; weights : (n,), points with 0 are in no group; position : (3,), of the sensor,
    map frame, m; edge : of a cube, and of a step of distance, m; n_facings : by azimuth, an even number; steepest :
    vertical part of a normal beyond which it faces up or down. clusters, walls : (n,), out, number of each point's, -1
    for none. Returns how many clusters and how many walls there are.
    """
    n_used = np.count_nonzero(weights)
    size = 16
    while size < 2 * n_used:
        size *= 2
    cluster_table, wall_table = np.full(size, np.int32(-1)), np.full(size, np.int32(-1))
    cluster_keys, wall_keys = np.empty(n_used, np.int64), np.empty(n_used, np.int64)
    bounds = _bounds(n_facings // 2)
    n_clusters, n_walls = 0, 0
    for i in range(points.shape[0]):
        clusters[i] = walls[i] = -1
        if weights[i] == 0.0:
            continue
        nx, ny, nz, offset = planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3]
        facing = np.int64(n_facings)
        if abs(nz) <= steepest:
            sector, is_opposite = _sector(nx, ny, bounds)
            facing = sector + n_facings // 2 * is_opposite
        key = facing
        for axis in range(3):
            key = key * CUBES + np.int64(np.floor(points[i, axis] / edge)) + CUBES // 2
        clusters[i] = _number(key, cluster_table, cluster_keys, n_clusters)
        n_clusters = max(n_clusters, clusters[i] + 1)
        depth = (offset - nx * position[0] - ny * position[1] - nz * position[2]) / edge
        key = facing * CUBES + np.int64(np.floor(depth)) + CUBES // 2
        walls[i] = _number(key, wall_table, wall_keys, n_walls)
        n_walls = max(n_walls, walls[i] + 1)
    return n_clusters, n_walls


@njit(nogil=True, cache=True)
def count_walls(normals, residuals, rotation, level, found_within, n_points, n_found):
    """Count the wall points of each facing, and those of them that lie on a plane of the map.

    normals : (n, 3), sensor frame, zeros for none; residuals : (n,), m, infinite without a plane; rotation : (3, 3),
    R_map_sensor; level : vertical part of a normal from which on it is no wall's; found_within : largest residual of a
    point on its plane, m; n_points, n_found : (n_facings,) int64, equal sectors of a half turn, in zeros, out.
    """
    bounds = _bounds(n_points.shape[0])
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        nz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        if (x == 0.0 and y == 0.0 and z == 0.0) or abs(nz) >= level:
            continue
        nx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
        ny = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
        facing, _ = _sector(nx, ny, bounds)
        n_points[facing] += 1
        n_found[facing] += abs(residuals[i]) <= found_within
