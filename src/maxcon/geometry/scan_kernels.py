# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: planes through the neighbours, by angle, of each point of a scan.

The window around a point grows until more than one ring is in it; what lies in it is then judged, once. What is
unsigned is so for speed: numba asks of every signed index whether it counts from the end.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from maxcon.geometry.plane_kernels import BLOCK, plane_normals, squares_across, sum_near
from maxcon.geometry.window_kernels import (
    BANDS,
    GROWTH,
    LEAST_NEIGHBOURS,
    LEAST_SPREAD,
    WINDOWS,
    first_windows,
)

__all__ = ["scan_planes"]

# Windows that find nothing grow, up to this half height, rad. Near the sensor they are at least so many metres high:
# in less, the noise of ranges is as large as any extent.
HIGHEST = 0.12
NEAR_METRES = 0.15
MOST_GROWTHS = 8
# A window reaches this share of its half height (and at least so many metres, at most so many rad) to either side.
ALONG = 0.5
ALONG_METRES = 0.25
MOST_ALONG = 0.5
# Neighbours lie within so many half heights (and at least so many metres) in space: no edge in depth is bridged.
GATE = 1.6
GATE_METRES = 0.3
# Neighbours are spread in two dimensions if they deviate, across the rings and along the second axis of their plane,
# by LEAST_SPREAD of the half height and by so many metres: rings of real scanners are not quite level, and near
# ranges are some centimetres off from ring to ring. A single ring must not pass for two.
LEAST_SPREAD_METRES = 0.08
# A plane's smallest eigenvalue is below this share of the middle one.
FLATNESS = 0.25
# A window does not grow where so many points in it, rings above and rings below have made no plane.
ENOUGH = 12
# It grows as often as a sample of about so many points says it must to find this share of the planes that are not
# level. What is level is mostly ground, and constrains no position.
SAMPLE = 256
WORTHWHILE = 0.93
LEVEL = 0.9
# Cells of the grid: so many to half the height of a window, within bounds for scans that cannot be.
CELLS_PER_WINDOW = 2.0
MOST_ROWS = 1024
MOST_COLUMNS = 1024
# At most so many candidates per row of the grid, evenly picked (near the sensor there are hundreds), and per column.
MOST_PER_ROW = 16
MOST_PER_COLUMN = 108
LEAST_PER_ROW = 4
# Longer cells are not sorted by insertion: a thousand points in one direction would take forever.
INSERTION_LIMIT = 32
# Candidates are filled up to a multiple of this, so that sums over them have no remainder to do one by one.
FILL = 16
MOST_REACH = int(np.ceil(CELLS_PER_WINDOW * HIGHEST / WINDOWS[0]))
# Twice: a row cut by the seam of azimuths is picked from twice.
STRIDE = 2 * max(MOST_PER_COLUMN, LEAST_PER_ROW * (2 * MOST_REACH + 1)) + FILL
ONE = np.uint32(1)


