# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: a scan turned upright and sorted into groups of neighbouring points, which are then turned together.

The points of a group lie in one height layer of voxels and in one square of 16 x 16 voxels (at the prior's heading).
At any cell they fall in nearly the same voxels of the map, so that these are read once for all of them.

Groups are made by sorting (`group_scan`). Each point gets one integer as its key, from the highest bits on:

    number of the square and layer | has no normal: 1 bit | y in the square: 4 bits | x in the square: 4 bits

In the order of the keys, the points of group g are starts[g] : starts[g + 1]. Those with a normal come first, up to
middles[g]; those in one voxel follow each other. Neighbouring groups lie in neighbouring squares.

Arrays of points have a row for each coordinate, (2, n) or (3, n), and of turned points one more axis for the heading,
so that loops over points read memory in a row.
"""

from typing import Any, NamedTuple

import numpy as np

from maxcon._system.kernel_cache import njit

# Points of one height layer in a square of 16 x 16 voxels are a group: they visit the map together.
SQUARE_VOXELS = 16

SQUARE_BITS = SQUARE_VOXELS.bit_length() - 1
PLACE_BITS = 2 * SQUARE_BITS
INSIDE = SQUARE_VOXELS - 1

# Keys of one group: one for each voxel of the square for points with a normal, and one for those without.
GROUP_KEYS = 2 ** (PLACE_BITS + 1)

# Keys are sorted by at most 12 bits at a time: 4096 counters fit into the L1 cache.
MOST_DIGIT_BITS = 12


class Groups(NamedTuple):
    """The points of an upright scan in the order of their groups, see `PreparedScan`.

    points : (2, n) float64, x and y; normals : (3, n) float64.
    starts : (groups + 1,) int64, first point of each; middles : (groups,) int64, its first without a normal.
    ranks : (groups,) int64, number of its layer among `layers`, (m,) int64, those that occur, ascending.
    boxes : (groups, 4) int64, x first, x last, y first, y last voxel; radii : (groups,), the farthest that a point is
    from the sensor, m.
    extent : (2, 3), least and largest x, y and z of the points and of the sensor, m.
    spread : (3,), sums of nx nx, nx ny and ny ny over all normals.
    """

    points: Any
    normals: Any
    starts: Any
    middles: Any
    ranks: Any
    layers: Any
    boxes: Any
    radii: Any
    extent: Any
    spread: Any


@njit(nogil=True, cache=True)
def group_scan(points, normals, rotation, height, has_normals, turn, place, cell):
    """Set a scan upright and sort its points into groups of one height layer and one square of SQUARE_VOXELS voxels.

    points, normals : (n, 3) float64, sensor frame; rotation : (3, 3), by the prior's roll and pitch; height : its z, m;
    has_normals : whether normals are looked at, or all points taken as without one.
    turn : (1, 2) float64, cosine and sine of the prior's heading; place : its (x, y), m; cell : voxel edge, m.
    """
    upright, turned, extent = _set_upright(points, normals, rotation, height)
    spread = _spread(turned)
    if not has_normals:
        turned[:] = 0.0
    columns = turn_to_columns(upright, turn, place, cell)[0]
    layers = _to_layers(upright[2], cell)
    order, keys = sort_keys(_keys(columns, layers, turned))
    grouped = gather(upright[:2], order)
    starts, middles, group_layers, boxes, radii = _find_groups(keys, order, grouped, columns, layers)
    ranks, occurring = _rank(group_layers)
    return Groups(grouped, gather(turned, order), starts, middles, ranks, occurring, boxes, radii, extent, spread)


@njit(nogil=True, cache=True)
def _set_upright(points, normals, rotation, height):
    """Turn points and normals, (n, 3) float64, by a rotation, (3, 3), and raise the points; both (3, n).

    With the arithmetic of `accumulator.upright`. Also returns the least and largest coordinates of the points and of
    the sensor, (2, 3).
    """
    n = points.shape[0]
    upright, turned, extent = np.empty((3, n)), np.empty((3, n)), np.zeros((2, 3))
    for row in range(3):
        a, b, c = rotation[row, 0], rotation[row, 1], rotation[row, 2]
        raised, low, high = height if row == 2 else 0.0, 0.0, 0.0
        for i in range(n):
            upright[row, i] = points[i, 0] * a + points[i, 1] * b + points[i, 2] * c + raised
            low, high = min(low, upright[row, i]), max(high, upright[row, i])
        for i in range(n):
            turned[row, i] = normals[i, 0] * a + normals[i, 1] * b + normals[i, 2] * c
        extent[0, row], extent[1, row] = low, high
    return upright, turned, extent


@njit(nogil=True, cache=True)
def _spread(normals):
    """Sums of nx nx, nx ny and ny ny over normals, (3, n): (3,)."""
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(normals.shape[1]):
        xx += normals[0, i] * normals[0, i]
        xy += normals[0, i] * normals[1, i]
        yy += normals[1, i] * normals[1, i]
    return np.array([xx, xy, yy])


@njit(nogil=True, cache=True)
def turn_to_columns(points, turns, place, cell):
    """Turn an upright scan about the sensor, by each of some headings: voxel columns in the map's axes.

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
def _to_layers(heights, cell):
    """Height layer, (n,) int32, of each height, (n,) float64, m."""
    layers = np.empty(heights.shape[0], np.int32)
    for i in range(heights.shape[0]):
        layers[i] = np.int32(np.floor(heights[i] / cell))
    return layers


@njit(nogil=True, cache=True)
def _keys(columns, layers, normals):
    """Numbers by which points are sorted, see `_key_points`."""
    if layers.shape[0] == 0:
        return np.empty(0, np.uint64)
    lows, sizes = _extent(columns, layers)
    n_keys = np.float64(sizes[0]) * np.float64(sizes[1]) * np.float64(sizes[2]) * GROUP_KEYS
    if n_keys > 2.0**62:  # points thousands of kilometres apart; there is no need for that to be fast
        columns, layers = _closed_up(columns, layers)
        lows, sizes = _extent(columns, layers)
    return _key_points(columns, layers, normals, lows, sizes)


@njit(nogil=True, cache=True)
def _extent(columns, layers):
    """Least square along x and y, and least layer; and how many of each there are up to the largest."""
    lows = (
        np.int64(columns[0].min()) >> SQUARE_BITS,
        np.int64(columns[1].min()) >> SQUARE_BITS,
        np.int64(layers.min()),
    )
    sizes = (
        (np.int64(columns[0].max()) >> SQUARE_BITS) - lows[0] + 1,
        (np.int64(columns[1].max()) >> SQUARE_BITS) - lows[1] + 1,
        np.int64(layers.max()) - lows[2] + 1,
    )
    return lows, sizes


@njit(nogil=True, cache=True)
def _closed_up(columns, layers):
    """Columns and layers of the same groups in the same order, but without the empty space between them."""
    squares = np.empty(layers.shape[0], np.int64)
    for i in range(layers.shape[0]):
        x, y = np.int64(columns[0, i]), np.int64(columns[1, i])
        squares[i] = (y >> SQUARE_BITS) * 2**32 + (x >> SQUARE_BITS)
    numbers, _ = _rank(squares)
    closed_layers, _ = _rank(layers.astype(np.int64))
    closed = np.empty(columns.shape, np.int32)
    for i in range(layers.shape[0]):
        closed[0, i] = numbers[i] * SQUARE_VOXELS + (columns[0, i] & INSIDE)
        closed[1, i] = columns[1, i] & INSIDE
    return closed, closed_layers.astype(np.int32)


@njit(nogil=True, cache=True)
def _key_points(columns, layers, normals, lows, sizes):
    """Give each point a number by which sorting brings the points into the order of their groups.

    The order is: y of the square, x of the square, layer, points with a normal before those without, y and x of the
    voxel. A key is GROUP_KEYS times the number of the group, plus the place in the group.

    columns : (2, n) int32; layers : (n,) int32; normals : (3, n) float64; lows, sizes : as `_extent`
    found them.
    Returns keys, (n,) uint64.
    """
    keys = np.empty(layers.shape[0], np.uint64)
    for i in range(layers.shape[0]):
        x, y = np.int64(columns[0, i]), np.int64(columns[1, i])
        is_plain = (normals[0, i] == 0.0) & (normals[1, i] == 0.0) & (normals[2, i] == 0.0)
        group = ((y >> SQUARE_BITS) - lows[1]) * sizes[0] + (x >> SQUARE_BITS) - lows[0]
        group = group * sizes[2] + np.int64(layers[i]) - lows[2]
        place = ((y & INSIDE) << SQUARE_BITS) | (x & INSIDE)
        keys[i] = np.uint64((group << (PLACE_BITS + 1)) | (np.int64(is_plain) << PLACE_BITS) | place)
    return keys


@njit(nogil=True, cache=True)
def sort_keys(keys):
    """Sort keys (radix sort): by the last few bits first, by the first few last, each time stable.

    keys : (n,) uint64, overwritten. Returns their order, (n,) uint32, stable, and the keys in it.
    """
    n, used, n_bits = keys.shape[0], np.uint64(0), 0
    for i in range(n):
        used |= keys[i]
    while n_bits < 64 and used >> np.uint64(n_bits):
        n_bits += 1
    n_passes = max(1, -(-n_bits // MOST_DIGIT_BITS))
    digit_bits = np.uint64(-(-n_bits // n_passes))
    mask = (np.uint64(1) << digit_bits) - np.uint64(1)
    counts = np.zeros((n_passes, np.int64(mask) + 1), np.uint32)
    order, other_order, other_keys = np.empty(n, np.uint32), np.empty(n, np.uint32), np.empty(n, np.uint64)
    for i in range(n):
        order[i], rest = i, keys[i]
        for number in range(n_passes):
            counts[number, rest & mask] += np.uint32(1)
            rest >>= digit_bits
    for number in range(n_passes):
        starts, n_before = counts[number], np.uint32(0)
        for value in range(starts.shape[0]):
            n_alike = starts[value]
            starts[value] = n_before
            n_before += n_alike
        shift = np.uint64(number) * digit_bits
        for i in range(n):
            digit = (keys[i] >> shift) & mask
            to = np.uint64(starts[digit])
            starts[digit] += np.uint32(1)
            other_keys[to], other_order[to] = keys[i], order[i]
        keys, other_keys, order, other_order = other_keys, keys, other_order, order
    return order, keys


@njit(nogil=True, cache=True)
def gather(rows, order):
    """Some columns of rows, (k, n) float64, in an order; their numbers : (m,) uint32 or int32."""
    gathered = np.empty((rows.shape[0], order.shape[0]))
    for row in range(rows.shape[0]):
        for i in range(order.shape[0]):
            gathered[row, i] = rows[row, np.uint64(order[i])]
    return gathered


@njit(nogil=True, cache=True)
def _find_groups(keys, order, points, columns, layers):
    """Find the groups in points that were sorted by their keys.

    keys : (n,) uint64, sorted; order : (n,) uint32; points : (2, n) float64, in order; columns : (2, n) int32 and
    layers : (n,) int32, not in order.
    Returns starts, (groups + 1,), middles, layers, boxes, (groups, 4): x first, x last, y first, y last voxel; all
    int64; and the farthest that a point is from the sensor, (groups,), m.
    """
    n = keys.shape[0]
    starts, middles, group_layers = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    boxes, radii = np.empty((n, 4), np.int64), np.empty(n)
    n_groups, first = 0, 0
    while first < n:
        group = keys[first] >> np.uint64(PLACE_BITS + 1)
        end, n_plain, farthest = first, np.int64(0), 0.0
        x_first = y_first = np.int64(INSIDE)
        x_last = y_last = np.int64(0)
        while end < n and keys[end] >> np.uint64(PLACE_BITS + 1) == group:
            key = np.int64(keys[end])
            x, y = key & INSIDE, (key >> SQUARE_BITS) & INSIDE
            n_plain += (key >> PLACE_BITS) & 1
            x_first, x_last = min(x_first, x), max(x_last, x)
            y_first, y_last = min(y_first, y), max(y_last, y)
            farthest = max(farthest, points[0, end] * points[0, end] + points[1, end] * points[1, end])
            end += 1
        at = np.uint64(order[first])
        x, y = np.int64(columns[0, at]) & ~INSIDE, np.int64(columns[1, at]) & ~INSIDE
        starts[n_groups], middles[n_groups], group_layers[n_groups] = first, end - n_plain, layers[at]
        boxes[n_groups] = (x + x_first, x + x_last, y + y_first, y + y_last)
        radii[n_groups] = np.sqrt(farthest)
        n_groups += 1
        first = end
    starts[n_groups] = n
    return (
        starts[: n_groups + 1].copy(),
        middles[:n_groups].copy(),
        group_layers[:n_groups].copy(),
        boxes[:n_groups].copy(),
        radii[:n_groups].copy(),
    )


@njit(nogil=True, cache=True)
def _rank(values):
    """Ranks of values, (n,) int64, among those that occur; and these, ascending, (m,) int64."""
    n, low = values.shape[0], np.int64(0)
    for value in values:
        low = min(low, value)
    order, keys = sort_keys((values - low).astype(np.uint64))
    ranks, occurring, n_occurring = np.empty(n, np.int64), np.empty(n, np.int64), 0
    for i in range(n):
        if i == 0 or keys[i] != keys[i - 1]:
            occurring[n_occurring] = np.int64(keys[i]) + low
            n_occurring += 1
        ranks[order[i]] = n_occurring - 1
    return ranks, occurring[:n_occurring].copy()


@njit(nogil=True, cache=True)
def meets_tiles(boxes, reaches, cell, edge, keys):
    """Whether any group can fall in a tile, for each.

    boxes : (groups, 4) as found; reaches : (groups,), how far beyond its box a group can fall, m; cell : voxel edge,
    edge : of a tile, m; keys : (tiles, 2) int64, (x, y).
    """
    is_met = np.zeros(keys.shape[0], np.bool_)
    x_first, x_last, y_first, y_last = 0.0, -1.0, 0.0, -1.0
    for group in range(reaches.shape[0]):
        before = (x_first, x_last, y_first, y_last)
        x_first = np.floor((boxes[group, 0] * cell - reaches[group]) / edge)
        x_last = np.floor(((boxes[group, 1] + 1) * cell + reaches[group]) / edge)
        y_first = np.floor((boxes[group, 2] * cell - reaches[group]) / edge)
        y_last = np.floor(((boxes[group, 3] + 1) * cell + reaches[group]) / edge)
        if before == (x_first, x_last, y_first, y_last):  # as most neighbours do
            continue
        for tile in range(keys.shape[0]):
            x, y = keys[tile, 0], keys[tile, 1]
            is_met[tile] |= x_first <= x <= x_last and y_first <= y <= y_last
    return is_met


@njit(nogil=True, cache=True)
def number_layers(tile_layers, layers):
    """Number of each layer of a scan, (m,) int64, among a tile's, (k,) int32, -1 where it has none; both ascending."""
    numbers = np.full(layers.shape[0], -1)
    k = 0
    for i in range(layers.shape[0]):
        while k < tile_layers.shape[0] and tile_layers[k] < layers[i]:
            k += 1
        if k < tile_layers.shape[0] and tile_layers[k] == layers[i]:
            numbers[i] = k
    return numbers
