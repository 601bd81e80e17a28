"""Compiled loops of a map update: which voxels the rays of an observation hit and missed (see `evidence`).

`table` is a `VoxelTable`. `evidence` are arrays of its voxels: log_odds (m,) float32; n_hits, n_misses (m,) int32;
hit_in (m, 2) int32, the first and the last observation that hit each; seen_in (m,) int32, the last that saw it; or -1.
"""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.lookup_kernels import PATCH_BITS, find_in_patch, find_patch, is_near_voxels, plane_of_voxel


@njit(nogil=True, cache=True, counts_references=False)
def _is_miss(origin, along, length, plane, voxel, cell, margin, least_cosine, reach):
    """Whether a ray saw through the surface in a voxel: as `evidence.is_miss`, its definition."""
    nx, ny, nz, mx, my, mz = plane
    ox, oy, oz = origin
    ax, ay, az = along
    has_normal = nx != 0.0 or ny != 0.0 or nz != 0.0
    if has_normal:
        cosine = nx * ax + ny * ay + nz * az
        steepness = abs(cosine)
        if steepness < least_cosine:
            return False
        at = ((mx - ox) * nx + (my - oy) * ny + (mz - oz) * nz) / cosine
    else:
        steepness = 0.5
        at = (mx - ox) * ax + (my - oy) * ay + (mz - oz) * az
    if not 0.0 < at < min(length, reach):
        return False
    if at * steepness < margin or (length - at) * steepness < margin:
        return False
    x, y, z = ox + at * ax, oy + at * ay, oz + at * az
    if (
        np.int64(np.floor(x / cell)) != voxel[0]
        or np.int64(np.floor(y / cell)) != voxel[1]
        or np.int64(np.floor(z / cell)) != voxel[2]
    ):
        return False
    return has_normal or (x - mx) ** 2 + (y - my) ** 2 + (z - mz) ** 2 <= (0.5 * cell) ** 2


@njit(nogil=True, cache=True, counts_references=False)
def _add(k, weight, lowest, highest, log_odds):
    log_odds[k] = min(max(log_odds[k] + np.float32(weight), np.float32(lowest)), np.float32(highest))


@njit(nogil=True, cache=True, counts_references=False)
def _mark_hits(end, scan, cell, weights, table, evidence):
    """Count a hit of the voxel that a ray ended in, and of the 26 around it, once per observation."""
    hit, _, lowest, highest = weights
    log_odds, n_hits, _, hit_in, seen_in = evidence
    x0 = np.int64(np.floor(end[0] / cell))
    y0 = np.int64(np.floor(end[1] / cell))
    z0 = np.int64(np.floor(end[2] / cell))
    here_x = here_y = here_z = -(2**40)  # of the patch looked up last
    patch = np.int64(-1)
    for z in range(z0 - 1, z0 + 2):
        for y in range(y0 - 1, y0 + 2):
            for x in range(x0 - 1, x0 + 2):
                if x >> PATCH_BITS != here_x or y >> PATCH_BITS != here_y or z != here_z:
                    here_x, here_y, here_z = x >> PATCH_BITS, y >> PATCH_BITS, z
                    patch = find_patch(x, y, z, table)
                k = find_in_patch(x, y, patch, table) if patch >= 0 else -1
                if k >= 0 and seen_in[k] != scan:
                    seen_in[k] = scan
                    n_hits[k] += 1
                    if hit_in[k, 0] < 0:
                        hit_in[k, 0] = scan
                    hit_in[k, 1] = scan
                    _add(k, hit, lowest, highest, log_odds)


@njit(nogil=True, cache=True)
def _first_border(place, along, cell):
    """Along one axis: voxel, step, distance along the ray to the next border, and between two borders, m."""
    index = np.int64(np.floor(place / cell))
    if along > 0.0:
        return index, 1, ((index + 1) * cell - place) / along, cell / along
    if along < 0.0:
        return index, -1, (index * cell - place) / along, -cell / along
    return index, 0, np.inf, np.inf


