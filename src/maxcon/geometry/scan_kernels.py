# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: planes through the neighbours, by angle, of each point of a ring scan.

What is unsigned is so for speed: numba asks of every signed index whether it counts from the end.
"""

import numpy as np
from numba import njit

from maxcon.geometry.plane_kernels import BLOCK, plane_normals, sum_near

__all__ = ["ring_normals"]

# Neighbours: within this many point spacings (and this many metres) along a ring, and ring spacings across.
ALONG = 4.0
ALONG_METRES = 0.25
ACROSS = 1.3
# ... and within this many ring spacings, as a distance in space, so that no edge in depth is bridged.
GATE = 1.6
GATE_METRES = 0.3
# At most so many per row of the grid, evenly picked: near the sensor there are hundreds.
MOST_PER_ROW = np.uint32(12)
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
# Rows are half a ring spacing high or higher; a row cut by the seam of azimuths is picked from twice.
MOST_ROWS_ACROSS = int(np.ceil(2.0 * ACROSS))
# Candidates are filled up to a multiple of this, so that sums over them have no remainder to do one by one.
FILL = 16
MOST_CANDIDATES = int(2 * MOST_PER_ROW * (2 * MOST_ROWS_ACROSS + 1)) + FILL
STRIDE = BLOCK * MOST_CANDIDATES
ONE = np.uint32(1)


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


@njit(nogil=True, cache=True, error_model="numpy")
def _cells(elevations, azimuths, lowest, row_step, n_rows, n_columns):
    """Cell, row * n_columns + column, of each direction."""
    cells = np.empty(len(elevations), np.uint32)
    for i in range(len(elevations)):
        row = min(int((elevations[i] - lowest) / row_step), n_rows - 1)
        column = int((azimuths[i] + np.pi) / (2.0 * np.pi) * n_columns)
        cells[i] = np.uint32(row * n_columns + (column if column < n_columns else 0))
    return cells


@njit(nogil=True, cache=True)
def _sort_by_cell(cells, n_cells, elevations, azimuths):
    """Sort points by cell: starts (n_cells + 2,), the last of no use, and point numbers, (n,).

    In each cell by azimuth, so that the same points are picked whatever order they come in.
    """
    starts = np.zeros(n_cells + 2, np.uint32)
    for cell in cells:
        starts[cell + 2] += ONE
    for cell in range(2, n_cells + 2):
        starts[cell] += starts[cell - 1]
    # One place ahead: when all points are in, the next free place of a cell is the start of the one after.
    order = np.empty(len(cells), np.uint32)
    for i in range(len(cells)):
        order[starts[cells[i] + 1]] = i
        starts[cells[i] + 1] += ONE
    for cell in range(n_cells):
        if starts[cell + 1] > starts[cell] + ONE:
            _sort_cell(order, starts[cell], starts[cell + 1], azimuths, elevations)
    return starts, order


@njit(nogil=True, cache=True)
def _pick_run(sorted_points, first, last, candidates, n):
    """Append at most MOST_PER_ROW of the points first .. last - 1, evenly, to n candidates; return how many."""
    step = ONE
    if last > first + MOST_PER_ROW:
        step = np.uint32((last - first + MOST_PER_ROW - ONE) // MOST_PER_ROW)
    k = first
    while k < last:
        candidates[n] = sorted_points[k, 0]
        candidates[STRIDE + n] = sorted_points[k, 1]
        candidates[2 * STRIDE + n] = sorted_points[k, 2]
        n = np.uint32(n + ONE)
        k = np.uint32(k + step)
    return n


@njit(nogil=True, cache=True)
def _pick(sorted_points, starts, cell, n_rows, n_columns, rows_across, columns_along, candidates, n):
    """Append all candidates around a cell to n others; return how many, with those that fill up."""
    row, column = cell // n_columns, cell % n_columns
    first, last = column - columns_along, column + columns_along + 1
    is_cut = first < 0 or last > n_columns  # by the seam: the rest is at the other end of the row
    rest_first = first + n_columns if first < 0 else 0
    rest_columns = -first if first < 0 else last - n_columns
    first, last = max(first, 0), min(last, n_columns)
    for r in range(max(0, row - rows_across), min(n_rows, row + rows_across + 1)):
        if is_cut:
            k = np.uint32(r * n_columns + rest_first)
            n = _pick_run(sorted_points, starts[k], starts[np.uint32(k + rest_columns)], candidates, n)
        k = np.uint32(r * n_columns + first)
        n = _pick_run(sorted_points, starts[k], starts[np.uint32(k + last - first)], candidates, n)
    for j in range(FILL):
        candidates[n + np.uint32(j)] = np.inf  # not near anything, whatever y and z
    return np.uint32((n + np.uint32(FILL - 1)) // np.uint32(FILL) * np.uint32(FILL))


@njit(nogil=True, cache=True, error_model="numpy")
def _windows(points, ring_spacing, point_spacing, n_columns, gates, columns):
    """How far from each point its neighbours may lie: in space (m), and in columns of the grid."""
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        square = x * x + y * y
        gates[k] = max(GATE_METRES, GATE * ring_spacing * np.sqrt(square + z * z))
        along = max(ALONG * point_spacing, min(ALONG_METRES / max(np.sqrt(square), 1e-3), 0.5))
        columns[k] = min(int(along / (2.0 * np.pi) * n_columns + 0.5), n_columns // 2 - 1)


@njit(nogil=True, cache=True)
def _pick_block(
    sorted_points, starts, cells, n_rows, n_columns, rows_across, columns, candidates, firsts, lasts
):
    """Write the candidates of a block of points; those of a cell at about the same range share theirs.

    cells : (n,), cell of each point, in ascending order; candidates : out, x of all, from STRIDE on y, from 2 STRIDE
    on z; firsts, lasts : out, (n,), which of them are whose.
    """
    first = last = np.uint32(0)
    for k in range(len(cells)):
        if k == 0 or cells[k] != cells[k - 1] or columns[k] != columns[k - 1]:
            first = last
            last = _pick(
                sorted_points,
                starts,
                np.int64(cells[k]),
                n_rows,
                n_columns,
                rows_across,
                columns[k],
                candidates,
                last,
            )
        firsts[k], lasts[k] = first, last


@njit(nogil=True, cache=True)
def _write_normals(sorted_points, order, moments, planes, ring_spacing, normals):
    """Write the normals of a block of points, turned to the sensor, zeros where there is no plane."""
    for k in range(len(order)):
        x, y, z = sorted_points[k, 0], sorted_points[k, 1], sorted_points[k, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        extent = max(LEAST_EXTENT * ring_spacing * distance, LEAST_EXTENT_METRES)
        smallest, middle = planes[k], planes[BLOCK + k]
        is_plane = moments[k] >= LEAST_NEIGHBOURS and distance > 0.0
        is_plane = is_plane and middle >= extent * extent and smallest <= FLATNESS * middle
        i = order[k]
        nx, ny, nz = planes[2 * BLOCK + k], planes[3 * BLOCK + k], planes[4 * BLOCK + k]
        sign = -1.0 if nx * x + ny * y + nz * z > 0.0 else 1.0
        normals[i, 0] = sign * nx if is_plane else 0.0
        normals[i, 1] = sign * ny if is_plane else 0.0
        normals[i, 2] = sign * nz if is_plane else 0.0


@njit(nogil=True, cache=True)
def ring_normals(points, elevations, azimuths, lowest, highest, ring_spacing, point_spacing, normals):
    """Fit a plane around each point and turn it to the sensor.

    points : (n, 3) float64, sensor frame, m, n > 0; elevations, azimuths : (n,), rad; lowest, highest : of the
    elevations, rad; ring_spacing, point_spacing : rad; normals : (n, 3) float64, out, zeros where there is no plane.
    """
    row_step = 0.5 * ring_spacing
    n_rows = int(min(MOST_ROWS, (highest - lowest) / row_step + 1.0))
    row_step = max(row_step, (highest - lowest) / n_rows)
    n_columns = int(min(MOST_COLUMNS, max(8.0, 2.0 * np.pi / (2.0 * point_spacing))))
    rows_across = min(int(np.ceil(ACROSS * ring_spacing / row_step)), MOST_ROWS_ACROSS)
    cells = _cells(elevations, azimuths, lowest, row_step, n_rows, n_columns)
    starts, order = _sort_by_cell(cells, n_rows * n_columns, elevations, azimuths)
    sorted_points, sorted_cells = np.empty_like(points), np.empty_like(cells)
    for k in range(len(order)):
        i = order[k]
        sorted_points[k, 0], sorted_points[k, 1], sorted_points[k, 2] = (
            points[i, 0],
            points[i, 1],
            points[i, 2],
        )
        sorted_cells[k] = cells[i]
    candidates, moments, planes = np.empty(3 * STRIDE), np.empty(10 * BLOCK), np.empty(5 * BLOCK)
    gates, columns = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    firsts, lasts = np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    for base in range(0, len(order), BLOCK):
        block = sorted_points[base : base + BLOCK]
        _windows(block, ring_spacing, point_spacing, n_columns, gates, columns)
        _pick_block(
            sorted_points, starts, sorted_cells[base : base + BLOCK], n_rows, n_columns, rows_across, columns,
            candidates, firsts, lasts,
        )  # fmt: skip
        for k in range(len(block)):
            near = candidates[firsts[k] :]
            n_near = lasts[k] - firsts[k]
            sum_near(near, STRIDE, n_near, block[k, 0], block[k, 1], block[k, 2], gates[k], moments, k)
        plane_normals(len(block), moments, planes)
        _write_normals(block, order[base : base + BLOCK], moments, planes, ring_spacing, normals)