class Grid(NamedTuple):
    """A scan's points sorted by the cells of a grid of elevation (rows) and azimuth (columns).

    points (n, 3) m; cells (n,), row * n_columns + column of each; starts (n_cells + 2,), the last of no use;
    heights (n_rows,), half the height, rad, of the window that is tried first in each row; row_step, rad.
    """

    points: np.ndarray
    cells: np.ndarray
    starts: np.ndarray
    heights: np.ndarray
    n_rows: int
    n_columns: int
    row_step: float


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
def _pick(grid, cell, rows, columns, most, candidates):
    """Write all candidates within so many rows and columns of a cell: how many with those that fill up, and whether
    there are enough, also at the upper and at the lower end of the window.
    """
    row, column = cell // grid.n_columns, cell % grid.n_columns
    first, last = column - columns, column + columns + 1
    is_cut = first < 0 or last > grid.n_columns  # by the seam: the rest is at the other end of the row
    rest_first = first + grid.n_columns if first < 0 else 0
    rest_columns = -first if first < 0 else last - grid.n_columns
    first, last = max(first, 0), min(last, grid.n_columns)
    n, lowest, highest = np.uint32(0), row, row
    for r in range(max(0, row - rows), min(grid.n_rows, row + rows + 1)):
        before = n
        if is_cut:
            k = np.uint32(r * grid.n_columns + rest_first)
            n = _pick_run(
                grid.points, grid.starts[k], grid.starts[np.uint32(k + rest_columns)], most, candidates, n
            )
        k = np.uint32(r * grid.n_columns + first)
        n = _pick_run(
            grid.points, grid.starts[k], grid.starts[np.uint32(k + last - first)], most, candidates, n
        )
        if n > before:
            lowest, highest = min(lowest, r), r
    is_full = n >= ENOUGH and lowest <= row - rows and highest >= row + rows
    for j in range(FILL):
        candidates[n + np.uint32(j)] = np.inf  # not near anything, whatever y and z
    return np.uint32((n + np.uint32(FILL - 1)) // np.uint32(FILL) * np.uint32(FILL)), is_full


@njit(nogil=True, cache=True, error_model="numpy")
def _take_block(grid, pending, first, factor, block):
    """Take points for which a window of `factor` times the first height is not too high, until the block is full.

    block : out, places (BLOCK,), x, y, z (3 BLOCK,), half heights of windows (BLOCK,), rad. Returns how many were taken,
    and the next of the pending places.
    """
    places, points, heights = block
    n, k = 0, first
    while n < BLOCK and k < len(pending):
        place = pending[k]
        x, y, z = grid.points[place, 0], grid.points[place, 1], grid.points[place, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        height = factor * max(
            grid.heights[grid.cells[place] // grid.n_columns], NEAR_METRES / max(distance, 1e-3)
        )
        if height <= HIGHEST:
            places[n], heights[n] = place, height
            points[n], points[BLOCK + n], points[2 * BLOCK + n] = x, y, z
            n += 1
        k += 1
    return n, k


@njit(nogil=True, cache=True, error_model="numpy")
def _reaches(n, points, heights, n_columns, row_step, gates, rows, columns):
    """How far from each of n points its neighbours may lie: in space (m), and in rows and columns of the grid."""
    for k in range(n):
        x, y, z = points[k], points[BLOCK + k], points[2 * BLOCK + k]
        square = x * x + y * y
        reach = heights[k] * np.sqrt(square + z * z)
        gates[k] = max(GATE_METRES, GATE * reach)
        rows[k] = min(int(np.ceil(heights[k] / row_step - 1e-9)), MOST_REACH)
        along = min(max(ALONG * reach, ALONG_METRES) / max(np.sqrt(square), 1e-3), MOST_ALONG)
        columns[k] = min(int(along / (2.0 * np.pi) * n_columns + 0.5), n_columns // 2 - 1)


@njit(nogil=True, cache=True)
def _sum_block(grid, n, block, reaches, candidates, moments, is_full):
    """Write the moments of the neighbours of n points; those of a cell at about the same range share candidates."""
    places, points, _ = block
    gates, rows, columns = reaches
    n_near, is_window_full = np.uint32(0), False
    for k in range(n):
        cell = grid.cells[places[k]]
        is_same = k > 0 and cell == grid.cells[places[k - 1]]
        if not (is_same and rows[k] == rows[k - 1] and columns[k] == columns[k - 1]):
            most = np.uint32(max(LEAST_PER_ROW, min(MOST_PER_ROW, MOST_PER_COLUMN // (2 * rows[k] + 1))))
            n_near, is_window_full = _pick(grid, np.int64(cell), rows[k], columns[k], most, candidates)
        is_full[k] = is_window_full
        sum_near(
            candidates, STRIDE, n_near, points[k], points[BLOCK + k], points[2 * BLOCK + k], gates[k], moments, k
        )  # fmt: skip


@njit(nogil=True, cache=True, error_model="numpy")
def _judge(n, block, moments, squares, planes, normals, is_spread):
    """Write whether the neighbours of n points are spread in two dimensions, and normals or zeros.

    normals : (3 BLOCK,), out, x, y, z, turned to the sensor.
    """
    _, points, heights = block
    for k in range(n):
        x, y, z = points[k], points[BLOCK + k], points[2 * BLOCK + k]
        extent = max(LEAST_SPREAD * heights[k] * np.sqrt(x * x + y * y + z * z), LEAST_SPREAD_METRES)
        smallest, middle, square = planes[k], planes[BLOCK + k], extent * extent
        is_wide = moments[k] >= LEAST_NEIGHBOURS and squares[k] >= square and middle >= square
        is_plane = is_wide and smallest <= FLATNESS * middle
        nx, ny, nz = planes[2 * BLOCK + k], planes[3 * BLOCK + k], planes[4 * BLOCK + k]
        sign = -1.0 if nx * x + ny * y + nz * z > 0.0 else 1.0
        is_spread[k] = is_wide
        normals[k] = sign * nx if is_plane else 0.0
        normals[BLOCK + k] = sign * ny if is_plane else 0.0
        normals[2 * BLOCK + k] = sign * nz if is_plane else 0.0


@njit(nogil=True, cache=True)
def _fit_pending(grid, pending, factor, normals):
    """Fit planes to the neighbours of pending points, in windows of `factor` times the height that is tried first.

    pending : (m,) uint32, ascending places in the grid, out: those to try again in a higher window come first;
    normals : (n, 3), out, of all points of the grid. Returns how many there are to try again.
    """
    block = np.empty(BLOCK, np.uint32), np.empty(3 * BLOCK), np.empty(BLOCK)
    reaches = np.empty(BLOCK), np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    candidates, moments, planes = np.empty(3 * STRIDE), np.empty(10 * BLOCK), np.empty(5 * BLOCK)
    squares, found = np.empty(BLOCK), np.empty(3 * BLOCK)
    is_full, is_spread = np.empty(BLOCK, np.bool_), np.empty(BLOCK, np.bool_)
    places, points, heights = block
    n_left = taken = 0
    while taken < len(pending):
        n, taken = _take_block(grid, pending, taken, factor, block)
        _reaches(n, points, heights, grid.n_columns, grid.row_step, reaches[0], reaches[1], reaches[2])
        _sum_block(grid, n, block, reaches, candidates, moments, is_full)
        plane_normals(n, moments, planes)
        squares_across(n, points, moments, squares)
        _judge(n, block, moments, squares, planes, found, is_spread)
        for k in range(n):
            place = places[k]
            normals[place, 0], normals[place, 1] = found[k], found[BLOCK + k]
            normals[place, 2] = found[2 * BLOCK + k]
            if not (is_spread[k] or is_full[k]):
                pending[n_left] = place
                n_left += 1
    return n_left


@njit(nogil=True, cache=True)
def _worthwhile_growths(grid, normals):
    """How often windows must grow to find nearly all planes that are not level, in a sample of the points.

    normals : (n, 3), a buffer to write to.
    """
    step = (len(grid.points) + SAMPLE - 1) // SAMPLE
    sample = np.arange(0, len(grid.points), step).astype(np.uint32)
    pending, n_pending = sample.copy(), len(sample)
    n_found = np.zeros(MOST_GROWTHS + 1, np.int64)
    for growths in range(MOST_GROWTHS + 1):
        n_pending = _fit_pending(grid, pending[:n_pending], GROWTH**growths, normals)
        for place in sample:
            x, y, z = normals[place, 0], normals[place, 1], normals[place, 2]
            n_found[growths] += (x != 0.0 or y != 0.0) and abs(z) < LEVEL
    growths = 0
    while n_found[growths] < WORTHWHILE * n_found[MOST_GROWTHS]:
        growths += 1
    return growths


@njit(nogil=True, cache=True)
def _sorted_grid(points, elevations, azimuths, lowest, highest):
    """Sort points into a grid, whose cells are as large as half the lowest window asks for: grid, point numbers."""
    first = np.empty(BANDS, np.int64)
    height = WINDOWS[first_windows(elevations, azimuths, lowest, highest, first)]
    row_step = height / CELLS_PER_WINDOW
    n_rows = int(min(MOST_ROWS, (highest - lowest) / row_step + 1.0))
    row_step = max(row_step, (highest - lowest) / n_rows)
    n_columns = int(min(MOST_COLUMNS, 2.0 * np.pi * CELLS_PER_WINDOW / height))
    heights = np.empty(n_rows)
    for row in range(n_rows):
        heights[row] = WINDOWS[first[row * BANDS // n_rows]]
    cells = _cells(elevations, azimuths, lowest, row_step, n_rows, n_columns)
    starts, order = _sort_by_cell(cells, n_rows * n_columns, azimuths, points)
    return Grid(points[order], cells[order], starts, heights, n_rows, n_columns, row_step), order


@njit(nogil=True, cache=True)
def scan_planes(points, elevations, azimuths, lowest, highest, normals):
    """Fit a plane around each point and turn it to the sensor.

    points : (n, 3) float64, sensor frame, m, n > 0; elevations, azimuths : (n,), rad; lowest, highest : of the
    elevations, rad; normals : (n, 3) float64, out, zeros where there is no plane.
    """
    grid, order = _sorted_grid(points, elevations, azimuths, lowest, highest)
    sorted_normals = np.zeros_like(points)
    last = _worthwhile_growths(grid, sorted_normals)
    pending, n_pending = np.arange(len(order)).astype(np.uint32), len(order)
    sorted_normals[:] = 0.0
    for growths in range(last + 1):
        n_pending = _fit_pending(grid, pending[:n_pending], GROWTH**growths, sorted_normals)
    for k in range(len(order)):
        for axis in range(3):
            normals[order[k], axis] = sorted_normals[k, axis]
