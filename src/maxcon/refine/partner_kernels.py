"""Compiled: partners, the planes of the map that scan points lie on; moments at a pose. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.lookup_kernels import PATCH_BITS, find_in_patch, find_patch, is_near_voxels, plane_of_voxel
from maxcon.refine.kernels import adjust, rotation_and_axes, turned


@njit(nogil=True, cache=True, counts_references=False)
def _partner_along(px, py, pz, nx, ny, nz, patch, cell, reach, least_cosine, is_signed, table):
    """Plane (normal, offset) nearest to a point among the voxels along its normal; a normal of zeros for none."""
    # Looked for from the voxel of the point outwards to both sides, to one step beyond the first partner.
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
                patch = find_patch(x, y, z, table)
            number = find_in_patch(x, y, patch, table) if patch >= 0 else -1
            if number < 0:
                continue
            ax, ay, az, mx, my, mz = plane_of_voxel(number, x, y, z, cell, table)
            cosine = ax * nx + ay * ny + az * nz
            if (cosine if is_signed else abs(cosine)) < least_cosine:
                continue
            distance = abs(ax * (mx - px) + ay * (my - py) + az * (mz - pz))
            last = min(last, step + 1)
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


@njit(nogil=True, cache=True, counts_references=False)
def _partner_around(px, py, pz, own_patch, cell, reach, table):
    """Plane (normal, offset) of the nearest voxel along the axes, then the nearest mean; a normal of zeros for none."""
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
            patch = own_patch
            if x >> PATCH_BITS != here_x or y >> PATCH_BITS != here_y or z != z0:
                patch = find_patch(x, y, z, table)
            number = find_in_patch(x, y, patch, table) if patch >= 0 else -1
            if number < 0:
                continue
            ax, ay, az, mx, my, mz = plane_of_voxel(number, x, y, z, cell, table)
            if ax == 0.0 and ay == 0.0 and az == 0.0:
                continue
            distance = (mx - px) ** 2 + (my - py) ** 2 + (mz - pz) ** 2
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


@njit(nogil=True, cache=True, counts_references=False)
def _is_near(place, normal, reaches, table):
    """Whether a point at `place`, in voxels, may have a partner: most that have none are far from any voxel."""
    along, around = np.float64(reaches[0]), np.float64(reaches[1])
    reach_x, reach_y, reach_z = along * abs(normal[0]), along * abs(normal[1]), along * abs(normal[2])
    if reach_x == 0.0 and reach_y == 0.0 and reach_z == 0.0:
        reach_x, reach_y, reach_z = around, around, around
    return is_near_voxels(place, (reach_x, reach_y, reach_z), table)


@njit(nogil=True, cache=True)
def find_partners(points, normals, unknowns, cell, reaches, least_cosine, is_signed, table):
    """Find partners: the plane of the map that each point of a scan lies on.

    points, normals : (n, 3) float64, sensor frame, m; a normal of zeros where there is none.
    unknowns : (6,), the pose: x, y, z, roll, pitch, heading, m and rad.
    cell : edge of a voxel, m. table : of the map's tiles, see `VoxelTable`.
    reaches : how many voxels a partner may lie away, along the normal of a point, and along the axes from one without.
    least_cosine : of the angle between the normals of point and voxel.
    is_signed : whether the map's normals have a side; otherwise n and -n mean the same.
    Returns planes, (n, 4): unit normal and its scalar product with a point of the plane, map frame; zeros for none.
    """
    R, _ = rotation_and_axes(unknowns[3:])
    planes = np.zeros((points.shape[0], 4))
    _find_all(points, normals, R, unknowns, cell, reaches, least_cosine, is_signed, table, planes)
    return planes


@njit(nogil=True, cache=True, counts_references=False)
def _find_all(points, normals, R, unknowns, cell, reaches, least_cosine, is_signed, table, planes):
    """Find partners, given the rotation (3, 3) of the pose."""
    along, around = reaches
    for i in range(points.shape[0]):
        px, py, pz = turned(R, (points[i, 0], points[i, 1], points[i, 2]))
        px, py, pz = px + unknowns[0], py + unknowns[1], pz + unknowns[2]
        nx, ny, nz = turned(R, (normals[i, 0], normals[i, 1], normals[i, 2]))
        in_x, in_y, in_z = px / cell, py / cell, pz / cell
        if not _is_near((in_x, in_y, in_z), (nx, ny, nz), reaches, table):
            continue
        patch = find_patch(np.int64(np.floor(in_x)), np.int64(np.floor(in_y)), np.int64(np.floor(in_z)), table)
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            plane = _partner_around(px, py, pz, patch, cell, around, table)
        else:
            plane = _partner_along(px, py, pz, nx, ny, nz, patch, cell, along, least_cosine, is_signed, table)
        planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3] = plane


@njit(nogil=True, cache=True)
def adjust_in_passes(
    points, normals, unknowns, start_weights, passes, cell, least_cosine, is_signed, n_steps, at_rest, table
):
    """Find partners and adjust the pose to them in turns; the planes, (m, 4), of the points of the last pass.

    unknowns : (6,), in and out; passes : (k, 4), of each the reaches along and around, the gate, m, and that one point
    of so many is used; the other arguments as of `find_partners` and `adjust`.
    """
    first, planes = unknowns.copy(), np.empty((0, 4))
    for k in range(passes.shape[0]):
        reaches, every = (np.int64(passes[k, 0]), np.int64(passes[k, 1])), np.int64(passes[k, 3])
        some, facing = points[::every].copy(), normals[::every].copy()
        planes = find_partners(some, facing, unknowns, cell, reaches, least_cosine, is_signed, table)
        adjust(some, planes, unknowns, first, start_weights, passes[k, 2], n_steps, at_rest)
    return planes


@njit(nogil=True, cache=True)
def add_moments(points, normals, unknowns, cell, weights, is_signed, by_points, table, moments):
    """Add count, Nxx, Nxy and Nyy (equation (4)) of the matches of a scan at a pose, whatever its cell, to moments.

    points, normals : (n, 3) float64, sensor frame, m; a normal of zeros where there is none; unknowns : (6,), x, y, z,
    roll, pitch, heading, m and rad; cell : edge of a voxel, m; weights : of a match by the cosine of its normals (1) or
    whatever that is (0), and of one whose scan point has no normal; is_signed : whether the map's normals have a side;
    by_points : whether a match counts as often as the voxel has map points; table : of the map's tiles, see
    `VoxelTable`; moments : (4,).
    """
    R, _ = rotation_and_axes(unknowns[3:])
    _add_all(points, normals, R, unknowns, cell, weights, is_signed, by_points, table, moments)


@njit(nogil=True, cache=True, counts_references=False)
def _add_all(points, normals, R, unknowns, cell, weights, is_signed, by_points, table, moments):
    """Add the moments, given the rotation (3, 3) of the pose."""
    by_cosine, without_normal = weights
    counts = table[9]
    for i in range(points.shape[0]):
        dx, dy, dz = turned(R, (points[i, 0], points[i, 1], points[i, 2]))
        x, y = np.int64(np.floor((dx + unknowns[0]) / cell)), np.int64(np.floor((dy + unknowns[1]) / cell))
        z = np.int64(np.floor((dz + unknowns[2]) / cell))
        patch = find_patch(x, y, z, table)
        number = find_in_patch(x, y, patch, table) if patch >= 0 else -1
        if number < 0:
            continue
        mx, my, mz, _, _, _ = plane_of_voxel(number, x, y, z, cell, table)
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        weight = 1.0
        if a == 0.0 and b == 0.0 and c == 0.0:
            weight = without_normal
        elif by_cosine != 0.0:
            nx, ny, nz = turned(R, (a, b, c))
            cosine = nx * mx + ny * my + nz * mz
            weight = max(0.0, cosine) if is_signed else abs(cosine)
        times = np.float64(counts[number]) if by_points else 1.0
        weight *= times
        moments[0] += times
        moments[1] += weight * mx * mx
        moments[2] += weight * mx * my
        moments[3] += weight * my * my