@njit(nogil=True, cache=True, counts_references=False)
def _walk(origin, end, scan, cell, margin, least_cosine, reach, weights, table, evidence):
    """Add a miss to each voxel a ray saw through (Amanatides and Woo 1987), if none of its observation judged it."""
    _, miss, lowest, highest = weights
    log_odds, _, n_misses, _, seen_in = evidence
    dx, dy, dz = end[0] - origin[0], end[1] - origin[1], end[2] - origin[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return
    along = dx / length, dy / length, dz / length
    start = origin[0], origin[1], origin[2]
    x, step_x, to_x, every_x = _first_border(start[0], along[0], cell)
    y, step_y, to_y, every_y = _first_border(start[1], along[1], cell)
    z, step_z, to_z, every_z = _first_border(start[2], along[2], cell)
    stop = min(length - margin, reach)
    patch, is_another = np.int64(-1), True
    at = 0.0
    while at <= stop:
        if is_another:
            patch = find_patch(x, y, z, table)
        if patch >= 0:
            k = find_in_patch(x, y, patch, table)
            if k >= 0 and seen_in[k] != scan and _is_miss(
                start, along, length, plane_of_voxel(k, x, y, z, cell, table), (x, y, z), cell, margin, least_cosine,
                reach,
            ):  # fmt: skip
                seen_in[k] = scan
                n_misses[k] += 1
                _add(k, miss, lowest, highest, log_odds)
        if to_x <= to_y and to_x <= to_z:
            is_another = (x + step_x) >> PATCH_BITS != x >> PATCH_BITS
            x, at, to_x = x + step_x, to_x, to_x + every_x
        elif to_y <= to_z:
            is_another = (y + step_y) >> PATCH_BITS != y >> PATCH_BITS
            y, at, to_y = y + step_y, to_y, to_y + every_y
        else:
            z, at, to_z, is_another = z + step_z, to_z, to_z + every_z, True


@njit(nogil=True, cache=True, counts_references=False)
def add_observation(origin, ends, scan, cell, margins, least_cosine, reach, weights, table, evidence):
    """Add one observation to the evidence of the voxels: first hits, then misses.

    ends : (n, 3) float64, local frame, m; scan : number of the observation, rising from 0; margins : (n,) float64, m,
    how far behind a surface each ray must end; weights : (hit, miss, lowest, highest).
    """
    for i in range(ends.shape[0]):
        dx, dy, dz = ends[i, 0] - origin[0], ends[i, 1] - origin[1], ends[i, 2] - origin[2]
        if dx * dx + dy * dy + dz * dz <= reach * reach:
            _mark_hits(ends[i], scan, cell, weights, table, evidence)
    for i in range(ends.shape[0]):
        _walk(origin, ends[i], scan, cell, margins[i], least_cosine, reach, weights, table, evidence)


@njit(nogil=True, cache=True, counts_references=False)
def _is_far(point, reach, cell, table):
    """Whether the voxel of a point is farther than `reach` voxels, along each axis, from any that is held."""
    place = point[0] / cell, point[1] / cell, point[2] / cell
    reaches = np.float64(reach), np.float64(reach), np.float64(reach)
    if not is_near_voxels(place, reaches, table):
        return True
    x0, y0, z0 = np.int64(np.floor(place[0])), np.int64(np.floor(place[1])), np.int64(np.floor(place[2]))
    here_x = here_y = here_z = -(2**40)
    patch = np.int64(-1)
    for z in range(z0 - reach, z0 + reach + 1):
        for y in range(y0 - reach, y0 + reach + 1):
            for x in range(x0 - reach, x0 + reach + 1):
                if x >> PATCH_BITS != here_x or y >> PATCH_BITS != here_y or z != here_z:
                    here_x, here_y, here_z = x >> PATCH_BITS, y >> PATCH_BITS, z
                    patch = find_patch(x, y, z, table)
                if patch >= 0 and find_in_patch(x, y, patch, table) >= 0:
                    return False
    return True


@njit(nogil=True, cache=True, counts_references=False)
def are_far_from_voxels(points, reach, cell, table, is_far):
    """Find the points, (n, 3) float64, local frame, m, that are far from any voxel; is_far : (n,) bool, out."""
    for i in range(points.shape[0]):
        is_far[i] = _is_far(points[i], reach, cell, table)


@njit(nogil=True, cache=True, counts_references=False)
def hide_known_surfaces(origin, ends, clearance, most, cell, table, heights, first, edge, is_hiding):
    """Find the rays whose extension, `clearance` to `most` (m) behind their end, meets a voxel or the map's ground.

    ends : (n, 3) float64, local frame, m; heights : (levels, ny, nx) float32, ground in cells of `edge` (m) from number
    `first` on, NaN where it is not known. The ray is looked at in steps of half a voxel.
    """
    step = 0.5 * cell
    n_steps = np.int64((most - clearance) / step)
    for i in range(ends.shape[0]):
        is_hiding[i] = False
        dx, dy, dz = ends[i, 0] - origin[0], ends[i, 1] - origin[1], ends[i, 2] - origin[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0.0:
            continue
        dx, dy, dz = dx / length, dy / length, dz / length
        here_x = here_y = here_z = np.int64(-(2**40))
        patch = np.int64(-1)
        for k in range(n_steps):
            t = clearance + k * step
            x, y, z = ends[i, 0] + t * dx, ends[i, 1] + t * dy, ends[i, 2] + t * dz
            column = np.int64(np.floor(x / edge)) - first[0]
            line = np.int64(np.floor(y / edge)) - first[1]
            if not (0 <= column < heights.shape[2] and 0 <= line < heights.shape[1]):
                break
            for level in range(heights.shape[0]):
                if abs(z - heights[level, line, column]) <= edge:  # comparisons with NaN are false
                    is_hiding[i] = is_hiding[i] or z <= heights[level, line, column]
            vx, vy, vz = np.int64(np.floor(x / cell)), np.int64(np.floor(y / cell)), np.int64(np.floor(z / cell))
            if vx >> PATCH_BITS != here_x or vy >> PATCH_BITS != here_y or vz != here_z:
                here_x, here_y, here_z = vx >> PATCH_BITS, vy >> PATCH_BITS, vz
                patch = find_patch(vx, vy, vz, table)
            if is_hiding[i] or (patch >= 0 and find_in_patch(vx, vy, patch, table) >= 0):
                is_hiding[i] = True
                break
