# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: the moments of single cells, each by itself; to the last bit those of a whole window.

At one cell every scan point falls in one voxel, which the map has or has not; mostly it has not. Points are taken
CAPACITY at a time through four short loops, almost without branches, each over what the one before kept:

1. `_find` keeps the points in patches (16 x 16 voxels of a layer) that hold anything: `held` of the tile's `Occupancy`
   has one bit for each layer, 64 layers a word.
2. `_keep_matches` keeps those whose own voxel is there: `words` has one bit for each voxel, four words a patch.
3. `_fetch` gathers the normals, and how often voxels count.
4. `_add` adds what the matches add.

Words come with the number of all bits before them (`numbers`, `firsts`): that, and the bits set before its own, is the
number of a patch or voxel in the arrays of the tile.

Numbers that say where something is are packed into uint64, for then one addition or one mask does. A voxel (x, y) is
x + y * 2^32: adding an offset moves both, and bits outside the tile show that a point left it. A bit of a word is word,
bit, see BIT_BITS. The arrays of the tiles are those of `tile.voxel_table`.
"""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import PATCH_VOXELS
from maxcon.map.lookup_kernels import HELD, N_HELD, n_bits
from maxcon.search.accumulator import CONTRIBUTION_STEP, ROUNDER
from maxcon.search.visit_kernels import turn_normals, turn_to_columns

# Points that are looked up at a time: intermediate results of so many fit into the L1 cache.
CAPACITY = 1024

PATCH_BITS = PATCH_VOXELS.bit_length() - 1

# A mask of x times this is a mask of x and y.
BOTH = 2**32 + 1

# Bits below the number of the word.
BIT_BITS = 6


@njit(nogil=True, cache=True)
def points_at_heading(points, normals, turn, place, cell, without_normal):
    """Turn a scan: voxels (n,) uint64, x + y * 2^32, and normals (n, 4) float32 of its points.

    points, normals, turn, place, cell : as `visit_kernels.turn_to_columns` and `turn_normals` take them, of one
    heading; without_normal : weight of a match whose point has no normal. The last of the four is what is added to the
    weight of the normal: that, or 0.
    """
    columns, turned = turn_to_columns(points, turn, place, cell)[0], turn_normals(normals, turn)[0]
    n = columns.shape[1]
    voxels, weighed = np.empty(n, np.uint64), np.empty((n, 4), np.float32)
    for i in range(n):
        voxels[i] = np.uint64(np.int64(columns[0, i]) + (np.int64(columns[1, i]) << 32))
        nx, ny, nz = turned[0, i], turned[1, i], turned[2, i]
        weighed[i, 0], weighed[i, 1], weighed[i, 2] = nx, ny, nz
        weighed[i, 3] = without_normal if (nx == 0.0) & (ny == 0.0) & (nz == 0.0) else 0.0
    return voxels, weighed


@njit(nogil=True, cache=True)
def _tile_and_shift(voxel, offset, edge_bits, grid, corner):
    """Row in the table of the tile in which a voxel falls at an offset, and the offset less the tile's corner."""
    x = np.int64(np.int32(voxel & np.uint64(2**32 - 1)))
    y = ((np.int64(voxel) - x) >> 32) + offset[1]
    x += offset[0]
    slot_x, slot_y = (x >> edge_bits) - corner[0], (y >> edge_bits) - corner[1]
    tile = np.uint64(0)
    if 0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]:
        tile = np.uint64(grid[slot_y, slot_x])
    x_shift = offset[0] - ((x >> edge_bits) << edge_bits)
    y_shift = offset[1] - ((y >> edge_bits) << edge_bits)
    return tile, np.uint64(x_shift + (y_shift << 32))


@njit(nogil=True, cache=True)
def _find(first, end, offset, voxels, ranks, layers, edge_bits, table, found, matched):
    """Find those of some points that fall in a patch that holds voxels, at an offset. Returns how many.

    found : (c,) int32, their numbers; matched : (c,) uint64, bits of the voxels they fall in. Both out.
    """
    rows, grid, corner, _, held, numbers = table[:6]
    n, row, shift = np.uint64(0), np.uint64(0), np.uint64(2**63)  # that of no tile
    # Bits that are set in no voxel of a tile, and those of its place (py, px) among the patches, once shifted there.
    outside = ~np.uint64(((1 << edge_bits) - 1) * BOTH)
    row_bits = np.uint64(edge_bits - PATCH_BITS)
    in_row = (np.uint64(1) << row_bits) - np.uint64(1)
    to_row, in_rows = np.uint64(32 + PATCH_BITS) - row_bits, in_row << row_bits
    n_held, first_held = np.uint64(rows[0, N_HELD]), np.uint64(rows[0, HELD])
    for number in range(first, end):
        j = np.uint64(number)
        voxel = voxels[j] + shift
        if voxel & outside:  # points in one tile follow each other
            row, shift = _tile_and_shift(voxels[j], offset, edge_bits, grid, corner)
            voxel = voxels[j] + shift
            n_held, first_held = np.uint64(rows[row, N_HELD]), np.uint64(rows[row, HELD])
        # From here on without a branch: which points match is as good as random.
        place = (voxel >> to_row) & in_rows
        place |= (voxel >> np.uint64(PATCH_BITS)) & in_row
        layer = np.uint64(layers[row, np.uint64(ranks[j])])
        place = first_held + place * n_held + (layer >> np.uint64(6))
        patches, in_patches = held[place], layer & np.uint64(63)
        before = patches & ((np.uint64(1) << in_patches) - np.uint64(1))
        patch = np.uint64(numbers[place]) + n_bits(before)
        word = np.uint64(4) * patch + ((voxel >> np.uint64(34)) & np.uint64(3))
        bit = (voxel >> np.uint64(32 - PATCH_BITS)) | (voxel & np.uint64(PATCH_VOXELS - 1))
        found[n] = number
        matched[n] = (word << np.uint64(BIT_BITS)) | (bit & np.uint64(2**BIT_BITS - 1))
        n += (patches >> in_patches) & np.uint64(1)
    return np.int64(n)


