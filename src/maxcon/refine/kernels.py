# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: which planes of the map scan points lie on, and the equations of their distances. Arrays in, arrays out."""

import numpy as np
from numba import njit

from maxcon.point_map.lookup_kernels import MEANS, NORMALS, find_voxel, float32_at, uint8_at
from maxcon.point_map.tile import MEAN_STEPS

__all__ = ["adjust", "find_partners", "sum_gradients"]

MEAN_STEP = 1.0 / MEAN_STEPS


@njit(nogil=True, cache=True)
def _turn(rotation, vector):
    """R v, three numbers."""
    x, y, z = vector
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


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
def _partner_along(px, py, pz, nx, ny, nz, cell, reach, least_cosine, is_signed, rows, grid, corner):
    """Plane (normal, offset) nearest to a point among the voxels along its normal; a normal of zeros for none.

    From the voxel of the point outwards to both sides, and one step beyond the first that is found.
    """
    found = (0.0, 0.0, 0.0, 0.0)
    nearest, last = np.inf, reach
    for step in range(reach + 1):
        if step > last:
            break
        for side in range(1 if step == 0 else 2):
            t = (step if side == 0 else -step) * cell
            x = np.int64(np.floor((px + t * nx) / cell))
            y = np.int64(np.floor((py + t * ny) / cell))
            z = np.int64(np.floor((pz + t * nz) / cell))
            row, number = find_voxel(x, y, z, rows, grid, corner)
            if row == 0:
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
def _partner_around(px, py, pz, cell, reach, rows, grid, corner):
    """Plane of a voxel along the axes from that of a point, of the nearest ones the one whose mean is nearest.

    A normal of zeros for none.
    """
    found = (0.0, 0.0, 0.0, 0.0)
    nearest = np.inf
    x0, y0, z0 = np.int64(np.floor(px / cell)), np.int64(np.floor(py / cell)), np.int64(np.floor(pz / cell))
    for step in range(reach + 1):
        if nearest < np.inf:
            break
        for side in range(1 if step == 0 else 6):
            t = step if side % 2 == 0 else -step
            x, y, z = x0 + t * (side // 2 == 0), y0 + t * (side // 2 == 1), z0 + t * (side // 2 == 2)
            row, number = find_voxel(x, y, z, rows, grid, corner)
            if row == 0:
                continue
            ax, ay, az, mx, my, mz = _plane(row, number, x, y, z, cell, rows)
            if ax == 0.0 and ay == 0.0 and az == 0.0:
                continue
            distance = (mx - px) ** 2 + (my - py) ** 2 + (mz - pz) ** 2
            if distance < nearest:
                nearest = distance
                found = (ax, ay, az, ax * mx + ay * my + az * mz)
    return found


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
    """
    rotation, _ = _rotation(unknowns[3:])
    position = unknowns[:3]
    for i in range(points.shape[0]):
        had_partner = planes[i, 0] != 0.0 or planes[i, 1] != 0.0 or planes[i, 2] != 0.0
        planes[i] = (0.0, 0.0, 0.0, 0.0)
        if not (had_partner if every == 0 else i % every == 0):
            continue
        dx, dy, dz = _turn(rotation, points[i])
        px, py, pz = dx + position[0], dy + position[1], dz + position[2]
        nx, ny, nz = _turn(rotation, normals[i])
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            planes[i] = _partner_around(px, py, pz, cell, reaches[1], rows, grid, corner)
            continue
        planes[i] = _partner_along(
            px, py, pz, nx, ny, nz, cell, reaches[0], least_cosine, is_signed, rows, grid, corner
        )


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
def _equation(point, plane, rotation, axes, position, gradient):
    """Distance of a scan point from its plane, m, and how it falls with each unknown; gradient : (6,), out."""
    dx, dy, dz = _turn(rotation, point)
    nx, ny, nz, offset = plane
    gradient[0], gradient[1], gradient[2] = nx, ny, nz
    cx, cy, cz = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    for k in range(3):  # n . (axis x d) = axis . (d x n)
        gradient[3 + k] = axes[k, 0] * cx + axes[k, 1] * cy + axes[k, 2] * cz
    return offset - nx * (dx + position[0]) - ny * (dy + position[1]) - nz * (dz + position[2])


@njit(nogil=True, cache=True)
def _add_equations(points, planes, unknowns, gate, normal_matrix, right_side, residuals, weights):
    """Normal equations of the distances n . r of points from their planes; see `adjust`."""
    normal_matrix[:] = 0.0
    right_side[:] = 0.0
    gradient = np.empty(6)
    rotation, axes = _rotation(unknowns[3:])
    for i in range(points.shape[0]):
        residuals[i], weights[i] = np.inf, 0.0
        if planes[i, 0] == 0.0 and planes[i, 1] == 0.0 and planes[i, 2] == 0.0:
            continue
        residuals[i] = _equation(points[i], planes[i], rotation, axes, unknowns[:3], gradient)
        share = residuals[i] / gate
        if abs(share) >= 1.0:
            continue
        weight = (1.0 - share * share) ** 2
        weights[i] = weight
        for j in range(6):
            right_side[j] += weight * gradient[j] * residuals[i]
            for k in range(j, 6):
                normal_matrix[j, k] += weight * gradient[j] * gradient[k]
    for j in range(6):
        for k in range(j):
            normal_matrix[j, k] = normal_matrix[k, j]


@njit(nogil=True, cache=True)
def adjust(
    points, planes, unknowns, start, start_weights, gate, n_steps, at_rest, normal_matrix, residuals, weights
):
    """Gauss-Newton steps that shorten the distances n . r of points from their planes, with Tukey's weights.

    points : (n, 3), sensor frame, m; planes : (n, 4), as `find_partners` made them; unknowns : (6,), x, y, z, roll,
    pitch, heading, in and out; start : (6,), which is an observation of them with weights start_weights : (6,); gate :
    no weight from this distance on, m; n_steps : at most; at_rest : a step that moves less, m, and turns less than a
    hundredth of it, rad, is the last. normal_matrix : (6, 6), residuals : (n,), m, and weights : (n,), 0 without a
    partner, at the end. All out.
    """
    right_side = np.empty(6)
    _add_equations(points, planes, unknowns, gate, normal_matrix, right_side, residuals, weights)
    for _ in range(n_steps):
        step = np.linalg.solve(
            normal_matrix + np.diag(start_weights), right_side - start_weights * (unknowns - start)
        )
        unknowns += step
        _add_equations(points, planes, unknowns, gate, normal_matrix, right_side, residuals, weights)
        if np.abs(step[:3]).max() < at_rest and np.abs(step[3:]).max() < 0.01 * at_rest:
            break


@njit(nogil=True, cache=True)
def sum_gradients(points, planes, groups, unknowns, factors, sums):
    """Add factor times gradient of each point's distance to the sum of its group.

    points : (n, 3), sensor frame, m; planes : (n, 4); groups : (n,), numbers; unknowns : (6,), the pose;
    factors : (n,); sums : (n_groups, 6), in zeros, out.
    """
    gradient = np.empty(6)
    rotation, axes = _rotation(unknowns[3:])
    for i in range(points.shape[0]):
        _equation(points[i], planes[i], rotation, axes, unknowns[:3], gradient)
        for k in range(6):
            sums[groups[i], k] += factors[i] * gradient[k]
