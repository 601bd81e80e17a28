"""Compiled: sums over the matches of all cells of a window: their moments (D5), or what bounds them along one axis.

Both kernels work tile by tile, on the stops of `visit_kernels`: a group of neighbouring scan points, at a run of
headings, and the voxels of one tile that these points can meet at some cell of the window.

How a cell is found. A scan point in voxel (px, py) meets the map's voxel (vx, vy) at the cell of offset
(vx - px, vy - py). The sums of one heading lie row by row: the offset (x, y) has its place at y * stride + x. So the
place is the sum of two parts, `cells` = vy * stride + vx of the voxel and `base` = -(py * stride + px) of the point:
one addition for each match. The sums are RIM cells wider than the window on each side, because the box of a stop holds
voxels that only some of its points meet within the window; what falls there is cut off in the end.

How a stop is summed. Its voxels are laid out in short arrays, CAPACITY at a time, which stay in the L1 cache; each
point at each heading then runs over them twice: a loop without branches computes what the matches add (the compiler
makes vector instructions of it: `normals` and the like are one array for each component for that), and a second one
adds this to the cells, which lie scattered.
"""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.search.accumulator import ROUNDER
from maxcon.search.visit_kernels import RIM, TileVoxels

# Voxels that are laid out at a time, a multiple of the blocks in which loops over them run.
CAPACITY = 256
BLOCK = 32
LANES = 8


@njit(nogil=True, cache=True)
def _read_on(runs, run, end_run, k):
    """Where to read on once all voxels before k are read: the run, and its next voxel."""
    if k < runs[run, 1]:
        return run, k
    run += 1
    return run, runs[run, 0] if run < end_run else k


@njit(nogil=True, cache=True)
def accumulate_tile(stops, runs, tile, columns, normals, window, stride, without_normal, is_signed, sums):
    """Add all matches of some scan points with one tile to the sums of some headings.

    stops, runs : see `stops_in_tile`; tile : fields of `TileVoxels`; columns : (headings, 2, n) int32, voxels of the
    points; normals : (headings, 3, n) float32, theirs.
    window : (x first, x last, y first, y last) offset; stride : cells from one row of the sums to the next;
    without_normal : weight of a match whose scan point has no normal; sums : (headings, 4 rows stride) float64, the
    four moments of a cell side by side.
    """
    voxels = TileVoxels(*tile)
    origin = (RIM + voxels.corner[1] - window[2]) * stride + RIM + voxels.corner[0] - window[0]
    back = np.float32(0.0 if is_signed else -1.0)
    selected, cells = np.empty(CAPACITY, np.int64), np.empty(CAPACITY, np.int64)
    facing, outer = np.zeros((3, CAPACITY), np.float32), np.zeros((3, CAPACITY))
    times, added = np.ones(CAPACITY), np.empty((3, CAPACITY))
    for at in range(stops.shape[0]):
        first, middle, end, since, until, x_first, x_last, y_first, y_last, run, end_run = stops[at]
        n, k = np.uint64(0), runs[run, 0]
        while run < end_run:
            to = min(runs[run, 1], k + CAPACITY - np.int64(n))
            n = _select(voxels.columns, k, to, (x_first, x_last, y_first, y_last), selected, n)
            run, k = _read_on(runs, run, end_run, to)
            if n == CAPACITY or (run == end_run and n > 0):
                _lay_out(selected[:n], voxels, stride, facing, outer, times, cells)
                n_voxels, n = np.int64(n), np.uint64(0)
                for heading in range(since, until):
                    x, y, turned, of_heading = columns[heading, 0], columns[heading, 1], normals[heading], sums[heading]
                    for i in range(first, middle):
                        _weigh(n_voxels, facing, outer, times, turned[0, i], turned[1, i], turned[2, i], back, added)
                        base = 4 * (origin - y[i] * stride - x[i])
                        _add(n_voxels, cells, times, added, base, 1.0, of_heading)
                if middle < end:
                    _weigh_alike(n_voxels, outer, times, without_normal, added)
                    for heading in range(since, until):
                        _add_alike(
                            n_voxels, cells, times, added, middle, end, columns[heading], origin, stride, sums[heading]
                        )


@njit(nogil=True, cache=True)
def _select(columns, first, end, rectangle, selected, n):
    """Append to `selected` those voxels of a run that lie in a rectangle; without a branch. Returns how many."""
    x_first, y_first = rectangle[0], rectangle[2]
    width, height = np.uint32(rectangle[1] - x_first), np.uint32(rectangle[3] - y_first)
    for k in range(first, end):
        selected[n] = k
        x = np.uint32(np.int32(columns[np.uint64(k), 0]) - x_first)
        y = np.uint32(np.int32(columns[np.uint64(k), 1]) - y_first)
        n += np.uint64((x <= width) & (y <= height))
    return n


