# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: planes through the neighbours, by angle, of each point of a ring scan."""

import numpy as np
from numba import njit

from maxcon.geometry.plane_kernels import covariance, plane_normal

__all__ = ["ring_normals", "spherical"]

# Neighbours: within this many point spacings (and this many metres) along a ring, and ring spacings across.
ALONG = 4.0
ALONG_METRES = 0.25
ACROSS = 1.3
# ... and within this many ring spacings, as a distance in space, so that no edge in depth is bridged.
GATE = 1.6
GATE_METRES = 0.3
# At most so many per row of the grid, evenly picked: near the sensor there are hundreds.
MOST_PER_ROW = 12
LEAST_NEIGHBOURS = 6
# A plane needs an extent at right angles to the ring of this many ring spacings (a single ring has only its
# noise), and a smallest eigenvalue below this share of the middle one.
LEAST_EXTENT = 0.25
LEAST_EXTENT_METRES = 0.03
FLATNESS = 0.25
MOST_ROWS = 1024
MOST_COLUMNS = 1024
# Longer cells are not sorted by insertion: a thousand points in one direction would take forever.
INSERTION_LIMIT = 32


@njit(nogil=True, cache=True)
def spherical(points):
    """Return range (m), elevation and azimuth (rad) of points, (n, 3)."""
    n = points.shape[0]
    ranges, elevations, azimuths = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        x, y, z = points[i]
        ranges[i] = np.sqrt(x * x + y * y + z * z)
        elevations[i] = np.arctan2(z, np.sqrt(x * x + y * y))
        azimuths[i] = np.arctan2(y, x)
    return ranges, elevations, azimuths


@njit(nogil=True, cache=True)
def _sort_cell(order, first, last, azimuths, elevations):
    """Sort order[first:last] by azimuth, then elevation, in place."""
    if last - first > INSERTION_LIMIT:
        part = order[first:last]
        part = part[np.argsort(elevations[part], kind="mergesort")]
        order[first:last] = part[np.argsort(azimuths[part], kind="mergesort")]
        return
    for k in range(first + 1, last):
        i = order[k]
        place = k
        while place > first:
            j = order[place - 1]
            if azimuths[j] < azimuths[i] or (azimuths[j] == azimuths[i] and elevations[j] <= elevations[i]):
                break
            order[place] = j
            place -= 1
        order[place] = i


@njit(nogil=True, cache=True)
def _sort_by_angle(elevations, azimuths, row_step, n_rows, n_columns):
    """Sort into a grid of (elevation, azimuth): starts (rows * columns + 1,) and point numbers.

    In each cell by azimuth, so that the same points are picked whatever order they come in.
    """
    lowest = elevations.min()
    cells = np.empty(len(elevations), np.int64)
    starts = np.zeros(n_rows * n_columns + 1, np.int64)
    for i in range(len(elevations)):
        row = min(int((elevations[i] - lowest) / row_step), n_rows - 1)
        column = int((azimuths[i] + np.pi) / (2.0 * np.pi) * n_columns) % n_columns
        cells[i] = row * n_columns + column
        starts[cells[i] + 1] += 1
    starts = np.cumsum(starts)
    place = starts[:-1].copy()
    order = np.empty(len(elevations), np.int64)
    for i in range(len(elevations)):
        order[place[cells[i]]] = i
        place[cells[i]] += 1
    for cell in range(n_rows * n_columns):
        _sort_cell(order, starts[cell], starts[cell + 1], azimuths, elevations)
    return starts, order, cells


@njit(nogil=True, cache=True)
def _add_run(sorted_points, first, last, center, gate, sums, outers):
    """Add points first .. last - 1 that lie within `gate` (m) of the centre; return how many."""
    count = 0
    step = max(1, (last - first + MOST_PER_ROW - 1) // MOST_PER_ROW)
    for k in range(first, last, step):
        x = sorted_points[k, 0] - center[0]
        y = sorted_points[k, 1] - center[1]
        z = sorted_points[k, 2] - center[2]
        if x * x + y * y + z * z > gate * gate:
            continue
        count += 1
        sums[0] += x
        sums[1] += y
        sums[2] += z
        outers[0] += x * x
        outers[1] += x * y
        outers[2] += x * z
        outers[3] += y * y
        outers[4] += y * z
        outers[5] += z * z
    return count


@njit(nogil=True, cache=True)
def ring_normals(points, ranges, elevations, azimuths, ring_spacing, point_spacing, normals):
    """Fit a plane around each point and turn it to the sensor.

    points : (n, 3) float64, sensor frame; ranges, elevations, azimuths : (n,), m and rad; ring_spacing,
    point_spacing : rad; normals : (n, 3) float64, out, zeros where there is no plane.
    """
    row_step = 0.5 * ring_spacing
    n_rows = int(min(MOST_ROWS, (elevations.max() - elevations.min()) / row_step + 1.0))
    row_step = max(row_step, (elevations.max() - elevations.min()) / n_rows)
    n_columns = int(min(MOST_COLUMNS, max(8.0, 2.0 * np.pi / (2.0 * point_spacing))))
    starts, order, cells = _sort_by_angle(elevations, azimuths, row_step, n_rows, n_columns)
    sorted_points = points[order]
    rows_across = int(np.ceil(ACROSS * ring_spacing / row_step))
    sums, outers = np.zeros(3), np.zeros(6)
    matrix, normal = np.zeros((3, 3)), np.zeros(3)
    for k in range(len(order)):
        i = order[k]
        if ranges[i] == 0.0:
            continue
        row, column = cells[i] // n_columns, cells[i] % n_columns
        level_range = max(ranges[i] * np.cos(elevations[i]), 1e-3)
        along = max(ALONG * point_spacing, min(ALONG_METRES / level_range, 0.5))
        columns_along = min(int(along / (2.0 * np.pi) * n_columns + 0.5), n_columns // 2 - 1)
        gate = max(GATE_METRES, GATE * ring_spacing * ranges[i])
        sums[:] = 0.0
        outers[:] = 0.0
        count = 0
        for r in range(max(0, row - rows_across), min(n_rows, row + rows_across + 1)):
            first, last = column - columns_along, column + columns_along + 1
            base = r * n_columns
            if first < 0:
                count += _add_run(
                    sorted_points, starts[base + first + n_columns], starts[base + n_columns],
                    sorted_points[k], gate, sums, outers,
                )  # fmt: skip
            if last > n_columns:
                count += _add_run(
                    sorted_points, starts[base], starts[base + last - n_columns],
                    sorted_points[k], gate, sums, outers,
                )  # fmt: skip
            count += _add_run(
                sorted_points, starts[base + max(first, 0)], starts[base + min(last, n_columns)],
                sorted_points[k], gate, sums, outers,
            )  # fmt: skip
        if count < LEAST_NEIGHBOURS:
            continue
        covariance(count, sums, outers, matrix)
        smallest, middle, _ = plane_normal(matrix, normal)
        extent = max(LEAST_EXTENT * ring_spacing * ranges[i], LEAST_EXTENT_METRES)
        if middle < extent * extent or smallest > FLATNESS * middle:
            continue
        side = normal[0] * points[i, 0] + normal[1] * points[i, 1] + normal[2] * points[i, 2]
        for axis in range(3):
            normals[i, axis] = -normal[axis] if side > 0.0 else normal[axis]
