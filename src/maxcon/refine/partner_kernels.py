# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: partners, the planes of the map that scan points lie on. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.lookup_kernels import (
    FIRSTS,
    MEANS,
    NORMALS,
    PATCH_BITS,
    WORDS,
    fetch,
    find_in_patch,
    find_patch,
    is_near_voxels,
    plane_of_voxel,
)
from maxcon.refine.kernels import rotation_and_axes

# Points whose planes are prefetched together.
BLOCK = 32


@njit(nogil=True, cache=True)
def _partner_along(px, py, pz, nx, ny, nz, row, patch, cell, reach, least_cosine, is_signed, rows, grid, corner):
    """Plane (normal, offset) nearest to a point among the voxels along its normal; a normal of zeros for none.

    Looked for from the voxel of the point outwards to both sides, to one step beyond the first partner. row, patch : of
    the point's own voxel, as `find_patch` gives them; the other arguments as for `find_partners`.
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
            ax, ay, az, mx, my, mz = plane_of_voxel(row, number, x, y, z, cell, rows)
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
    """Plane (normal, offset) of the nearest voxel along the axes from that of a point; a normal of zeros for none.

    Of voxels equally many steps away, the one whose mean is nearest. own_row, own_patch : of the point's voxel, as
    `find_patch` gives them.
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
            ax, ay, az, mx, my, mz = plane_of_voxel(row, number, x, y, z, cell, rows)
            if ax == 0.0 and ay == 0.0 and az == 0.0:
                continue
            distance = (mx - px) ** 2 + (my - py) ** 2 + (mz - pz) ** 2
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


@njit(nogil=True, cache=True, inline="always")
def _is_asked(i, every, planes):
    """Whether a partner of point i is looked for in this pass; see `adjustment.Pass`."""
    if every == 0:
        return planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0
    return i % every == 0


@njit(nogil=True, cache=True, inline="always")
def _is_near(place, normal, reaches, rows, grid, corner):
    """Whether a point at `place`, in voxels, may have a partner: most that have none are far from any voxel."""
    along, around = np.float64(reaches[0]), np.float64(reaches[1])
    reach_x, reach_y, reach_z = along * abs(normal[0]), along * abs(normal[1]), along * abs(normal[2])
    if reach_x == 0.0 and reach_y == 0.0 and reach_z == 0.0:
        reach_x, reach_y, reach_z = around, around, around
    return is_near_voxels(place, (reach_x, reach_y, reach_z), rows, grid, corner)


@njit(nogil=True, cache=True)
def _place_some(first, points, normals, unknowns, R, every, cell, reaches, rows, grid, corner, planes, placed, owned):
    """Transform points from number `first` on into the map frame, if they may have a partner, until `placed` is full.

    planes : set to zeros for all points that were looked at, out; placed : (m, 6), out, points and normals, map frame;
    owned : (m, 3) uint64, out, their numbers, and row and patch of the voxels they are in. Patches are prefetched.
    Returns the number of the first point that was not looked at, and how many were placed.
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
    """Prefetch the planes of the voxels that points are in; arguments as `_place_some` wrote them."""
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
    """Find partners: for one of `every` points of a scan, the plane of the map that it lies on.

    points, normals : (n, 3) float64, sensor frame, m; a normal of zeros where there is none.
    unknowns : (6,), the pose: x, y, z, roll, pitch, heading, m and rad. every : see `adjustment.Pass`.
    cell : edge of a voxel, m. rows, grid, corner : of a `VoxelLookup`, the map.
    reaches : how many voxels a partner may lie away, along the normal of a point, and along the axes from one without.
    least_cosine : of the angle between the normals of point and voxel.
    is_signed : whether the map's normals have a side; otherwise n and -n mean the same.
    planes : (n, 4) float64, in and out, unit normal and its scalar product with a point of the plane, map frame; zeros
    for none, and for the points between.

    A map is larger than the processor's cache: what a block of points will look up is prefetched while the block is
    transformed.
    """
    R, _ = rotation_and_axes(unknowns[3:])
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
