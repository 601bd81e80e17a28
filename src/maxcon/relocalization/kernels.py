"""Counts of matches of large cells and bounds of many, compiled. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit

REGION = 256  # cells along an edge of a region
BLOCK = 4  # cells along an edge of the blocks that are bounded first
N_BLOCKS = REGION // BLOCK  # blocks in a row of a region: as many as a word has bits
BLOCK_BITS = BLOCK.bit_length() - 1
INSIDE = BLOCK - 1
COUNTER_BITS = 16
TOGETHER = 8
ALL_BITS = np.uint64(2**64 - 1)


@njit(nogil=True, cache=True)
def bound_blocks(blocks, layers, columns, bins, rows, margin, least, bounds):
    """Count the points that match anywhere in each block, at each heading: a bound for all its cells.

    The 64 blocks of a row are counted at once by bit-sliced counters: each bit of a word belongs to one block; word k
    of the counters has bit k of their counts. blocks : see `Region.blocks`; layers : (points,) int64; columns :
    (h, points, 2) int32; bins : (h, points) uint8; rows : (64,) uint64, those asked for; margin : cells before the
    first of the region; bounds : (h, 64, 64) uint16, (Y, X), out, 0 where lower than `least`.
    """
    flat = blocks.reshape(-1)
    counters = np.empty((N_BLOCKS, COUNTER_BITS), np.uint64)
    met = np.flatnonzero(rows)
    n_points = layers.shape[0]
    n_padded = -(-n_points // TOGETHER) * TOGETHER
    starts, shifts, kept = (np.zeros(n_padded, np.uint64), np.zeros(n_padded, np.uint64), np.zeros(n_padded, np.uint64))
    kept[:n_points] = ALL_BITS
    for h in range(columns.shape[0]):
        for i in range(n_points):
            x, y = columns[h, i, 0] + margin, columns[h, i, 1] + margin
            plane = ((layers[i] * 8 + bins[h, i]) * BLOCK + (y & INSIDE)) * BLOCK + (x & INSIDE)
            starts[i] = 2 * (plane * blocks.shape[4] + (y >> BLOCK_BITS))
            shifts[i] = x >> BLOCK_BITS
        counters[:] = np.uint64(0)
        for i in range(0, n_padded, TOGETHER):
            some = slice(i, i + TOGETHER)
            _count_eight(flat, starts[some], shifts[some], kept[some], met, rows, counters)
        for Y in met:
            _read_counters(counters[Y], rows[Y], least, bounds[h, Y])


@njit(nogil=True, cache=True, inline="always")
def _matches(flat, starts, shifts, kept, k, row):
    """Which blocks of a row point k matches in; `row` is twice its number."""
    place, shift = starts[k] + row, shifts[k]
    left = (flat[place + np.uint64(1)] << np.uint64(1)) << (np.uint64(63) - shift)
    return ((flat[place] >> shift) | left) & kept[k]


@njit(nogil=True, cache=True, inline="always")
def _sum(a, b, c):
    """Sum of three bits in each place: its lower bit, and its upper one."""
    either = a ^ b
    return either ^ c, (a & b) | (either & c)


@njit(nogil=True, cache=True)
def _count_eight(flat, starts, shifts, kept, met, rows, counters):
    """Add the matches of eight points to the counters of each row: by seven sums of three, and one carry."""
    for Y in met:
        row, mine = np.uint64(2 * Y), counters[Y]
        w0, w1 = _matches(flat, starts, shifts, kept, 0, row), _matches(flat, starts, shifts, kept, 1, row)
        w2, w3 = _matches(flat, starts, shifts, kept, 2, row), _matches(flat, starts, shifts, kept, 3, row)
        w4, w5 = _matches(flat, starts, shifts, kept, 4, row), _matches(flat, starts, shifts, kept, 5, row)
        w6, w7 = _matches(flat, starts, shifts, kept, 6, row), _matches(flat, starts, shifts, kept, 7, row)
        ones, two_a = _sum(mine[0], w0, w1)
        ones, two_b = _sum(ones, w2, w3)
        ones, two_c = _sum(ones, w4, w5)
        ones, two_d = _sum(ones, w6, w7)
        twos, four_a = _sum(mine[1], two_a, two_b)
        twos, four_b = _sum(twos, two_c, two_d)
        fours, carry = _sum(mine[2], four_a, four_b)
        mine[0], mine[1], mine[2] = ones, twos, fours
        carry &= rows[Y]
        k = 3
        while carry != np.uint64(0):
            over = mine[k] & carry
            mine[k] ^= carry
            carry = over
            k += 1


@njit(nogil=True, cache=True)
def _read_counters(counters, row, least, bounds):
    """Counts of the blocks of a row that are asked for and not below `least`; 0 for the others."""
    above, equal = np.uint64(0), row
    for k in range(COUNTER_BITS - 1, -1, -1):
        if (least >> k) & 1:
            equal &= counters[k]
        else:
            above |= equal & counters[k]
    reaching = above | equal
    for X in range(N_BLOCKS):
        count = np.uint64(0)
        if (reaching >> np.uint64(X)) & np.uint64(1):
            for k in range(COUNTER_BITS):
                count |= ((counters[k] >> np.uint64(X)) & np.uint64(1)) << np.uint64(k)
        bounds[X] = count


@njit(nogil=True, cache=True)
def count_children(grid, layers, columns, bins, nodes, step, margin, counts):
    """Count the matches of the four parts (0, 0), (0, 1), (1, 0), (1, 1), (y, x), `step` cells wide, of squares.

    grid : (layers, n, n) uint8; nodes : (m, 3) int64, heading by its number here and first cell (y, x) in the region;
    counts : (m, 4) uint16, out; the others as of `bound_blocks`.
    """
    width = grid.shape[2]
    flat = grid.reshape(-1)
    up, right = step * width, step
    for m in range(nodes.shape[0]):
        h = nodes[m, 0]
        start = (nodes[m, 1] + margin) * width + nodes[m, 2] + margin
        n0, n1, n2, n3 = 0, 0, 0, 0
        for i in range(layers.shape[0]):
            place = (layers[i] * width + columns[h, i, 1]) * width + columns[h, i, 0] + start
            bit = 1 << bins[h, i]
            n0 += (flat[place] & bit) != 0
            n1 += (flat[place + right] & bit) != 0
            n2 += (flat[place + up] & bit) != 0
            n3 += (flat[place + up + right] & bit) != 0
        counts[m, 0], counts[m, 1], counts[m, 2], counts[m, 3] = n0, n1, n2, n3
