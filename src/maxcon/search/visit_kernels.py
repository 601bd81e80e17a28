# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: which scan points look at which voxels of the map together.

A visit is a group of scan points, at a run of headings, and the box of voxels that they cover there. Its voxels are
read from the map once, for all its points and headings (decision 13).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

__all__ = [
    "RIM",
    "SQUARE_VOXELS",
    "Met",
    "Planned",
    "TileVoxels",
    "plan_visits",
    "turn_normals",
    "turn_to_columns",
    "visits_of_tiles",
]

# Points of one height layer in a square of 16 x 16 voxels are a group: they visit the map together, ...
SQUARE_VOXELS = 16
# ... at all headings at which the group stays within a box of 25 voxels; a turned square is 23 wide.
RIM = 25


# Kernels are handed these as plain tuples, `tuple(met)`, and name their fields again: numba never lets go of the arrays
# of a named tuple that it is handed.


class Planned(NamedTuple):
    """The groups of a scan, and when they visit the map.

    visits : (m, 7) int64, as `plan_visits` planned them.
    starts : (groups + 1,) int64, first point of each; middles : (groups,), its first without a normal; ranks :
    (groups,), number of its height layer among the scan's.
    """

    visits: Any
    starts: Any
    middles: Any
    ranks: Any


class Met(NamedTuple):
    """What meets a tile.

    numbers : (k,) int64, which visits; rectangles : (k, 4) int64, which voxels of the tile each of them meets: x first,
    x last, y first, y last; layers : for each height layer of the scan its number in the tile, -1 for none.
    """

    numbers: Any
    rectangles: Any
    layers: Any


class TileVoxels(NamedTuple):
    """The voxels of a tile in the order of the search, see `VoxelTile` and `TileIndex`.

    corner : (x, y) voxel index of its first; edge : how many along its edge; patch_starts : first voxel of each patch.
    columns : (k, 2) int16; normals : (k, 3) float32; counts : (k,) int32, or empty where a voxel counts once.
    """

    corner: Any
    edge: Any
    patch_starts: Any
    columns: Any
    normals: Any
    counts: Any


@njit(nogil=True, cache=True)
def turn_to_columns(points, turns, place, cell):
    """Turn a levelled scan about the sensor, by each of some headings: voxel columns in the map's axes.

    points : (2 or 3, n) float64; turns : (headings, 2) float64, cosine and sine; place : (x, y) of the sensor, m;
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
    return (
        np.int64(boxes[group, 0]),
        np.int64(boxes[group, 1]),
        np.int64(boxes[group, 2]),
        np.int64(boxes[group, 3]),
    )


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
            tx_first = max(((visits[i, 3] + x_first) >> edge_bits) - corner[0], 0)
            tx_last = min(((visits[i, 4] + x_last) >> edge_bits) - corner[0], nx - 1)
            ty_first = max(((visits[i, 5] + y_first) >> edge_bits) - corner[1], 0)
            ty_last = min(((visits[i, 6] + y_last) >> edge_bits) - corner[1], ny - 1)
            for ty in range(ty_first, ty_last + 1):
                for tx in range(tx_first, tx_last + 1):
                    tile = ty * nx + tx
                    if is_filling:
                        x, y = (tx + corner[0]) << edge_bits, (ty + corner[1]) << edge_bits
                        numbers[starts[tile]] = i
                        rectangles[starts[tile]] = (
                            max(visits[i, 3] + x_first - x, 0),
                            min(visits[i, 4] + x_last - x, last),
                            max(visits[i, 5] + y_first - y, 0),
                            min(visits[i, 6] + y_last - y, last),
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
