# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled loops of map building: moments of voxels, planes of neighbourhoods, corrected points."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.scan.plane_kernels import covariance, plane_normal


@njit(nogil=True, cache=True)
def gather_points(order, keys, inside, sides, counts, sums, outers, side_sums):
    """Sum the points of each voxel.

    order : (n,) numbers of the points by ascending key; keys : (n,) int64; inside : (n, 3) float32,
    position in the voxel, m; sides : (n, 3) float32, direction to the sensor or normal.
    counts (n,), sums (n, 3), outers (n, 6), side_sums (n, 3) : out, zeroed; the first rows are filled.
    Returns the number of voxels.
    """
    voxel = -1
    previous = np.int64(0)
    for i in order:
        if voxel < 0 or keys[i] != previous:
            voxel += 1
            previous = keys[i]
        counts[voxel] += 1
        x, y, z = np.float64(inside[i, 0]), np.float64(inside[i, 1]), np.float64(inside[i, 2])
        sums[voxel, 0] += x
        sums[voxel, 1] += y
        sums[voxel, 2] += z
        outers[voxel, 0] += x * x
        outers[voxel, 1] += x * y
        outers[voxel, 2] += x * z
        outers[voxel, 3] += y * y
        outers[voxel, 4] += y * z
        outers[voxel, 5] += z * z
        for axis in range(3):
            side_sums[voxel, axis] += sides[i, axis]
    return voxel + 1


@njit(nogil=True, cache=True)
def _add_shifted(weight, count, sums, outers, dx, dy, dz, total_sums, total_outers):
    """Add a voxel's moments, times a weight, moved by (dx, dy, dz)."""
    n = weight * count
    sx, sy, sz = weight * sums[0], weight * sums[1], weight * sums[2]
    total_sums[0] += sx + n * dx
    total_sums[1] += sy + n * dy
    total_sums[2] += sz + n * dz
    total_outers[0] += weight * outers[0] + 2.0 * sx * dx + n * dx * dx
    total_outers[1] += weight * outers[1] + sx * dy + sy * dx + n * dx * dy
    total_outers[2] += weight * outers[2] + sx * dz + sz * dx + n * dx * dz
    total_outers[3] += weight * outers[3] + 2.0 * sy * dy + n * dy * dy
    total_outers[4] += weight * outers[4] + sy * dz + sz * dy + n * dy * dz
    total_outers[5] += weight * outers[5] + 2.0 * sz * dz + n * dz * dz
    return n


@njit(nogil=True, cache=True)
def merge_voxels(order, parents, shifts, in_counts, in_sums, in_outers, counts, sums, outers):
    """Sum the moments of voxels that share a parent.

    order : voxels by ascending parent; parents : (n,) int64; shifts : (n, 3) float64, m, from the
    parent's corner to the voxel's. counts, sums, outers : out, zeroed. Returns the number of parents.
    """
    voxel = -1
    previous = np.int64(0)
    for i in order:
        if voxel < 0 or parents[i] != previous:
            voxel += 1
            previous = parents[i]
        counts[voxel] += _add_shifted(
            1.0, in_counts[i], in_sums[i], in_outers[i], shifts[i, 0], shifts[i, 1], shifts[i, 2],
            sums[voxel], outers[voxel],
        )  # fmt: skip
    return voxel + 1


@njit(nogil=True, cache=True)
def _reach_line(line, key, keys, row, layer, reach, first):
    """Find one of the (2 reach + 1)^2 lines of voxels around a voxel: its steps (z, y), middle key and first voxel.

    key : of the voxel; they ascend from call to call. first : ((2 reach + 1)^2,) int64, where each line was reached
    last, zeroed before the first call; in and out.
    """
    width = 2 * reach + 1
    dz, dy = line // width - reach, line % width - reach
    middle = key + dz * layer + dy * row
    k = first[line]
    while k < keys.shape[0] and keys[k] < middle - reach:
        k += 1
    first[line] = k
    return dz, dy, middle, k


