# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: planes through the neighbours, by angle, of each point of a scan.

Around each point, windows of growing height are tried until its neighbours are spread in two dimensions; these
neighbours are then judged, once. What is unsigned is so for speed: numba asks of every signed index whether it counts
from the end.
"""

import numpy as np
from numba import njit

from maxcon.geometry.plane_kernels import BLOCK, plane_normals, sum_near
from maxcon.geometry.window_kernels import (
    BANDS,
    LEAST_NEIGHBOURS,
    LEAST_SPREAD,
    N_WINDOWS,
    WINDOWS,
    first_windows,
)

__all__ = ["scan_planes"]

# A window reaches this share of its half height (and at least so many metres) to either side.
ALONG = 0.5
ALONG_METRES = 0.25
MOST_ALONG = 0.5
# Neighbours lie within so many half heights of the window (at least so many metres) in space: no edge is bridged.
GATE = 1.6
GATE_METRES = 0.3
# At most so many per row of the grid, evenly picked: near the sensor there are hundreds.
MOST_PER_ROW = 12
MOST_PER_COLUMN = 108
LEAST_PER_ROW = 4
# Neighbours are spread in two dimensions if, across the rings and in their middle extent, they deviate by LEAST_SPREAD
# of half the height of their window, and by so many metres: the rings of a real scanner are not quite level, and a
# single one must not pass for two.
LEAST_SPREAD_METRES = 0.08
# A plane's smallest eigenvalue is below this share of the middle one.
FLATNESS = 0.25
# A sample of about so many points says how far it is worth to go on: up to the window that finds this share of
# the planes that are not level. What is level is ground, and constrains nothing.
SAMPLE = 384
WORTHWHILE_SHARE = 0.93
LEVEL = 0.9
MOST_ROWS = 1024
MOST_COLUMNS = 1024
ROWS_PER_WINDOW = 2.0
COLUMNS_PER_WINDOW = 2.0
# Longer cells are not sorted by insertion: a thousand points in one direction would take forever.
INSERTION_LIMIT = 32
# Candidates are filled up to a multiple of this, so that sums over them have no remainder to do one by one.
FILL = 16
MOST_ROWS_ACROSS = int(np.ceil(ROWS_PER_WINDOW * WINDOWS[N_WINDOWS - 1] / WINDOWS[0]))
MOST_CANDIDATES = 2 * max(MOST_PER_COLUMN, LEAST_PER_ROW * (2 * MOST_ROWS_ACROSS + 1)) + FILL
STRIDE = BLOCK * MOST_CANDIDATES
ONE = np.uint32(1)


@njit(nogil=True, cache=True)
def _is_before(i, j, azimuths, points):
    """Whether point i comes before point j: by azimuth, then x, then y, then z."""
    if azimuths[i] != azimuths[j]:
        return azimuths[i] < azimuths[j]
    for axis in range(3):
        if points[i, axis] != points[j, axis]:
            return points[i, axis] < points[j, axis]
    return False


@njit(nogil=True, cache=True)
def _sort_cell(order, first, last, azimuths, points):
    """Sort order[first:last] in place, so that only points at one place may be in any order."""
    if last - first > INSERTION_LIMIT:
        part = order[first:last]
        for axis in range(2, -1, -1):
            part = part[np.argsort(points[part, axis], kind="mergesort")]
        order[first:last] = part[np.argsort(azimuths[part], kind="mergesort")]
        return
    for k in range(first + 1, last):
        i = order[k]
        place = k
        while place > first:
            j = order[place - 1]
            if not _is_before(i, j, azimuths, points):
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
def _sort_by_cell(cells, n_cells, azimuths, points):
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
            _sort_cell(order, starts[cell], starts[cell + 1], azimuths, points)
    return starts, order


@njit(nogil=True, cache=True)
def _pick_run(sorted_points, first, last, most, candidates, n):
    """Append at most `most` of the points first .. last - 1, evenly, to n candidates; return how many."""
    step = ONE
    if last > first + most:
        step = np.uint32((last - first + most - ONE) // most)
    k = first
    while k < last:
        candidates[n] = sorted_points[k, 0]
        candidates[STRIDE + n] = sorted_points[k, 1]
        candidates[2 * STRIDE + n] = sorted_points[k, 2]
        n = np.uint32(n + ONE)
        k = np.uint32(k + step)
    return n


@njit(nogil=True, cache=True)
def _pick(sorted_points, starts, cell, n_rows, n_columns, rows_across, columns_along, most, candidates, n):
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
            n = _pick_run(sorted_points, starts[k], starts[np.uint32(k + rest_columns)], most, candidates, n)
        k = np.uint32(r * n_columns + first)
        n = _pick_run(sorted_points, starts[k], starts[np.uint32(k + last - first)], most, candidates, n)
    for j in range(FILL):
        candidates[n + np.uint32(j)] = np.inf  # not near anything, whatever y and z
    return np.uint32((n + np.uint32(FILL - 1)) // np.uint32(FILL) * np.uint32(FILL))


@njit(nogil=True, cache=True, error_model="numpy")
def _reaches(points, windows, n_columns, gates, columns):
    """How far from each point its neighbours may lie: in space (m), and in columns of the grid."""
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        square = x * x + y * y
        reach = WINDOWS[windows[k]] * np.sqrt(square + z * z)
        gates[k] = max(GATE_METRES, GATE * reach)
        along = min(max(ALONG * reach, ALONG_METRES) / max(np.sqrt(square), 1e-3), MOST_ALONG)
        columns[k] = min(int(along / (2.0 * np.pi) * n_columns + 0.5), n_columns // 2 - 1)


@njit(nogil=True, cache=True)
def _sum_block(
    sorted_points, starts, cells, points, windows, n_rows, n_columns, row_step, gates, columns, candidates, moments
):  # fmt: skip
    """Write the moments of the neighbours of a block of points; those of a cell share their candidates."""
    n_near = np.uint32(0)
    for k in range(len(points)):
        is_shared = k > 0 and cells[k] == cells[k - 1] and columns[k] == columns[k - 1] and windows[k] == windows[k-1]
        if not is_shared:
            rows = min(int(np.ceil(WINDOWS[windows[k]] / row_step - 1e-9)), MOST_ROWS_ACROSS)
            most = np.uint32(max(LEAST_PER_ROW, min(MOST_PER_ROW, MOST_PER_COLUMN // (2 * rows + 1))))
            n_near = _pick(
                sorted_points, starts, np.int64(cells[k]), n_rows, n_columns, rows, columns[k], most, candidates,
                np.uint32(0),
            )  # fmt: skip
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        sum_near(candidates, STRIDE, n_near, x, y, z, gates[k], moments, k)


@njit(nogil=True, cache=True, error_model="numpy")
def _spread_across(x, y, z, k, moments):
    """Square deviation (m^2) of the k-th neighbourhood, of a point, across the rings: what is left of it at right
    angles to the best line, as the sensor sees it. 0 straight above the sensor.
    """
    square = x * x + y * y
    share, level, distance = 1.0 / moments[k], np.sqrt(square), np.sqrt(square + z * z)
    # Unit vectors along the ring, and of rising elevation.
    ax, ay = -y / level, x / level
    ex, ey, ez = -x * z / (level * distance), -y * z / (level * distance), level / distance
    mean_x, mean_y = moments[BLOCK + k] * share, moments[2 * BLOCK + k] * share
    mean_z = moments[3 * BLOCK + k] * share
    xx, xy = moments[4 * BLOCK + k] * share - mean_x * mean_x, moments[5 * BLOCK + k] * share - mean_x * mean_y
    xz, yy = moments[6 * BLOCK + k] * share - mean_x * mean_z, moments[7 * BLOCK + k] * share - mean_y * mean_y
    yz, zz = moments[8 * BLOCK + k] * share - mean_y * mean_z, moments[9 * BLOCK + k] * share - mean_z * mean_z
    cx, cy = xx * ex + xy * ey + xz * ez, xy * ex + yy * ey + yz * ez
    cz = xz * ex + yz * ey + zz * ez
    both = ax * cx + ay * cy
    along = ax * ax * xx + 2.0 * ax * ay * xy + ay * ay * yy
    across = ex * cx + ey * cy + ez * cz - both * both / max(along, 1e-12)
    return across if level > 0.0 else 0.0


@njit(nogil=True, cache=True, error_model="numpy")
def _judge(points, windows, moments, planes, normals, is_spread):
    """Write whether the neighbours of a block of points are spread in two dimensions, and normals or zeros."""
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        extent = max(LEAST_SPREAD * WINDOWS[windows[k]] * np.sqrt(x * x + y * y + z * z), LEAST_SPREAD_METRES)
        across = _spread_across(x, y, z, k, moments)
        smallest, middle = planes[k], planes[BLOCK + k]
        is_spread[k] = moments[k] >= LEAST_NEIGHBOURS and min(across, middle) >= extent * extent
        is_plane = is_spread[k] and smallest <= FLATNESS * middle
        nx, ny, nz = planes[2 * BLOCK + k], planes[3 * BLOCK + k], planes[4 * BLOCK + k]
        sign = -1.0 if nx * x + ny * y + nz * z > 0.0 else 1.0
        normals[k, 0] = sign * nx if is_plane else 0.0
        normals[k, 1] = sign * ny if is_plane else 0.0
        normals[k, 2] = sign * nz if is_plane else 0.0


@njit(nogil=True, cache=True)
def _fit_pending(
    sorted_points, sorted_cells, starts, pending, first_of_row, widening, n_rows, n_columns, row_step, normals
):  # fmt: skip
    """Fit planes to the neighbours of pending points, in windows `widening` numbers above the first of their row.

    pending : (m,) uint32, ascending places, out: those whose neighbours were not spread in two dimensions come first;
    normals : (n, 3), out, of sorted points. Returns how many are pending still.
    """
    candidates, moments, planes = np.empty(3 * STRIDE), np.empty(10 * BLOCK), np.empty(5 * BLOCK)
    gates, columns = np.empty(BLOCK), np.empty(BLOCK, np.int64)
    points, cells, windows = np.empty((BLOCK, 3)), np.empty(BLOCK, np.uint32), np.empty(BLOCK, np.int64)
    found, is_spread = np.empty((BLOCK, 3)), np.empty(BLOCK, np.bool_)
    places = np.empty(BLOCK, np.uint32)
    n_left, taken = 0, 0
    while taken < len(pending):
        n = 0
        while n < BLOCK and taken < len(pending):
            place = pending[taken]
            taken += 1
            window = first_of_row[sorted_cells[place] // n_columns] + widening
            if window >= N_WINDOWS:
                continue
            places[n], cells[n], windows[n] = place, sorted_cells[place], window
            points[n, 0], points[n, 1], points[n, 2] = sorted_points[place, 0], sorted_points[place, 1], sorted_points[place, 2]
            n += 1
        _reaches(points[:n], windows, n_columns, gates, columns)
        _sum_block(sorted_points, starts, cells, points[:n], windows, n_rows, n_columns, row_step, gates, columns, candidates, moments)
        plane_normals(n, moments, planes)
        _judge(points[:n], windows, moments, planes, found, is_spread)
        for k in range(n):
            place = places[k]
            if is_spread[k]:
                normals[place, 0], normals[place, 1], normals[place, 2] = found[k, 0], found[k, 1], found[k, 2]
            else:
                pending[n_left] = place
                n_left += 1
    return n_left


@njit(nogil=True, cache=True)
def _worthwhile(sorted_points, sorted_cells, starts, first_of_row, n_rows, n_columns, row_step, normals):
    """Return how many windows above the first find the planes that are not level, by a sample of the points."""
    step = (len(sorted_points) + SAMPLE - 1) // SAMPLE
    sample = np.arange(0, len(sorted_points), step).astype(np.uint32)
    pending, n_pending = sample.copy(), len(sample)
    counts = np.zeros(N_WINDOWS, np.int64)
    so_far = 0
    for widening in range(N_WINDOWS):
        n_pending = _fit_pending(sorted_points, sorted_cells, starts, pending[:n_pending], first_of_row, widening, n_rows, n_columns, row_step, normals)
        n_found = 0
        for place in sample:
            nx, ny, nz = normals[place, 0], normals[place, 1], normals[place, 2]
            n_found += abs(nz) < LEVEL and nx * nx + ny * ny > 0.0
        counts[widening] = n_found
    widening = 0
    while counts[widening] < WORTHWHILE_SHARE * counts[N_WINDOWS - 1]:
        widening += 1
    for place in sample:
        normals[place, 0] = normals[place, 1] = normals[place, 2] = 0.0
    return widening


@njit(nogil=True, cache=True)
def scan_planes(points, elevations, azimuths, lowest, highest, normals):
    """Fit a plane around each point and turn it to the sensor.

    points : (n, 3) float64, sensor frame, m, n > 0; elevations, azimuths : (n,), rad; lowest, highest : of the
    elevations, rad; normals : (n, 3) float64, out, zeros where there is no plane.
    """
    first = np.empty(BANDS, np.int64)
    smallest = WINDOWS[first_windows(elevations, azimuths, lowest, highest, first)]
    row_step = smallest / ROWS_PER_WINDOW
    n_rows = int(min(MOST_ROWS, (highest - lowest) / row_step + 1.0))
    row_step = max(row_step, (highest - lowest) / n_rows)
    first_of_row = first[np.arange(n_rows) * BANDS // n_rows]
    n_columns = int(min(MOST_COLUMNS, 2.0 * np.pi * COLUMNS_PER_WINDOW / smallest))
    cells = _cells(elevations, azimuths, lowest, row_step, n_rows, n_columns)
    starts, order = _sort_by_cell(cells, n_rows * n_columns, azimuths, points)
    sorted_points, sorted_cells = points[order], cells[order]
    sorted_normals = np.zeros_like(points)
    pending, n_pending = np.arange(len(order)).astype(np.uint32), len(order)
    last = _worthwhile(sorted_points, sorted_cells, starts, first_of_row, n_rows, n_columns, row_step, sorted_normals)
    for widening in range(last + 1):
        n_pending = _fit_pending(
            sorted_points, sorted_cells, starts, pending[:n_pending], first_of_row, widening, n_rows, n_columns, row_step, sorted_normals
        )
    for k in range(len(order)):
        i = order[k]
        normals[i, 0], normals[i, 1], normals[i, 2] = sorted_normals[k, 0], sorted_normals[k, 1], sorted_normals[k, 2]
