# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: which planes of the map scan points lie on, and the equations of their distances. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map.lookup_kernels import (
    FIRSTS,
    MEANS,
    NORMALS,
    PATCH_BITS,
    WORDS,
    fetch,
    find_in_patch,
    find_patch,
    float32_at,
    is_near_voxels,
    uint8_at,
)
from maxcon.point_map.tile import MEAN_STEPS

__all__ = ["adjust", "count_walls", "find_partners", "number_groups", "sum_gradients", "weigh"]

MEAN_STEP = 1.0 / MEAN_STEPS
# Points whose planes are fetched at once.
BLOCK = 32
# Cubes along an axis that have a number each: 400 km of 3 m. A large odd number mixes the numbers.
CUBES = np.int64(2**17)
FACTOR = 0x9E3779B97F4A7C15


@njit(nogil=True, cache=True)
def _plane(row, number, x, y, z, cell, rows):
    """Normal of a voxel, (nx, ny, nz), and mean of its points, (x, y, z), m."""
    normals, means, at = rows[row, NORMALS], rows[row, MEANS], np.uint64(3) * number
    one, two = np.uint64(1), np.uint64(2)
    return (
        np.float64(float32_at(normals, at)),
        np.float64(float32_at(normals, at + one)),
        np.float64(float32_at(normals, at + two)),
        (x + (np.float64(uint8_at(means, at)) + 0.5) * MEAN_STEP) * cell,
        (y + (np.float64(uint8_at(means, at + one)) + 0.5) * MEAN_STEP) * cell,
        (z + (np.float64(uint8_at(means, at + two)) + 0.5) * MEAN_STEP) * cell,
    )


@njit(nogil=True, cache=True)
def _partner_along(
    px, py, pz, nx, ny, nz, row, patch, cell, reach, least_cosine, is_signed, rows, grid, corner
):
    """Plane (normal, offset) nearest to a point among the voxels along its normal; a normal of zeros for none.

    From the voxel of the point outwards to both sides, and one step beyond the first that is found. row, patch : of the
    point's own voxel, as `find_patch` gives them.
    """
    found = (0.0, 0.0, 0.0, 0.0)
    nearest, last = np.inf, reach
    in_x, in_y, in_z = px / cell, py / cell, pz / cell
    here_x, here_y = np.int64(np.floor(in_x)) >> PATCH_BITS, np.int64(np.floor(in_y)) >> PATCH_BITS
    here_z = np.int64(np.floor(in_z))
    for step in range(reach + 1):
        if step > last:
            break
        for side in range(1 if step == 0 else 2):
            t = np.float64(step if side == 0 else -step)
            x = np.int64(np.floor(in_x + t * nx))
            y = np.int64(np.floor(in_y + t * ny))
            z = np.int64(np.floor(in_z + t * nz))
            if x >> PATCH_BITS != here_x or y >> PATCH_BITS != here_y or z != here_z:
                here_x, here_y, here_z = x >> PATCH_BITS, y >> PATCH_BITS, z
                row, patch = find_patch(x, y, z, rows, grid, corner)
            if row == 0:
                continue
            is_held, number = find_in_patch(x, y, row, patch, rows)
            if not is_held:
                continue
            ax, ay, az, mx, my, mz = _plane(row, number, x, y, z, cell, rows)
            cosine = ax * nx + ay * ny + az * nz
            if (cosine if is_signed else abs(cosine)) < least_cosine:
                continue
            distance = abs(ax * (mx - px) + ay * (my - py) + az * (mz - pz))
            last = min(last, step + 1)
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


