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


@njit(nogil=True, cache=True, inline="always")
def _turned(R, point):
    """Return R applied to a point (x, y, z): where it lies from the sensor, map axes, m."""
    x, y, z = point
    dx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
    dy = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    dz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    return dx, dy, dz


@njit(nogil=True, cache=True, inline="always")
def _distance(away, normal, offset, unknowns):
    """Signed distance of a point from its plane, m: `away` from the sensor, map axes; the plane is n . r = offset."""
    (dx, dy, dz), (nx, ny, nz) = away, normal
    return offset - nx * (dx + unknowns[0]) - ny * (dy + unknowns[1]) - nz * (dz + unknowns[2])


@njit(nogil=True, cache=True, inline="always")
def _turn_gradient(axes, away, normal):
    """Derivatives of n . d by roll, pitch and heading, for a point d away from the sensor: n . (axis x d), m."""
    (dx, dy, dz), (nx, ny, nz) = away, normal
    # n . (axis x d) = axis . (d x n)
    cx, cy, cz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    return axes[0, 0] * cx + axes[0, 1] * cy + axes[0, 2] * cz, axes[1, 0] * cx + axes[1, 1] * cy, cz


@njit(nogil=True, cache=True)
def _equations(points, planes, unknowns, gate, equations):
    """Signed distances of points from their planes, and minus their derivatives, times the root of Tukey's weight.

    points : (3, n), sensor frame, m; planes : (4, n); unknowns : (6,); gate : no weight from this distance on, m;
    equations : (7, n), out: a row for each of x, y, z, roll, pitch, heading, then the distances.
    """
    R, axes = rotation_and_axes(unknowns[3:])
    for i in range(points.shape[1]):
        nx, ny, nz = planes[0, i], planes[1, i], planes[2, i]
        away = _turned(R, (points[0, i], points[1, i], points[2, i]))
        distance = _distance(away, (nx, ny, nz), planes[3, i], unknowns)
        share = distance / gate
        root = max(1.0 - share * share, 0.0)
        roll, pitch, heading = _turn_gradient(axes, away, (nx, ny, nz))
        equations[0, i], equations[1, i], equations[2, i] = root * nx, root * ny, root * nz
        equations[3, i], equations[4, i], equations[5, i] = root * roll, root * pitch, root * heading
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
        away = _turned(R, (used_points[0, k], used_points[1, k], used_points[2, k]))
        normal = used_planes[0, k], used_planes[1, k], used_planes[2, k]
        distance = _distance(away, normal, used_planes[3, k], unknowns)
        residuals[numbers[k]] = distance
        root = max(1.0 - (distance / gate) ** 2, 0.0)
        weights[numbers[k]] = root * root


@njit(nogil=True, cache=True)
def sum_gradients(points, planes, groups, unknowns, factors, sums):
    """Add factor times minus the gradient, by the unknowns, of each point's distance from its plane to its group's sum.

    points : (n, 3), sensor frame, m; planes : (n, 4); groups : (n,), numbers, below 0 for none; unknowns : (6,), the
    pose; factors : (n,); sums : (n_groups, 6), in zeros, out.
    """
    R, axes = rotation_and_axes(unknowns[3:])
    for i in range(points.shape[0]):
        group = groups[i]
        if group < 0:
            continue
        normal = planes[i, 0], planes[i, 1], planes[i, 2]
        away = _turned(R, (points[i, 0], points[i, 1], points[i, 2]))
        roll, pitch, heading = _turn_gradient(axes, away, normal)
        sums[group, 0] += factors[i] * normal[0]
        sums[group, 1] += factors[i] * normal[1]
        sums[group, 2] += factors[i] * normal[2]
        sums[group, 3] += factors[i] * roll
        sums[group, 4] += factors[i] * pitch
        sums[group, 5] += factors[i] * heading