@njit(nogil=True, cache=True)
def _keep_matches(n, table, found, matched):
    """Keep those of n points whose own voxel is in the map. Returns how many.

    found : (c,) int32, in and out; matched : (c,) uint64, in and out, instead of bits then the voxels they are of.
    """
    words, firsts, n_kept = table[6], table[7], np.uint64(0)
    for number in range(n):
        m = np.uint64(number)
        bit, word = matched[m] & np.uint64(2**BIT_BITS - 1), matched[m] >> np.uint64(BIT_BITS)
        voxels = words[word]
        before = voxels & ((np.uint64(1) << bit) - np.uint64(1))
        found[n_kept], matched[n_kept] = found[m], np.uint64(firsts[word]) + n_bits(before)
        n_kept += (voxels >> bit) & np.uint64(1)
    return np.int64(n_kept)


@njit(nogil=True, cache=True)
def _fetch(n, found, matched, normals, table, fetched, times):
    """Fetch what belongs to n points that match.

    fetched : (7, c) float32, out: normal of the point, normal of its voxel, weight added where the point has none;
    times : (c,) int32, out: how often each voxel counts; empty where once.
    """
    voxel_normals, counts = table[8], table[9]
    for number in range(n):
        m = np.uint64(number)
        j, k = np.uint64(found[m]), matched[m]
        fetched[np.uint64(6), m] = normals[j, np.uint64(3)]
        for axis in range(3):
            at = np.uint64(axis)
            fetched[at, m] = normals[j, at]
            fetched[np.uint64(3) + at, m] = voxel_normals[k, at]
        if times.shape[0] > 0:
            times[m] = counts[k]


@njit(nogil=True, cache=True)
def _add(n, fetched, times, back, moments):
    """Add n matches to the moments of a cell, (4,).

    With the arithmetic of `window_kernels._weigh`; as whole numbers of steps they are added in any order.
    """
    n_all, xx, xy, yy = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for m in range(n):
        nx, ny, nz = fetched[3, m], fetched[4, m], fetched[5, m]
        cosine = fetched[0, m] * nx + fetched[1, m] * ny + fetched[2, m] * nz
        weight = np.float64(max(cosine, back * cosine) + fetched[6, m])
        if times.shape[0] > 0:
            weight *= np.float64(times[m])
            n_all += times[m]
        xx += np.int64((weight * np.float64(nx * nx) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
        xy += np.int64((weight * np.float64(nx * ny) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
        yy += np.int64((weight * np.float64(ny * ny) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
    moments[0] += n_all if times.shape[0] > 0 else n
    moments[1] += xx * CONTRIBUTION_STEP
    moments[2] += xy * CONTRIBUTION_STEP
    moments[3] += yy * CONTRIBUTION_STEP


@njit(nogil=True, cache=True)
def moments_of_cells(offsets, voxels, normals, ranks, layers, edge_bits, table, is_once, is_signed, moments):
    """Add the matches of scan points, turned by one heading, to the moments of some of its cells.

    offsets : (c, 2) int64, (x, y) of each cell, voxels; voxels, normals : as `points_at_heading` made them; ranks :
    (n,) int32, number of each point's layer among the scan's.
    layers : (t + 1, l) int32, number of each of these layers in each tile of the table, of a layer that is not there
    one too high; edge_bits : a tile has 2^edge_bits voxels along an edge; table : of the tiles, see `tile.voxel_table`.
    is_once : whether a voxel counts once; is_signed : whether the map's normals have a side.
    moments : (c, 4) float64, in and out.
    """
    back = np.float32(0.0 if is_signed else -1.0)
    found, matched = np.empty(CAPACITY, np.int32), np.empty(CAPACITY, np.uint64)
    fetched, times = np.empty((7, CAPACITY), np.float32), np.empty(0 if is_once else CAPACITY, np.int32)
    for first in range(0, voxels.shape[0], CAPACITY):
        end = min(first + CAPACITY, voxels.shape[0])
        for c in range(offsets.shape[0]):
            offset = (offsets[c, 0], offsets[c, 1])
            n = _find(first, end, offset, voxels, ranks, layers, edge_bits, table, found, matched)
            n = _keep_matches(n, table, found, matched)
            _fetch(n, found, matched, normals, table, fetched, times)
            _add(n, fetched, times, back, moments[c])
