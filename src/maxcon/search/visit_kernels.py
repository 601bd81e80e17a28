"""Compiled: scans turned by headings; which groups of points can match which voxels of a tile, and at which headings.

At the offsets of a window, the points of a group can match the voxels in their own box (x first to x last, y first to
y last voxel), grown by the window. From one heading to the next the box hardly moves, so that a group at several
headings shares one box, and its voxels are read from the map once. Three tables of integers say what is read:

Visits (`plan_visits`): a group at a run of headings. Columns: group, first heading, end of headings, box at offset 0. A
    new visit begins where the box would become wider than RIM.
Visits of each tile (`visits_of_tiles`): those of tile t are numbers[starts[t] : starts[t + 1]], and `rectangles` has
    the part of the tile that each can reach, in voxels from the tile's corner.
Stops in one tile (`stops_in_tile`): its visits that can reach any voxel there.

A run (first, end) is a row of neighbouring patches. A tile keeps its voxels layer by layer, in a layer patch by patch,
row by row: so the patches of a rectangle in one row are one piece of memory. The two kernels of `window_kernels`
go from stop to stop.
"""

from typing import Any, NamedTuple

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import PATCH_VOXELS

# A group visits the map at all headings between which its box grows by no more than 25 voxels from first to last; that
# of a turned square of 16 is 23 wide. Sums have so many cells more on each side, for votes beside the window.
RIM = 25

PATCH_BITS = PATCH_VOXELS.bit_length() - 1

# Columns of visits: a group of points, the headings of the visit (the last one is not among them), its box of voxels.
GROUP, HEADING, END_HEADING, X_FIRST, X_LAST, Y_FIRST, Y_LAST = range(7)


class TileVoxels(NamedTuple):
    """The voxels of a tile in the order of the search, see `VoxelTile`.

    Kernels are handed it as a plain tuple, and name the fields again: numba never lets go of the arrays of a named
    tuple that it is handed.

    corner : (x, y) voxel index of its first; columns : (k, 2) int16; normals : (k, 3) float32; counts : (k,) int32, or
    empty where a voxel counts once.
    """

    corner: Any
    columns: Any
    normals: Any
    counts: Any


@njit(nogil=True, cache=True)
def turn_to_columns(points, turns, place, cell):
    """Turn an upright scan about the sensor, by each of some headings: voxel columns in the map's axes.

    points : (2, n) float64; turns : (headings, 2) float64, cosine and sine; place : (x, y) of the sensor, m;
    cell : voxel edge, m. Returns (headings, 2, n) int32.
    """
    columns = np.empty((turns.shape[0], 2, points.shape[1]), np.int32)
    for heading in range(turns.shape[0]):
        cosine, sine = turns[heading, 0], turns[heading, 1]
        for i in range(points.shape[1]):
            x, y = points[0, i], points[1, i]
            columns[heading, 0, i] = np.int32(np.floor((x * cosine - y * sine + place[0]) / cell))
            columns[heading, 1, i] = np.int32(np.floor((x * sine + y * cosine + place[1]) / cell))
    return columns


@njit(nogil=True, cache=True)
def turn_normals(normals, turns):
    """Turn normals, (3, n) float64, by each of some headings, as above: (headings, 3, n) float32."""
    turned = np.empty((turns.shape[0], 3, normals.shape[1]), np.float32)
    for heading in range(turns.shape[0]):
        cosine, sine = turns[heading, 0], turns[heading, 1]
        for i in range(normals.shape[1]):
            turned[heading, 0, i] = normals[0, i] * cosine - normals[1, i] * sine
            turned[heading, 1, i] = normals[0, i] * sine + normals[1, i] * cosine
            turned[heading, 2, i] = normals[2, i]
    return turned


@njit(nogil=True, cache=True)
def _boxes(starts, columns, boxes):
    """Boxes of groups at one heading, (groups, 4) int32, out: x first, x last, y first, y last voxel.

    Group by group at one heading, not heading by heading for one group: that reads columns in a row, and made
    planning twice as fast.
    """
    i = np.uint64(0)
    for group in range(boxes.shape[0]):
        x_first = x_last = columns[0, i]
        y_first = y_last = columns[1, i]
        end = np.uint64(starts[group + 1])
        while i < end:
            x, y = columns[0, i], columns[1, i]
            x_first, x_last = min(x_first, x), max(x_last, x)
            y_first, y_last = min(y_first, y), max(y_last, y)
            i += np.uint64(1)
        boxes[group, 0], boxes[group, 1], boxes[group, 2], boxes[group, 3] = x_first, x_last, y_first, y_last


@njit(nogil=True, cache=True)
def _box(boxes, group):
    """(x first, x last, y first, y last) of a group."""
    return (np.int64(boxes[group, 0]), np.int64(boxes[group, 1]), np.int64(boxes[group, 2]), np.int64(boxes[group, 3]))


@njit(nogil=True, cache=True)
def plan_visits(starts, columns):
    """Part the headings of each group of points into runs at which it keeps within RIM voxels.

    starts : (groups + 1,), first point of each group; columns : (headings, 2, n) int32.
    Returns visits, (m, 7) int64: group, first heading, end of headings, x first, x last, y first, y last.
    """
    n_headings, n_groups = columns.shape[0], starts.shape[0] - 1
    boxes = np.empty((n_headings, n_groups, 4), np.int32)
    for heading in range(n_headings):
        _boxes(starts, columns[heading], boxes[heading])
    visits = np.empty((n_headings * n_groups, 7), np.int64)
    n_visits = 0
    for group in range(n_groups):
        since = 0
        x_first, x_last, y_first, y_last = _box(boxes[0], group)
        for heading in range(1, n_headings):
            box = _box(boxes[heading], group)
            x_low, x_high = min(x_first, box[0]), max(x_last, box[1])
            y_low, y_high = min(y_first, box[2]), max(y_last, box[3])
            if max(x_high - x_low, y_high - y_low) > RIM:
                visits[n_visits] = (group, since, heading, x_first, x_last, y_first, y_last)
                n_visits += 1
                since = heading
                x_first, x_last, y_first, y_last = box
            else:
                x_first, x_last, y_first, y_last = x_low, x_high, y_low, y_high
        visits[n_visits] = (group, since, n_headings, x_first, x_last, y_first, y_last)
        n_visits += 1
    return visits[:n_visits]