@njit(nogil=True, cache=True)
def neighbourhood_planes(
    keys, counts, sums, outers, wanted, edge, row, layer, reach, count_cap, least_voxels, values, normals
):
    """Fit a plane to the points of the (2 reach + 1)^3 voxels around each voxel.

    keys : (n,) int64, ascending, (z layer + y row + x) of each voxel, rows padded by at least `reach`; counts (n,),
    sums (n, 3), outers (n, 6) : their moments; wanted : (n,) bool, whether the plane is asked for; edge : voxel edge,
    m; count_cap : a voxel weighs at most as many points; least_voxels : fewer occupied voxels leave the plane open.
    values, normals : (n, 3) float64, out: eigenvalues of the covariance, ascending, m^2, and unit normals; where
    the plane is open they stay as they are.
    """
    width = 2 * reach + 1
    n, first = keys.shape[0], np.zeros(width * width, np.int64)
    total_sums, total_outers = np.zeros(3), np.zeros(6)
    matrix, normal = np.zeros((3, 3)), np.zeros(3)
    for i in range(n):
        if not wanted[i]:
            continue
        total_sums[:] = 0.0
        total_outers[:] = 0.0
        weight_sum = 0.0
        n_voxels = 0
        for line in range(width * width):
            dz, dy, middle, k = _reach_line(line, keys[i], keys, row, layer, reach, first)
            while k < n and keys[k] <= middle + reach:
                dx = keys[k] - middle
                weight = min(1.0, count_cap / counts[k])
                weight_sum += _add_shifted(
                    weight, counts[k], sums[k], outers[k], dx * edge, dy * edge, dz * edge, total_sums, total_outers
                )
                n_voxels += 1
                k += 1
        if n_voxels >= least_voxels:
            covariance(weight_sum, total_sums, total_outers, matrix)
            values[i, 0], values[i, 1], values[i, 2] = plane_normal(matrix, normal)
            normals[i] = normal


@njit(nogil=True, cache=True)
def sums_near(keys, values, row, layer, reach, totals):
    """Sum values over the (2 reach + 1)^3 voxels around each voxel.

    keys : (n,) int64, ascending, rows padded by at least `reach`; values : (n, m) float64; totals : (n, m), out,
    zeroed.
    """
    width = 2 * reach + 1
    first = np.zeros(width * width, np.int64)
    for i in range(keys.shape[0]):
        for line in range(width * width):
            _, _, middle, k = _reach_line(line, keys[i], keys, row, layer, reach, first)
            while k < keys.shape[0] and keys[k] <= middle + reach:
                for j in range(values.shape[1]):
                    totals[i, j] += values[k, j]
                k += 1


# --- alignment ----------------------------------------------------------------------------------------------


@njit(nogil=True, cache=True)
def _rotated(x, y, z, a, b, c):
    """Vector (x, y, z) turned by a rotation vector (a, b, c), rad (Rodrigues)."""
    square = a * a + b * b + c * c
    once, twice = 1.0, 0.5
    if square > 1e-12:
        angle = np.sqrt(square)
        once, twice = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    ux, uy, uz = b * z - c * y, c * x - a * z, a * y - b * x
    vx, vy, vz = b * uz - c * uy, c * ux - a * uz, a * uy - b * ux
    return x + once * ux + twice * vx, y + once * uy + twice * vy, z + once * uz + twice * vz


@njit(nogil=True, cache=True)
def move(points, times, passes, centres, wholes, starts, steps, firsts, knot_centres, knots, moved):
    """Move points as `Corrections.motions` says.

    points : (n, 3), global, m; times : (n,), s; passes : (n,), numbers; then the arrays of `Corrections`; moved :
    (n, 3), out, global, m.
    """
    for i in range(points.shape[0]):
        number = passes[i]
        n_knots = firsts[number + 1] - firsts[number]
        at = (times[i] - starts[number]) / steps[number]
        before = min(max(np.int64(np.floor(at)), 0), n_knots - 2)
        part = min(max(at - before, 0.0), 1.0)
        knot = firsts[number] + before
        cx = (1.0 - part) * knot_centres[knot, 0] + part * knot_centres[knot + 1, 0]
        cy = (1.0 - part) * knot_centres[knot, 1] + part * knot_centres[knot + 1, 1]
        cz = (1.0 - part) * knot_centres[knot, 2] + part * knot_centres[knot + 1, 2]
        a, b, c = wholes[number, 3], wholes[number, 4], wholes[number, 5]
        rx, ry, rz = cx - centres[number, 0], cy - centres[number, 1], cz - centres[number, 2]
        tx, ty, tz = _rotated(rx, ry, rz, a, b, c)
        tx += wholes[number, 0] - rx
        ty += wholes[number, 1] - ry
        tz += wholes[number, 2] - rz
        for k in range(2):
            share = part if k == 1 else 1.0 - part
            j = knot + k
            p, q, r = knots[j, 3], knots[j, 4], knots[j, 5]
            rx, ry, rz = cx - knot_centres[j, 0], cy - knot_centres[j, 1], cz - knot_centres[j, 2]
            tx += share * (knots[j, 0] + q * rz - r * ry)
            ty += share * (knots[j, 1] + r * rx - p * rz)
            tz += share * (knots[j, 2] + p * ry - q * rx)
            a += share * p
            b += share * q
            c += share * r
        x, y, z = _rotated(points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz, a, b, c)
        moved[i, 0], moved[i, 1], moved[i, 2] = cx + tx + x, cy + ty + y, cz + tz + z