@njit(nogil=True, cache=True)
def _partner_around(px, py, pz, own_row, own_patch, cell, reach, rows, grid, corner):
    """Plane of a voxel along the axes from that of a point, of the nearest ones the one whose mean is nearest.

    A normal of zeros for none. own_row, own_patch : of the point's voxel, as `find_patch` gives them.
    """
    found = (0.0, 0.0, 0.0, 0.0)
    nearest = np.inf
    x0, y0, z0 = np.int64(np.floor(px / cell)), np.int64(np.floor(py / cell)), np.int64(np.floor(pz / cell))
    here_x, here_y = x0 >> PATCH_BITS, y0 >> PATCH_BITS
    for step in range(reach + 1):
        if nearest < np.inf:
            break
        for side in range(1 if step == 0 else 6):
            t = step if side % 2 == 0 else -step
            x, y, z = x0 + t * (side // 2 == 0), y0 + t * (side // 2 == 1), z0 + t * (side // 2 == 2)
            row, patch = own_row, own_patch
            if x >> PATCH_BITS != here_x or y >> PATCH_BITS != here_y or z != z0:
                row, patch = find_patch(x, y, z, rows, grid, corner)
            if row == 0:
                continue
            is_held, number = find_in_patch(x, y, row, patch, rows)
            if not is_held:
                continue
            ax, ay, az, mx, my, mz = _plane(row, number, x, y, z, cell, rows)
            if ax == 0.0 and ay == 0.0 and az == 0.0:
                continue
            distance = (mx - px) ** 2 + (my - py) ** 2 + (mz - pz) ** 2
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


@njit(nogil=True, cache=True, inline="always")
def _is_asked(i, every, planes):
    """Whether a partner of point i is looked for; see `adjustment.Round`."""
    if every == 0:
        return planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0
    return i % every == 0


@njit(nogil=True, cache=True, inline="always")
def _is_near(place, normal, reaches, rows, grid, corner):
    """Whether a point, (x, y, z) in voxels, may have a partner: most of those that have none are far from any voxel."""
    along, around = np.float64(reaches[0]), np.float64(reaches[1])
    reach_x, reach_y, reach_z = along * abs(normal[0]), along * abs(normal[1]), along * abs(normal[2])
    if reach_x == 0.0 and reach_y == 0.0 and reach_z == 0.0:
        reach_x, reach_y, reach_z = around, around, around
    return is_near_voxels(place, (reach_x, reach_y, reach_z), rows, grid, corner)


@njit(nogil=True, cache=True)
def _place_some(
    first, points, normals, unknowns, R, every, cell, reaches, rows, grid, corner, planes, placed, owned
):
    """Place points from number `first` on that may have a partner, as many as there is room for.

    planes : of all points before them set to zeros, out; placed : (m, 6), out, points and normals, map frame; owned :
    (m, 3) uint64, out, their numbers, and row and patch of the voxels they are in. Patches are fetched meanwhile.
    Returns the number of the first point that is left, and how many were placed.
    """
    n = 0
    while first < points.shape[0] and n < placed.shape[0]:
        i, first = first, first + 1
        is_asked = _is_asked(i, every, planes)
        planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3] = 0.0, 0.0, 0.0, 0.0
        if not is_asked:
            continue
        for axis in range(3):
            a, b, c = R[axis, 0], R[axis, 1], R[axis, 2]
            placed[n, axis] = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] + unknowns[axis]
            placed[n, 3 + axis] = a * normals[i, 0] + b * normals[i, 1] + c * normals[i, 2]
        in_x, in_y, in_z = placed[n, 0] / cell, placed[n, 1] / cell, placed[n, 2] / cell
        normal = placed[n, 3], placed[n, 4], placed[n, 5]
        if every != 0 and not _is_near((in_x, in_y, in_z), normal, reaches, rows, grid, corner):
            continue
        x, y, z = np.int64(np.floor(in_x)), np.int64(np.floor(in_y)), np.int64(np.floor(in_z))
        row, patch = find_patch(x, y, z, rows, grid, corner)
        if row != 0:
            fetch(rows[row, WORDS] + np.uint64(32) * patch)
            fetch(rows[row, FIRSTS] + np.uint64(16) * patch)
        owned[n, 0], owned[n, 1], owned[n, 2] = i, row, patch
        n += 1
    return first, n


@njit(nogil=True, cache=True)
def _fetch_planes(placed, owned, cell, rows):
    """Fetch the planes of the voxels that points are in; see `_place_some`."""
    for k in range(placed.shape[0]):
        row, patch = owned[k, 1], owned[k, 2]
        if row == 0:
            continue
        x, y = np.int64(np.floor(placed[k, 0] / cell)), np.int64(np.floor(placed[k, 1] / cell))
        is_held, number = find_in_patch(x, y, row, patch, rows)
        if is_held:
            fetch(rows[row, NORMALS] + np.uint64(12) * number)
            fetch(rows[row, MEANS] + np.uint64(3) * number)