@njit(nogil=True, cache=True)
def visits_of_tiles(visits, window, edge_bits, corner, shape):
    """For each tile of a grid, the visits that meet it at some offset of a window.

    window : (x first, x last, y first, y last) offset; the box of a visit meets voxels from its first + the first to
    its last + the last.
    edge_bits : a tile has 2^edge_bits voxels along an edge; corner : (x, y) key of the grid's first tile; shape : (ny,
    nx) tiles.
    Returns starts, (ny * nx + 1,), and numbers, so that tile t has numbers[starts[t] : starts[t + 1]]; and rectangles,
    (k, 4) int64, in the same order: which voxels of the tile each visit meets, x first, x last, y first, y last.
    """
    ny, nx = shape
    x_first, x_last, y_first, y_last = window
    starts = np.zeros(ny * nx + 1, np.int64)
    numbers, rectangles, last = np.empty(0, np.int64), np.empty((0, 4), np.int64), (1 << edge_bits) - 1
    for is_filling in (False, True):
        for i in range(visits.shape[0]):
            tx_first = max(((visits[i, X_FIRST] + x_first) >> edge_bits) - corner[0], 0)
            tx_last = min(((visits[i, X_LAST] + x_last) >> edge_bits) - corner[0], nx - 1)
            ty_first = max(((visits[i, Y_FIRST] + y_first) >> edge_bits) - corner[1], 0)
            ty_last = min(((visits[i, Y_LAST] + y_last) >> edge_bits) - corner[1], ny - 1)
            for ty in range(ty_first, ty_last + 1):
                for tx in range(tx_first, tx_last + 1):
                    tile = ty * nx + tx
                    if is_filling:
                        x, y = (tx + corner[0]) << edge_bits, (ty + corner[1]) << edge_bits
                        numbers[starts[tile]] = i
                        rectangles[starts[tile]] = (
                            max(visits[i, X_FIRST] + x_first - x, 0),
                            min(visits[i, X_LAST] + x_last - x, last),
                            max(visits[i, Y_FIRST] + y_first - y, 0),
                            min(visits[i, Y_LAST] + y_last - y, last),
                        )
                        starts[tile] += 1
                    else:
                        starts[tile + 1] += 1
        if is_filling:
            starts[1:] = starts[:-1].copy()
            starts[0] = 0
        else:
            starts = np.cumsum(starts)
            numbers, rectangles = np.empty(starts[-1], np.int64), np.empty((starts[-1], 4), np.int64)
    return starts, numbers, rectangles


@njit(nogil=True, cache=True)
def stops_in_tile(
    visits, numbers, rectangles, starts, middles, layers, lowest, layer_numbers, patch_starts, n_patches
):  # fmt: skip
    """Where in a tile its visits look for voxels.

    visits : as planned; numbers, rectangles : those that meet the tile, see `visits_of_tiles`; starts, middles,
    layers : of the groups, see `PreparedScan`; lowest : z index of the tile's lowest layer; layer_numbers : of its
    layers from there on, -1 where there is none; patch_starts : first voxel of each patch of the tile, see `TileIndex`;
    n_patches : patches along its edge.
    Returns stops, (k, 11) int64, whose columns kernels unpack as first, middle (first without a normal), end of the
    points; since, until: first and end of the headings; x_first, x_last, y_first, y_last voxel; run, end_run; and
    runs, (m, 2) int64: first and end of voxels that follow each other in the tile. The runs of a stop hold all voxels
    of its rectangle, and some beside. A visit that meets no voxels makes no stop.
    """
    n_rows = 0
    for at in range(numbers.shape[0]):
        n_rows += (rectangles[at, 3] >> PATCH_BITS) - (rectangles[at, 2] >> PATCH_BITS) + 1
    stops, runs = np.empty((numbers.shape[0], 11), np.int64), np.empty((n_rows, 2), np.int64)
    n_stops, n_runs = 0, 0
    for at in range(numbers.shape[0]):
        group, since, until = (
            visits[numbers[at], GROUP],
            visits[numbers[at], HEADING],
            visits[numbers[at], END_HEADING],
        )
        height, first_run = layers[group] - lowest, n_runs
        if not 0 <= height < layer_numbers.shape[0] or layer_numbers[height] < 0:
            continue
        layer = layer_numbers[height]
        x_first, x_last, y_first, y_last = rectangles[at]
        for py in range(y_first >> PATCH_BITS, (y_last >> PATCH_BITS) + 1):
            row = (layer * n_patches + py) * n_patches
            first = np.int64(patch_starts[row + (x_first >> PATCH_BITS)])
            end = np.int64(patch_starts[row + (x_last >> PATCH_BITS) + 1])
            if first < end:
                runs[n_runs] = (first, end)
                n_runs += 1
        if first_run < n_runs:
            stops[n_stops] = (
                starts[group], middles[group], starts[group + 1], since, until,
                x_first, x_last, y_first, y_last, first_run, n_runs,
            )  # fmt: skip
            n_stops += 1
    return stops[:n_stops], runs[:n_runs]
