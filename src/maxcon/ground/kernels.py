# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The compiled loops of the fit of a scan's ground to that of the map. Arrays in, arrays out."""

import numpy as np
from numba import njit

__all__ = ["fit_planes", "heights_below", "lowest_of_cells"]

# Steps with all points, after those from each start.
N_LAST = 3


@njit(nogil=True, cache=True)
def lowest_of_cells(points, rotation, edge, nearest, farthest, thickness):
    """Find the lowest points in each cell of a grid about the sensor: their means, in axes that are levelled.

    points : (n, 3) float64, sensor frame, m; rotation : (3, 3), levels them; edge : of a cell, m; nearest, farthest :
    points nearer or farther than this, horizontally, are left out, m; thickness : points up to this above the lowest
    of their cell are taken, m. Returns (m, 3) float64.
    """
    reach = np.int64(np.ceil(farthest / edge))
    width = 2 * reach
    lowest = np.full(width * width, np.inf)
    sums = np.zeros((width * width, 4))
    cells = np.empty(points.shape[0], np.int64)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz
        square = x * x + y * y
        cells[i] = -1
        if square < nearest * nearest or square >= farthest * farthest:
            continue
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz
        cell = (np.int64(np.floor(y / edge)) + reach) * width + np.int64(np.floor(x / edge)) + reach
        cells[i] = cell
        lowest[cell] = min(lowest[cell], z)
    for i in range(points.shape[0]):
        cell = cells[i]
        if cell < 0:
            continue
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz
        if z <= lowest[cell] + thickness:
            sums[cell, 0] += rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz
            sums[cell, 1] += rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz
            sums[cell, 2] += z
            sums[cell, 3] += 1.0
    means = np.empty((width * width, 3))
    n = 0
    for k in range(width * width):
        if sums[k, 3] > 0.0:
            for axis in range(3):
                means[n, axis] = sums[k, axis] / sums[k, 3]
            n += 1
    return means[:n].copy()


@njit(nogil=True, cache=True)
def _ground_at(heights, x, y, z):
    """Height of the level nearest to z, bilinear between the middles of cells; NaN where less than half is known.

    heights : (levels, ny, nx) float32; x, y : in cells from the corner of the first.
    """
    left, low = np.floor(x - 0.5), np.floor(y - 0.5)
    total, weights = 0.0, 0.0
    for row in range(2):
        for column in range(2):
            iy, ix = np.int64(low) + row, np.int64(left) + column
            if iy < 0 or iy >= heights.shape[1] or ix < 0 or ix >= heights.shape[2]:
                continue
            weight = (1.0 - abs(y - 0.5 - low - row)) * (1.0 - abs(x - 0.5 - left - column))
            best = np.nan
            for level in range(heights.shape[0]):
                height = heights[level, iy, ix]
                if not (abs(height - z) >= abs(best - z)) and not np.isnan(height):
                    best = height
            if not np.isnan(best):
                total += weight * best
                weights += weight
    return total / weights if weights >= 0.5 else np.nan


@njit(nogil=True, cache=True)
def heights_below(points, heights, corner, edge, position, turn, height, below):
    """Find how far each point lies under the ground of the map; NaN where there is no ground.

    points : (m, 3) float64, levelled, about the sensor, m; heights : (levels, ny, nx) float32; corner : (x, y) of
    the first cell, m; edge : of a cell, m; position : of the sensor, (x, y, z), m; turn : cosine and sine of its
    heading; height : the level nearest to the point, raised by this, is its ground, m; below : (m,), out.
    """
    cosine, sine = turn
    for i in range(points.shape[0]):
        z = position[2] + points[i, 2]
        x = (position[0] + cosine * points[i, 0] - sine * points[i, 1] - corner[0]) / edge
        y = (position[1] + sine * points[i, 0] + cosine * points[i, 1] - corner[1]) / edge
        below[i] = _ground_at(heights, x, y, z + height) - z


@njit(nogil=True, cache=True)
def _step(points, below, square, stiffness, plane, normal, right):
    """One step of reweighted least squares towards the plane; returns what the points have agreed by before it."""
    agreed = 0.0
    normal[:, :] = 0.0
    right[:] = 0.0
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        off = below[i] - plane[0] - plane[1] * x - plane[2] * y
        weight = square / (square + off * off)
        agreed += weight
        weight *= weight
        normal[0, 0] += weight
        normal[0, 1] += weight * x
        normal[0, 2] += weight * y
        normal[1, 1] += weight * x * x
        normal[1, 2] += weight * x * y
        normal[2, 2] += weight * y * y
        right[0] += weight * off
        right[1] += weight * off * x
        right[2] += weight * off * y
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    normal[0, 0] += 1e-9
    for axis in range(1, 3):
        normal[axis, axis] += stiffness
        right[axis] -= stiffness * plane[axis]
    plane += np.linalg.solve(normal, right)
    return agreed - 0.5 * stiffness * (plane[1] ** 2 + plane[2] ** 2) / square


@njit(nogil=True, cache=True)
def fit_planes(points, below, starts, scales, stiffness, stride, plane, normal):
    """Fit the plane (height, slope along x, slope along y) to add to the points so that most lie on the ground.

    From each start by reweighted least squares with Geman and McClure's weights, whose scale goes down step by step:
    what lies far off the rest has no weight in the end. The plane that most points agree on is taken.
    points : (m, 3) float64, levelled, about the sensor, m; below : (m,), how far each lies under the ground, m;
    starts : (s, 3) float64; scales : (k,), m; stiffness : weight that holds the slopes at 0, in cells m^2; stride : of
    so many points one is looked at before the last steps; plane : (3,), out; normal : (3, 3), out, the normal matrix of
    the last step.
    """
    some, below_some = points[::stride], below[::stride]
    here, right, trial = np.empty((3, 3)), np.empty(3), np.empty(3)
    most = -np.inf
    for start in range(starts.shape[0]):
        trial[:] = starts[start]
        agreed = 0.0
        for scale in scales:
            agreed = _step(some, below_some, scale * scale, stiffness / stride, trial, here, right)
        if agreed > most:
            most = agreed
            plane[:] = trial
    for _ in range(N_LAST):
        _step(points, below, scales[-1] * scales[-1], stiffness, plane, normal, right)