@njit(nogil=True, cache=True)
def find_partners(
    points, normals, unknowns, every, cell, reaches, least_cosine, is_signed, rows, grid, corner, planes
):  # fmt: skip
    """Find for every so many points of a scan the plane of the map that it lies on.

    points, normals : (n, 3) float64, sensor frame, m; a normal of zeros where there is none.
    unknowns : (6,), the pose: x, y, z, roll, pitch, heading. every : see `adjustment.Round`.
    reaches : how many voxels a partner may lie away, along the normal of a point, and along the axes from one without.
    least_cosine : of the angle between the normals of point and voxel.
    planes : (n, 4) float64, out, unit normal and its scalar product with a point of the plane, map frame; zeros for
    none, and for the points between.

    A map is larger than what is near the processor: what a block of points will ask for is fetched while the block is
    placed, and looked at afterwards.
    """
    R, _ = _rotation(unknowns[3:])
    along, around = reaches
    placed, owned = np.empty((BLOCK, 6)), np.empty((BLOCK, 3), np.uint64)
    first = 0
    while first < points.shape[0]:
        first, n = _place_some(
            first, points, normals, unknowns, R, every, cell, reaches, rows, grid, corner, planes, placed, owned
        )  # fmt: skip
        _fetch_planes(placed[:n], owned, cell, rows)
        for k in range(n):
            px, py, pz = placed[k, 0], placed[k, 1], placed[k, 2]
            nx, ny, nz = placed[k, 3], placed[k, 4], placed[k, 5]
            i, row, patch = owned[k, 0], owned[k, 1], owned[k, 2]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                plane = _partner_around(px, py, pz, row, patch, cell, around, rows, grid, corner)
            else:
                plane = _partner_along(
                    px, py, pz, nx, ny, nz, row, patch, cell, along, least_cosine, is_signed, rows, grid, corner
                )  # fmt: skip
            planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3] = plane


@njit(nogil=True, cache=True)
def _rotation(angles):
    """R = Rz(heading) Ry(pitch) Rx(roll), and the axes that roll, pitch and heading turn about, rows, map frame."""
    cr, sr = np.cos(angles[0]), np.sin(angles[0])
    cp, sp = np.cos(angles[1]), np.sin(angles[1])
    ch, sh = np.cos(angles[2]), np.sin(angles[2])
    rotation, axes = np.empty((3, 3)), np.zeros((3, 3))
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = -sp, cp * sr, cp * cr
    axes[0, 0], axes[0, 1], axes[0, 2] = rotation[0, 0], rotation[1, 0], rotation[2, 0]
    axes[1, 0], axes[1, 1] = -sh, ch
    axes[2, 2] = 1.0
    return rotation, axes


@njit(nogil=True, cache=True)
def _equations(points, planes, unknowns, gate, equations):
    """Distances of points from their planes, and how they fall with each unknown, times the root of Tukey's weight.

    points : (3, n), sensor frame, m; planes : (4, n); unknowns : (6,); gate : no weight from this distance on, m;
    equations : (7, n), out: a row for each of x, y, z, roll, pitch, heading, then the distances.
    """
    R, axes = _rotation(unknowns[3:])
    tx, ty, tz = unknowns[0], unknowns[1], unknowns[2]
    for i in range(points.shape[1]):
        x, y, z = points[0, i], points[1, i], points[2, i]
        nx, ny, nz = planes[0, i], planes[1, i], planes[2, i]
        dx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        dy = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        dz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        distance = planes[3, i] - nx * (dx + tx) - ny * (dy + ty) - nz * (dz + tz)
        share = distance / gate
        root = max(1.0 - share * share, 0.0)
        # n . (axis x d) = axis . (d x n)
        cx, cy, cz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
        equations[0, i], equations[1, i], equations[2, i] = root * nx, root * ny, root * nz
        equations[3, i] = root * (axes[0, 0] * cx + axes[0, 1] * cy + axes[0, 2] * cz)
        equations[4, i] = root * (axes[1, 0] * cx + axes[1, 1] * cy)
        equations[5, i] = root * cz
        equations[6, i] = root * distance


@njit(nogil=True, cache=True, fastmath={"reassoc", "contract"})
def _products(equations, products):
    """All scalar products of rows, (7, n), with each other: (7, 7), out."""
    for j in range(7):
        for k in range(j, 7):
            total = 0.0
            for i in range(equations.shape[1]):
                total += equations[j, i] * equations[k, i]
            products[j, k] = products[k, j] = total


@njit(nogil=True, cache=True)
def _with_planes(points, planes):
    """The points that have a plane, and their planes, as columns: (3, m) and (4, m); and their numbers, (m,)."""
    numbers = np.empty(points.shape[0], np.int64)
    m = 0
    for i in range(points.shape[0]):
        if planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0:
            numbers[m] = i
            m += 1
    numbers = numbers[:m]
    some, of_some = np.empty((3, m)), np.empty((4, m))
    for k in range(m):
        for axis in range(3):
            some[axis, k] = points[numbers[k], axis]
        for axis in range(4):
            of_some[axis, k] = planes[numbers[k], axis]
    return some, of_some, numbers


