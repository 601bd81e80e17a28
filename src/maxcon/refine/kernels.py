# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: least squares of the distances of scan points from planes of the map. Arrays in, arrays out."""

import numpy as np
from numba import njit

__all__ = ["adjust", "rotation_and_axes", "sum_gradients", "weigh"]


@njit(nogil=True, cache=True)
def rotation_and_axes(angles):
    """R = Rz(heading) Ry(pitch) Rx(roll) of (roll, pitch, heading), rad; and their axes, rows, (3, 3), map frame."""
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
    """Signed distances of points from their planes, and minus their derivatives, times the root of Tukey's weight.

    points : (3, n), sensor frame, m; planes : (4, n); unknowns : (6,); gate : no weight from this distance on, m;
    equations : (7, n), out: a row for each of x, y, z, roll, pitch, heading, then the distances.
    """
    R, axes = rotation_and_axes(unknowns[3:])
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
    """Write the scalar products of all rows of `equations`, (7, n), with each other, (7, 7)."""
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
    used_points, used_planes = np.empty((3, m)), np.empty((4, m))
    for k in range(m):
        for axis in range(3):
            used_points[axis, k] = points[numbers[k], axis]
        for axis in range(4):
            used_planes[axis, k] = planes[numbers[k], axis]
    return used_points, used_planes, numbers


@njit(nogil=True, cache=True)
def adjust(points, planes, unknowns, start, start_weights, gate, n_steps, at_rest):
    """Take Gauss-Newton steps that reduce the distances n . r of points from their planes, with Tukey's weights.

    points : (n, 3), sensor frame, m; planes : (n, 4), as `find_partners` made them; unknowns : (6,), x, y, z, roll,
    pitch, heading, m and rad, in and out; start : (6,), an observation of them, with weights start_weights : (6,);
    gate : no weight from this distance on, m; n_steps : at most so many; at_rest : a step that moves less, m, and turns
    less than a hundredth of it, rad, is the last.
    """
    used_points, used_planes, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    for _ in range(n_steps):
        _equations(used_points, used_planes, unknowns, gate, equations)
        _products(equations, products)
        right_side = products[:6, 6] - start_weights * (unknowns - start)
        step = np.linalg.solve(products[:6, :6] + np.diag(start_weights), right_side)
        unknowns += step
        if np.abs(step[:3]).max() < at_rest and np.abs(step[3:]).max() < 0.01 * at_rest:
            break


@njit(nogil=True, cache=True)
def weigh(points, planes, unknowns, gate, normal_matrix, residuals, weights):
    """Write normal matrix, residuals and weights at an adjusted pose; points, planes, unknowns, gate as for `adjust`.

    Out: normal_matrix : (6, 6), without the start; residuals : (n,), m, infinite without a plane; weights : (n,), 0
    without one.
    """
    used_points, used_planes, numbers = _with_planes(points, planes)
    equations, products = np.empty((7, len(numbers))), np.empty((7, 7))
    _equations(used_points, used_planes, unknowns, gate, equations)
    _products(equations, products)
    normal_matrix[:] = products[:6, :6]
    residuals[:], weights[:] = np.inf, 0.0
    R, _ = rotation_and_axes(unknowns[3:])
    for k in range(len(numbers)):
        x, y, z = used_points[0, k], used_points[1, k], used_points[2, k]
        nx, ny, nz, offset = used_planes[0, k], used_planes[1, k], used_planes[2, k], used_planes[3, k]
        offset -= nx * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + unknowns[0])
        offset -= ny * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + unknowns[1])
        offset -= nz * (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + unknowns[2])
        residuals[numbers[k]] = offset
        root = max(1.0 - (offset / gate) ** 2, 0.0)
        weights[numbers[k]] = root * root


@njit(nogil=True, cache=True)
def sum_gradients(points, planes, groups, unknowns, factors, sums):
    """Add factor times gradient (by the unknowns) of each point's distance from its plane to the sum of its group.

    points : (n, 3), sensor frame, m; planes : (n, 4); groups : (n,), numbers, below 0 for none; unknowns : (6,), the
    pose; factors : (n,); sums : (n_groups, 6), in zeros, out.
    """
    R, axes = rotation_and_axes(unknowns[3:])
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