@njit(nogil=True, cache=True)
def _lay_out(selected, voxels, stride, facing, outer, times, cells):
    """Lay out voxels: normals n, (3, c) float32; nx nx, nx ny, ny ny, (3, c) float64; how often they count; cells."""
    for j in range(selected.shape[0]):
        k = np.uint64(selected[j])
        nx, ny, nz = voxels.normals[k, 0], voxels.normals[k, 1], voxels.normals[k, 2]
        facing[0, j], facing[1, j], facing[2, j] = nx, ny, nz
        outer[0, j], outer[1, j], outer[2, j] = nx * nx, nx * ny, ny * ny
        cells[j] = 4 * (np.int64(voxels.columns[k, 1]) * stride + voxels.columns[k, 0])
        if voxels.counts.shape[0] > 0:
            times[j] = voxels.counts[k]


@njit(nogil=True, cache=True)
def _weigh(n, facing, outer, times, nx, ny, nz, back, added):
    """What the matches of a scan point of normal (nx, ny, nz) with n voxels add to N, rounded: (3, c) float64.

    The weight is max(c, 0) where normals have a side (back = 0), and |c| = max(c, -c) where not (back = -1). Whole
    blocks are computed, so that the vectorized loop has no remainder.
    """
    for j in range((n + BLOCK - 1) // BLOCK * BLOCK):
        cosine = nx * facing[0, j] + ny * facing[1, j] + nz * facing[2, j]
        weight = np.float64(max(cosine, back * cosine)) * times[j]
        added[0, j] = weight * outer[0, j] + ROUNDER - ROUNDER
        added[1, j] = weight * outer[1, j] + ROUNDER - ROUNDER
        added[2, j] = weight * outer[2, j] + ROUNDER - ROUNDER


@njit(nogil=True, cache=True)
def _weigh_alike(n, outer, times, weight, added):
    """What the matches of a scan point without a normal add: the same for all of them."""
    for j in range(n):
        added[0, j] = weight * times[j] * outer[0, j] + ROUNDER - ROUNDER
        added[1, j] = weight * times[j] * outer[1, j] + ROUNDER - ROUNDER
        added[2, j] = weight * times[j] * outer[2, j] + ROUNDER - ROUNDER


@njit(nogil=True, cache=True)
def _add_alike(n, cells, times, added, first, end, columns, origin, stride, sums):
    """Add the matches of points without a normal: those in one voxel follow each other, and are added at once."""
    i = first
    while i < end:
        x, y, n_alike = columns[0, i], columns[1, i], 0.0
        while i < end and columns[0, i] == x and columns[1, i] == y:
            n_alike += 1.0
            i += 1
        _add(n, cells, times, added, 4 * (origin - y * stride - x), n_alike, sums)


@njit(nogil=True, cache=True, fastmath={"contract"})
def _add(n, cells, times, added, base, n_alike, sums):
    """Add what n_alike scan points in one voxel add at n voxels, to the sums of their cells.

    All are multiples of a step that float64 holds exactly: to fuse product and sum ("contract") changes nothing.
    """
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for j in range(n):
        to = np.uint64(base + cells[j])
        count, xx = sums[to] + n_alike * times[j], sums[to + one] + n_alike * added[0, j]
        xy, yy = sums[to + two] + n_alike * added[1, j], sums[to + three] + n_alike * added[2, j]
        sums[to], sums[to + one], sums[to + two], sums[to + three] = count, xx, xy, yy


@njit(nogil=True, cache=True)
def sum_tile(
    stops, runs, tile, bases, normals, turns, weight, are_alike, is_signed, axis, window, stride, least, scale, sums
):  # fmt: skip
    """Add the most that all matches of some scan points with one tile can add to the sums of their cells.

    stops, runs, tile, window, stride, is_signed : as of `accumulate_tile`; bases : (n, headings), see
    `bases_of_points`; normals : (n, 3) float32, of the points, not turned; turns : (headings, 2) float32, cosine and
    sine; weight : of a match whose scan point has no normal, or of all where `are_alike`; axis : (x, y) float32, unit,
    or zeros to count; least : voxels that add no more are left out; scale : float32, units of the sums in one; sums :
    (headings * rows * stride,) int32 or int64.
    """
    voxels, stride = TileVoxels(*tile), np.int32(stride)
    origin = (RIM + voxels.corner[1] - window[2]) * np.int64(stride) + RIM + voxels.corner[0] - window[0]
    back, weight = np.float32(0.0 if is_signed else -1.0), np.float32(weight)
    cells, rows, added = np.empty(CAPACITY, np.int32), np.empty((4, CAPACITY), np.float32), np.empty(CAPACITY, np.int32)
    for at in range(stops.shape[0]):
        first, middle, end, since, until, x_first, x_last, y_first, y_last, run, end_run = stops[at]
        middle = first if are_alike else middle
        low = (np.int32(x_first), np.int32(y_first))
        span = (np.uint32(x_last - x_first), np.uint32(y_last - y_first))
        n, k = np.uint64(0), runs[run, 0]
        while run < end_run:
            to = min(runs[run, 1], k + CAPACITY - np.int64(n))
            n = _lay_out_along(voxels, axis, k, to, low, span, least, scale, stride, cells, rows, n)
            run, k = _read_on(runs, run, end_run, to)
            if n == CAPACITY or (run == end_run and n > 0):
                n_padded = _pad(np.int64(n), cells, rows)
                n = np.uint64(0)
                for i in range(first, middle):
                    for heading in range(since, until):
                        normal = _turned(normals, i, turns, heading)
                        _weigh_along(n_padded, rows, normal, back, added)
                        _vote(n_padded, cells, added, origin + bases[i, heading], sums)
                if middle < end:
                    for j in range(n_padded):
                        added[j] = np.int32(rows[3, j] * weight + np.float32(2.0))
                for i in range(middle, end):
                    for heading in range(since, until):
                        _vote(n_padded, cells, added, origin + bases[i, heading], sums)


@njit(nogil=True, cache=True)
def bases_of_points(columns, stride, plane):
    """Where a voxel (0, 0) meets each point in the sums of each heading, less the origin; (n, headings) int64.

    columns : (headings, 2, n) int32; stride, plane : cells from one row, and from one heading, to the next. All
    headings of a point are read together.
    """
    bases = np.empty((columns.shape[2], columns.shape[0]), np.int64)
    for i in range(columns.shape[2]):
        for heading in range(columns.shape[0]):
            x, y = np.int64(columns[heading, 0, i]), np.int64(columns[heading, 1, i])
            bases[i, heading] = heading * plane - y * stride - x
    return bases


@njit(nogil=True, cache=True)
def _lay_out_along(voxels, axis, first, end, low, span, least, scale, stride, cells, rows, n):
    """Lay out those voxels of a run that lie in a rectangle and of which a match adds more than `least`; no branch.

    rows : (4, c) float32, out, normal times what a match of weight one adds along the axis, and that; cells : (c,)
    int32, out. Returns how many there are.
    """
    columns, normals, counts = voxels.columns, voxels.normals, voxels.counts
    has_counts, is_count = counts.shape[0] > 0, axis[0] == 0.0 and axis[1] == 0.0
    for k in range(np.uint64(first), np.uint64(end)):
        x, y = np.int32(columns[k, 0]), np.int32(columns[k, 1])
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        along = nx * axis[0] + ny * axis[1]
        value = np.float32(1.0) if is_count else along * along
        if has_counts:
            value *= np.float32(counts[k])
        units = value * scale
        cells[n] = y * stride + x
        rows[0, n], rows[1, n], rows[2, n] = nx * units, ny * units, nz * units
        rows[3, n] = units
        is_inside = (np.uint32(x - low[0]) <= span[0]) & (np.uint32(y - low[1]) <= span[1])
        n += np.uint64(is_inside & (value > least))
    return n


@njit(nogil=True, cache=True)
def _pad(n, cells, rows):
    """Fill up to whole blocks of LANES with voxels that add two units at most, at the cell of the last one."""
    n_padded = (n + LANES - 1) // LANES * LANES
    cells[n:n_padded] = cells[n - 1]
    rows[:, n:n_padded] = np.float32(0.0)
    return n_padded


@njit(nogil=True, cache=True)
def _turned(normals, i, turns, heading):
    """Normal of a point at a heading."""
    nx, ny, cosine, sine = normals[i, 0], normals[i, 1], turns[heading, 0], turns[heading, 1]
    return nx * cosine - ny * sine, nx * sine + ny * cosine, normals[i, 2]


@njit(nogil=True, cache=True, fastmath={"contract"})
def _weigh_along(n, rows, normal, back, added):
    """What the matches of a scan point of a normal with n voxels add at most, in whole units, (c,) int32.

    Of the 2 added one rounds up, and one covers the errors of float32.
    """
    nx, ny, nz = normal
    for j in range(n):
        cosine = rows[0, j] * nx + rows[1, j] * ny + rows[2, j] * nz
        added[j] = np.int32(max(cosine, back * cosine) + np.float32(2.0))


@njit(nogil=True, cache=True)
def _vote(n, cells, added, base, sums):
    """Let a scan point vote for the cells at which it meets n voxels."""
    for j in range(n):
        sums[np.uint64(base + cells[j])] += added[j]