@njit(nogil=True, cache=True)
def adjust(points, planes, unknowns, start, start_weights, gate, n_steps, at_rest):
    """Gauss-Newton steps that shorten the distances n . r of points from their planes, with Tukey's weights.

    points : (n, 3), sensor frame, m; planes : (n, 4), as `find_partners` made them; unknowns : (6,), x, y, z, roll,
    pitch, heading, in and out; start : (6,), which is an observation of them with weights start_weights : (6,); gate :
    no weight from this distance on, m; n_steps : at most; at_rest : a step that moves less, m, and turns less than a
    hundredth of it, rad, is the last.
    """
    some, of_some, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    for _ in range(n_steps):
        _equations(some, of_some, unknowns, gate, equations)
        _products(equations, products)
        right_side = products[:6, 6] - start_weights * (unknowns - start)
        step = np.linalg.solve(products[:6, :6] + np.diag(start_weights), right_side)
        unknowns += step
        if np.abs(step[:3]).max() < at_rest and np.abs(step[3:]).max() < 0.01 * at_rest:
            break


@njit(nogil=True, cache=True)
def weigh(points, planes, unknowns, gate, normal_matrix, residuals, weights):
    """What points and their planes say of an adjusted pose; the first four as for `adjust`.

    normal_matrix : (6, 6), residuals : (n,), m, infinite without a plane, and weights : (n,), 0 without one. All out.
    """
    some, of_some, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    _equations(some, of_some, unknowns, gate, equations)
    _products(equations, products)
    normal_matrix[:] = products[:6, :6]
    residuals[:], weights[:] = np.inf, 0.0
    R, _ = _rotation(unknowns[3:])
    for k in range(len(numbers)):
        x, y, z = some[0, k], some[1, k], some[2, k]
        nx, ny, nz, offset = of_some[0, k], of_some[1, k], of_some[2, k], of_some[3, k]
        offset -= nx * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + unknowns[0])
        offset -= ny * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + unknowns[1])
        offset -= nz * (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + unknowns[2])
        residuals[numbers[k]] = offset
        root = max(1.0 - (offset / gate) ** 2, 0.0)
        weights[numbers[k]] = root * root


@njit(nogil=True, cache=True)
def sum_gradients(points, planes, groups, unknowns, factors, sums):
    """Add factor times gradient of each point's distance to the sum of its group.

    points : (n, 3), sensor frame, m; planes : (n, 4); groups : (n,), numbers, below 0 for none; unknowns : (6,), the
    pose; factors : (n,); sums : (n_groups, 6), in zeros, out.
    """
    R, axes = _rotation(unknowns[3:])
    for i in range(points.shape[0]):
        group = groups[i]
        if group < 0:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = planes[i, 0], planes[i, 1], planes[i, 2]
        dx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        dy = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        dz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        cx, cy, cz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
        sums[group, 0] += factors[i] * nx
        sums[group, 1] += factors[i] * ny
        sums[group, 2] += factors[i] * nz
        sums[group, 3] += factors[i] * (axes[0, 0] * cx + axes[0, 1] * cy + axes[0, 2] * cz)
        sums[group, 4] += factors[i] * (axes[1, 0] * cx + axes[1, 1] * cy)
        sums[group, 5] += factors[i] * cz


@njit(nogil=True, cache=True)
def _bounds(n):
    """Unit vectors between the n sectors of a half turn, (n - 1, 2)."""
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
    """Number of a key among the `n` known ones, (m,) in `keys`, or `n` for one that is new and now the next.

    table : a power of two of numbers, more than twice as many as there can be keys; -1 where there is none.
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
    """Number the clusters of points of one facing in one cube, and the walls of one facing and depth; see `covariance`.

    points : (n, 3), sensor frame, m; planes : (n, 4); weights : (n,), those with 0 are in no group; position : (3,), of
    the sensor, m; edge : of a cube, and of a depth, m; n_facings : by azimuth, an even number; steepest : vertical part
    of a normal beyond which it faces up or down. clusters, walls : (n,), out, -1 for none. Returns how many there are
    of each.
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
    """Count the wall points of each facing, and those of them that are found.

    normals : (n, 3), sensor frame, zeros for none; residuals : (n,), m, infinite without a plane; rotation : (3, 3), of
    the sensor; level : vertical part of a normal from which on it is no wall's; found_within : m; n_points, n_found :
    (facings,) int64, of pi together, in zeros, out.
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
