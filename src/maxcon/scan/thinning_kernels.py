"""Compiled: one point of those in each cube of a grid, and the lowest points of level cells."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.geometry.pose import rotation_matrices

NONE = np.int32(-1)
# Factors of a 64-bit hash, large odd numbers; of its upper bits as many are taken as the table needs.
FACTOR_X, FACTOR_Y, FACTOR_Z = 0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9

# Rotation of the grid for points drawn by lot: parallel to no wall, whichever way the sensor is turned in a street.
ASKEW = rotation_matrices(0.31, -0.23, 0.47)

# Per metre: coordinates within one such step have the same hash.
LOT_STEPS = 65536.0


@njit(nogil=True, cache=True)
def _whole(value):
    """A whole float64 number as 64 bits; those that do not fit become the largest or the smallest that does."""
    if abs(value) < 2.0**62:
        return np.uint64(np.int64(value))
    return np.uint64(np.int64(2**62 if value > 0.0 else -(2**62)))


@njit(nogil=True, cache=True)
def _slot(x, y, z, shift):
    """Hash of whole float64 numbers (x, y, z), shifted right: where the search for a cube begins in a table."""
    mixed = _whole(x) * np.uint64(FACTOR_X)
    mixed ^= _whole(y) * np.uint64(FACTOR_Y)
    mixed ^= _whole(z) * np.uint64(FACTOR_Z)
    mixed ^= mixed >> np.uint64(29)
    return (mixed * np.uint64(FACTOR_X)) >> shift


@njit(nogil=True, cache=True)
def _comes_before(i, j, points, normals):
    """Whether point i is kept rather than j, all else being equal: by x, y, z, then by normal."""
    for axis in range(3):
        if points[i, axis] != points[j, axis]:
            return points[i, axis] < points[j, axis]
    for axis in range(3 if normals.shape[0] > 0 else 0):
        if normals[i, axis] != normals[j, axis]:
            return normals[i, axis] < normals[j, axis]
    return False


@njit(nogil=True, cache=True)
def _drawn(kept, cubes, most):
    """Those of some points, (m,), whose cubes, (m or more, 3), are drawn by lot, where there are more than `most`."""
    if kept.shape[0] <= most:
        return kept
    lots = np.empty(kept.shape[0])
    for cube in range(kept.shape[0]):
        lots[cube] = np.float64(_slot(cubes[cube, 0], cubes[cube, 1], cubes[cube, 2], np.uint64(32)))
    return kept[lots < np.partition(lots, most)[most]]


@njit(nogil=True, cache=True)
def one_per_cube(points, normals, edge, by_lot, most):
    """Numbers, (m,) int64, ascending, of one point of those in each cube, of more than `most` cubes in some by lot.

    points : (n, 3), m; normals : (n, 3), zeros where there is none, or (0, 3), if there are none at all.
    """
    n, have_any = points.shape[0], normals.shape[0] > 0
    n_bits = np.uint64(4)
    while (np.int64(1) << np.int64(n_bits)) < 2 * n:
        n_bits += np.uint64(1)
    shift, mask = np.uint64(64) - n_bits, (np.uint64(1) << n_bits) - np.uint64(1)
    table = np.full(1 << np.int64(n_bits), NONE)  # number of each cube among those met
    cubes, kept = np.empty((n, 3)), np.empty(n, np.int64)
    have_normals, ranks = np.empty(n, np.bool_), np.empty(n)  # of the points that are kept
    n_cubes = 0
    for i in range(n):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        if by_lot:
            px, py, pz = (
                ASKEW[0, 0] * px + ASKEW[0, 1] * py + ASKEW[0, 2] * pz,
                ASKEW[1, 0] * px + ASKEW[1, 1] * py + ASKEW[1, 2] * pz,
                ASKEW[2, 0] * px + ASKEW[2, 1] * py + ASKEW[2, 2] * pz,
            )
        in_x, in_y, in_z = px / edge, py / edge, pz / edge
        x, y, z = np.floor(in_x), np.floor(in_y), np.floor(in_z)
        if by_lot:
            x_fine, y_fine = np.floor(px * LOT_STEPS), np.floor(py * LOT_STEPS)
            rank = np.float64(_slot(x_fine, y_fine, np.floor(pz * LOT_STEPS), np.uint64(32)))
        else:
            dx, dy, dz = in_x - x - 0.5, in_y - y - 0.5, in_z - z - 0.5
            rank = dx * dx + dy * dy + dz * dz
        has_normal = have_any and ((normals[i, 0] != 0.0) | (normals[i, 1] != 0.0) | (normals[i, 2] != 0.0))
        slot = _slot(x, y, z, shift)
        while True:
            cube = np.int64(table[slot])
            if cube < 0:
                cube, is_kept = np.int64(n_cubes), True
                table[slot] = cube
                cubes[cube, 0], cubes[cube, 1], cubes[cube, 2] = x, y, z
                n_cubes += 1
                break
            if cubes[cube, 0] == x and cubes[cube, 1] == y and cubes[cube, 2] == z:
                is_kept = (has_normal > have_normals[cube]) | (
                    (has_normal == have_normals[cube]) & (rank < ranks[cube])
                )
                if has_normal == have_normals[cube] and rank == ranks[cube]:
                    is_kept = _comes_before(i, kept[cube], points, normals)
                break
            slot = (slot + np.uint64(1)) & mask
        if is_kept:
            kept[cube], have_normals[cube], ranks[cube] = i, has_normal, rank
    is_asked = np.zeros(n, np.bool_)
    is_asked[_drawn(kept[:n_cubes], cubes, most)] = True
    return np.flatnonzero(is_asked)


@njit(nogil=True, cache=True)
def lowest_of_cells(points, rotation, edge, nearest, farthest, thickness):
    """Find the means, (m, 3), sensor frame, of the lowest points in each cell of a level grid about the sensor.

    points : (n, 3), m; rotation : (3, 3), makes the sensor level; nearest, farthest : horizontally, m; thickness : so
    far above the lowest of their cell points are taken, m.
    """
    n = points.shape[0]
    reach = np.int64(np.ceil(farthest / edge))
    width = 2 * reach
    numbers = np.full(width * width, np.int32(-1))  # of each cell among those met
    cells, heights, lowest = np.empty(n, np.int32), np.empty(n), np.empty(n)
    n_cells = 0
    for i in range(n):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz
        square = x * x + y * y
        cells[i] = -1
        if square < nearest * nearest or square >= farthest * farthest:
            continue
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz
        place = (np.int64(np.floor(y / edge)) + reach) * width + np.int64(np.floor(x / edge)) + reach
        if numbers[place] < 0:
            numbers[place] = n_cells
            lowest[n_cells] = z
            n_cells += 1
        cells[i], heights[i] = numbers[place], z
        lowest[cells[i]] = min(lowest[cells[i]], z)
    sums = np.zeros((n_cells, 4))
    for i in range(n):
        cell = cells[i]
        if cell < 0 or heights[i] > lowest[cell] + thickness:
            continue
        for axis in range(3):
            sums[cell, axis] += points[i, axis]
        sums[cell, 3] += 1.0
    means = np.empty((n_cells, 3))
    m = 0
    for cell in numbers:
        if cell >= 0:
            for axis in range(3):
                means[m, axis] = sums[cell, axis] / sums[cell, 3]
            m += 1
    return means
