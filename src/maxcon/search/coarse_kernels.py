"""Compiled: sums over the points of a scan in every coarse cell of a window. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import NORMAL_STEPS, PRODUCT_STEPS, ROW_BLOCK

# Columns that are added at once: a fixed number of them is what the compiler turns into vector instructions.
COLUMNS = ROW_BLOCK
STEPS_SQUARED = NORMAL_STEPS**2
POINTS_AT_ONCE = 2**16 // (PRODUCT_STEPS + 1) - 1  # so many bytes, of products that are rounded up, fit into 16 bits


@njit(nogil=True, cache=True)
def first_voxels(points, cosine, sine, corner, cell, low, shape, n_offsets, starts):
    """Write the voxel in which each point lies at the first cell of a heading, and return how many points have one.

    points : (n, 3), roll and pitch applied, about the sensor, m; cosine, sine : of the heading; corner : (x, y, z) of
    the sensor at the first cell, m; cell : edge, m; low : (3,), index of the grid's first voxel; shape : of the grid,
    (nz, ny, nx); n_offsets : cells of the window along x and y; starts : (n,), out, numbers in the flat grid. Points
    whose windows do not lie within the grid are left out.
    """
    nz, ny, nx = shape
    n = 0
    for i in range(points.shape[0]):
        x = np.int64(np.floor((cosine * points[i, 0] - sine * points[i, 1] + corner[0]) / cell)) - low[0]
        y = np.int64(np.floor((sine * points[i, 0] + cosine * points[i, 1] + corner[1]) / cell)) - low[1]
        z = np.int64(np.floor((points[i, 2] + corner[2]) / cell)) - low[2]
        if 0 <= z < nz and 0 <= y <= ny - n_offsets and 0 <= x <= nx - n_offsets:
            starts[n] = (z * ny + y) * nx + x
            n += 1
    return n


@njit(nogil=True, cache=True)
def _add_rows(values, starts, stride, asked, sums):
    """Add the bytes of each point's window to 16-bit sums, (ny, k COLUMNS), in the blocks of rows that are asked for.

    asked : the rows, (m,), and the blocks of `COLUMNS` columns, (m,).
    """
    width, n_of_fours = np.uint64(COLUMNS), starts.shape[0] // 4 * 4
    for p in range(0, n_of_fours, 4):  # four points at once: sums are read and written once for all of them
        for k in range(asked[0].shape[0]):
            y, block = asked[0][k], asked[1][k]
            shift = y * stride + block * COLUMNS
            a, b = np.uint64(starts[p] + shift), np.uint64(starts[p + 1] + shift)
            c, d = np.uint64(starts[p + 2] + shift), np.uint64(starts[p + 3] + shift)
            row_a, row_b = values[a : a + width], values[b : b + width]
            row_c, row_d = values[c : c + width], values[d : d + width]
            total = sums[y, block * COLUMNS : (block + 1) * COLUMNS]
            for x in range(COLUMNS):
                pairs = np.uint16(row_a[x]) + np.uint16(row_b[x]), np.uint16(row_c[x]) + np.uint16(row_d[x])
                total[x] = np.uint16(total[x] + pairs[0] + pairs[1])
    for p in range(n_of_fours, starts.shape[0]):
        for k in range(asked[0].shape[0]):
            y, block = asked[0][k], asked[1][k]
            first = np.uint64(starts[p] + y * stride + block * COLUMNS)
            row = values[first : first + width]
            total = sums[y, block * COLUMNS : (block + 1) * COLUMNS]
            for x in range(COLUMNS):
                total[x] = np.uint16(total[x] + np.uint16(row[x]))


@njit(nogil=True, cache=True)
def sum_windows(points, headings, is_asked, corner, cell, low, shape, values, sums):
    """Add up the bytes that the points of a scan meet in a dense grid at the cells of a window.

    points, corner, cell, low, shape : as of `first_voxels`; headings : (h,), rad; is_asked : (h, n, k), whether sums
    are asked for in blocks of `COLUMNS` cells of a row; values : (nz ny nx + COLUMNS,) uint8, the flat grid; sums :
    (h, n, n) uint16, of more than `POINTS_AT_ONCE` points int32, out.
    """
    n = sums.shape[1]
    starts = np.empty(points.shape[0], np.int64)
    some = np.empty((n, is_asked.shape[2] * COLUMNS), np.uint16)
    for h in range(headings.shape[0]):
        sums[h] = 0
        asked = np.nonzero(is_asked[h])
        if len(asked[0]) == 0:
            continue
        m = first_voxels(points, np.cos(headings[h]), np.sin(headings[h]), corner, cell, low, shape, n, starts)
        for first in range(0, m, POINTS_AT_ONCE):
            some[:] = 0
            _add_rows(values, starts[first : min(m, first + POINTS_AT_ONCE)], shape[2], asked, some)
            sums[h] += some[:, :n]


@njit(nogil=True, cache=True)
def cell_moments(points, headings, corner, cell, low, shape, normals, cells, n_offsets, moments):
    """Write Nxx, Nxy and Nyy, all weights one, of the normals that the points of a scan meet at some cells.

    normals : (nz ny nx, 2) int8, the flat grid; cells : (m, 3), (heading, y, x); moments : (m, 4), count (not written)
    and these, out; the other arguments as of `sum_windows`.
    """
    starts = np.empty(points.shape[0], np.int64)
    last, n = np.int64(-1), 0
    for k in range(cells.shape[0]):
        h = cells[k, 0]
        if h != last:
            n = first_voxels(
                points, np.cos(headings[h]), np.sin(headings[h]), corner, cell, low, shape, n_offsets, starts
            )
            last = h
        shift = cells[k, 1] * shape[2] + cells[k, 2]
        xx = xy = yy = np.int64(0)
        for p in range(n):
            place = starts[p] + shift
            a, b = np.int64(normals[place, 0]), np.int64(normals[place, 1])
            xx += a * a
            xy += a * b
            yy += b * b
        moments[k, 1], moments[k, 2], moments[k, 3] = xx / STEPS_SQUARED, xy / STEPS_SQUARED, yy / STEPS_SQUARED
