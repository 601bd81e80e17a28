"""Compiled: a plane through each point of a scan and its neighbours, which are looked for in a window of angles.

The window around a point grows until more than one ring is in it; only then is it decided whether they form a plane.
"""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.scan.grid_kernels import MOST_REACH, STRIDE, pick_candidates, sorted_grid
from maxcon.scan.plane_kernels import BLOCK, plane_normals, squares_across, sum_near
from maxcon.scan.window_kernels import GROWTH, HIGHEST, LEAST_NEIGHBOURS, LEAST_SPREAD

# Half heights of windows are at least so many metres: in smaller ones near the sensor, range noise exceeds any extent.
NEAR_METRES = 0.15
MOST_GROWTHS = 8
# A window reaches this ratio of its half height (and at least so many metres, at most so many rad) left and right.
ALONG = 0.5
ALONG_METRES = 0.25
MOST_ALONG = 0.5
# Neighbours lie within so many half heights (and at least so many metres) of the point: no depth edge is bridged.
GATE = 1.6
GATE_METRES = 0.3
# Neighbours are spread in two dimensions if they deviate, across the rings and along the second axis of their plane,
# by at least LEAST_SPREAD half heights and so many metres: rings of real scanners are not quite level, and near
# ranges are some centimetres off from ring to ring. A single ring must not pass for two.
LEAST_SPREAD_METRES = 0.08
# A plane's smallest eigenvalue is below this share of the middle one.
FLATNESS = 0.25
# How often windows grow is decided on a sample of about so many points: until this share of their planes is found.
# Planes whose normal has a z of LEVEL or more do not count: mostly ground, they constrain no horizontal position.
SAMPLE = 256
WORTHWHILE = 0.93
LEVEL = 0.9


@njit(nogil=True, cache=True)
def _take_block(grid, pending, first, factor, block):
    """Fill a block with pending points from number `first` on; return how many, and the number to go on with."""
    places, points, heights = block
    n, k = 0, first
    while n < BLOCK and k < len(pending):
        place = pending[k]
        x, y, z = grid.points[place, 0], grid.points[place, 1], grid.points[place, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        height = factor * max(grid.heights[grid.cells[place] // grid.n_columns], NEAR_METRES / max(distance, 1e-3))
        if height <= HIGHEST:
            places[n], heights[n] = place, height
            points[n], points[BLOCK + n], points[2 * BLOCK + n] = x, y, z
            n += 1
        k += 1
    return n, k


@njit(nogil=True, cache=True)
def _reaches(n, points, heights, n_columns, row_step, gates, rows, columns):
    """How far from each of n points its neighbours may lie: in space (m), and in rows and columns of the grid."""
    for k in range(n):
        x, y, z = points[k], points[BLOCK + k], points[2 * BLOCK + k]
        square = x * x + y * y
        reach = heights[k] * np.sqrt(square + z * z)
        gates[k] = max(GATE_METRES, GATE * reach)
        rows[k] = min(int(np.ceil(heights[k] / row_step - 1e-9)), MOST_REACH)
        along = max(ALONG * reach, ALONG_METRES) / max(np.sqrt(square), 1e-3)
        # Not min(): NaN, as of points infinitely far out, becomes MOST_ALONG too.
        along = along if along <= MOST_ALONG else MOST_ALONG
        columns[k] = min(int(along / (2.0 * np.pi) * n_columns + 0.5), n_columns // 2 - 1)


@njit(nogil=True, cache=True)
def _sum_block(grid, n, block, reaches, candidates, moments, is_full):
    """Write the moments of the neighbours of n points; points of one cell with equal windows share candidates."""
    places, points, _ = block
    gates, rows, columns = reaches
    n_near, is_window_full = np.uint32(0), False
    for k in range(n):
        cell = grid.cells[places[k]]
        is_same = k > 0 and cell == grid.cells[places[k - 1]]
        if not (is_same and rows[k] == rows[k - 1] and columns[k] == columns[k - 1]):
            n_near, is_window_full = pick_candidates(grid, np.int64(cell), rows[k], columns[k], candidates)
        is_full[k] = is_window_full
        sum_near(
            candidates, STRIDE, n_near, points[k], points[BLOCK + k], points[2 * BLOCK + k], gates[k], moments, k
        )  # fmt: skip


@njit(nogil=True, cache=True)
def _write_normals(n, block, moments, squares, planes, normals, is_spread):
    """Write whether the neighbours of n points are spread, and normals, turned to the sensor; zeros for no plane."""
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
    """Fit planes in windows `factor` times as high; return how many pending points, moved to the front, want more."""
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
        _write_normals(n, block, moments, squares, planes, found, is_spread)
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
    """How often windows must grow to find nearly all planes that are not level, in a sample of the points."""
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
def scan_planes(points, elevations, azimuths, lowest, highest, is_asked, normals):
    """Write the normal of the plane through each asked point and its neighbours, (n, 3), turned to the sensor.

    points : (n, 3) float64, sensor frame, m, n > 0; elevations, azimuths : (n,), rad; lowest, highest : of the former.
    """
    grid, order = sorted_grid(points, elevations, azimuths, lowest, highest)
    sorted_normals = np.zeros_like(points)
    last = _worthwhile_growths(grid, sorted_normals)
    pending, n_pending = np.flatnonzero(is_asked[order]).astype(np.uint32), np.count_nonzero(is_asked)
    sorted_normals[:] = 0.0
    for growths in range(last + 1):
        n_pending = _fit_pending(grid, pending[:n_pending], GROWTH**growths, sorted_normals)
    for k in range(len(order)):
        for axis in range(3):
            normals[order[k], axis] = sorted_normals[k, axis]


@njit(nogil=True, cache=True)
def count_normals(normals, up, horizontal):
    """How many normals (n, 3) are not zeros, and how many of them are horizontal: less than that along `up`."""
    n_normals, n_horizontal = 0, 0
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        has_normal = (x != 0.0) | (y != 0.0) | (z != 0.0)
        n_normals += has_normal
        n_horizontal += has_normal & (abs(up[0] * x + up[1] * y + up[2] * z) < horizontal)
    return n_normals, n_horizontal
