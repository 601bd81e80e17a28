"""Compiled: a scan's points sorted into a grid of elevation and azimuth, and candidate neighbours picked from it.

Indices are unsigned for speed: of a signed one numba checks every time whether it counts from the end.
"""

from typing import NamedTuple

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.scan.window_kernels import BANDS, HIGHEST, WINDOWS, first_windows

# Rows per half height of the lowest window; the bounds are for scans that no real scanner makes.
CELLS_PER_WINDOW = 2.0
MOST_ROWS = 1024
MOST_COLUMNS = 1024
# At most so many candidates per row of the grid, evenly picked (near the sensor there are hundreds), and over all rows
# of a window; but LEAST_PER_ROW in any row.
MOST_PER_ROW = 16
MOST_PER_WINDOW = 108
LEAST_PER_ROW = 4
# A window with so many candidates, some of them in its highest and some in its lowest row, grows no more, plane or not.
ENOUGH = 12
# Cells with more points are not sorted by insertion: a thousand points in one direction would take forever.
INSERTION_LIMIT = 32
# Candidates are filled up to a multiple of this, so that sums over them have no remainder to do one by one.
FILL = 16
MOST_REACH = int(np.ceil(CELLS_PER_WINDOW * HIGHEST / WINDOWS[0]))
# Room for the candidates of a window; twice, as a row that is cut where azimuths wrap around is picked from twice.
STRIDE = 2 * max(MOST_PER_WINDOW, LEAST_PER_ROW * (2 * MOST_REACH + 1)) + FILL
ONE = np.uint32(1)


class Grid(NamedTuple):
    """A scan's points sorted by the cells of a grid of elevation (rows) and azimuth (columns).

    points (n, 3), m; cells (n,), row * n_columns + column of each point; starts (n_cells + 2,), first point of each
    cell, then n, then one value without meaning; heights (n_rows,), half height, rad, of the window that is tried first
    in each row; row_step, height of a row, rad.
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
    """Sort order[first:last] in place as `_is_before` says: only coinciding points are left in any order."""
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


@njit(nogil=True, cache=True)
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
    """Sort points by cell, then azimuth, in whatever order they come: starts (n_cells + 2,) and point numbers (n,)."""
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
    """Append at most `most` of the points first .. last - 1, evenly picked, to n candidates; return their number."""
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
def pick_candidates(grid, cell, rows, columns, candidates):
    """Write candidate neighbours, at most so many rows and columns away, evenly picked: x, then y, then z, m.

    Returns how many there are, those at infinity that fill up included, and whether the window is full (see ENOUGH).
    """
    most = np.uint32(max(LEAST_PER_ROW, min(MOST_PER_ROW, MOST_PER_WINDOW // (2 * rows + 1))))
    row, column = cell // grid.n_columns, cell % grid.n_columns
    first, last = column - columns, column + columns + 1
    is_cut = first < 0 or last > grid.n_columns  # the rest is at the other end of the row
    rest_first = first + grid.n_columns if first < 0 else 0
    rest_columns = -first if first < 0 else last - grid.n_columns
    first, last = max(first, 0), min(last, grid.n_columns)
    n, lowest, highest = np.uint32(0), row, row
    for r in range(max(0, row - rows), min(grid.n_rows, row + rows + 1)):
        before = n
        if is_cut:
            k = np.uint32(r * grid.n_columns + rest_first)
            n = _pick_run(grid.points, grid.starts[k], grid.starts[np.uint32(k + rest_columns)], most, candidates, n)
        k = np.uint32(r * grid.n_columns + first)
        n = _pick_run(grid.points, grid.starts[k], grid.starts[np.uint32(k + last - first)], most, candidates, n)
        if n > before:
            lowest, highest = min(lowest, r), r
    is_full = n >= ENOUGH and lowest <= row - rows and highest >= row + rows
    for j in range(FILL):
        candidates[n + np.uint32(j)] = np.inf  # not near anything, whatever y and z
    return np.uint32((n + np.uint32(FILL - 1)) // np.uint32(FILL) * np.uint32(FILL)), is_full


@njit(nogil=True, cache=True)
def sorted_grid(points, elevations, azimuths, lowest, highest):
    """Sort points (n, 3), m, into a grid with `CELLS_PER_WINDOW` rows per half height of the lowest window.

    Returns the grid, and the number of the point in each of its places, (n,). Angles are in rad.
    """
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
