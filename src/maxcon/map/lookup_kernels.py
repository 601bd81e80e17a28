"""Compiled look-ups of single voxels in several tiles; `table` is a `VoxelTable`."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import MEAN_STEPS, PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS

TILE_BITS, PATCH_BITS = TILE_VOXELS.bit_length() - 1, PATCH_VOXELS.bit_length() - 1
BETWEEN_BITS = TILE_BITS - PATCH_BITS
INSIDE_TILE, INSIDE_PATCH = TILE_VOXELS - 1, PATCH_VOXELS - 1
MEAN_STEP = 1.0 / MEAN_STEPS

# Columns of the rows of a table.
FIRST_LAYER, N_LAYERS, LAYERS, N_HELD, HELD = range(5)

ONE, TWO, FOUR = np.uint64(1), np.uint64(2), np.uint64(4)
PAIRS, QUARTETS, BYTES = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333), np.uint64(0x0F0F0F0F0F0F0F0F)
ONES, TOP_BYTE = np.uint64(0x0101010101010101), np.uint64(56)


@njit(nogil=True, cache=True, inline="always")
def n_bits(word):
    """How many bits of a uint64 are set; LLVM makes one instruction of it."""
    word = word - ((word >> ONE) & PAIRS)
    word = (word & QUARTETS) + ((word >> TWO) & QUARTETS)
    return (((word + (word >> FOUR)) & BYTES) * ONES) >> TOP_BYTE


@njit(nogil=True, cache=True, inline="always")
def find_patch(x, y, z, table):
    """Number of the patch that holds voxel (x, y, z), among those of all tiles; -1 where there is none."""
    rows, grid, corner, layers, held, numbers = table[:6]
    slot_x, slot_y = (x >> TILE_BITS) - corner[0], (y >> TILE_BITS) - corner[1]
    if not (0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]):
        return -1
    row = grid[slot_y, slot_x]
    layer = z - rows[row, FIRST_LAYER]
    if not 0 <= layer < rows[row, N_LAYERS]:
        return -1
    number = layers[rows[row, LAYERS] + layer]
    if number < 0:
        return -1
    place = ((y & INSIDE_TILE) >> PATCH_BITS) * TILE_PATCHES + ((x & INSIDE_TILE) >> PATCH_BITS)
    place = rows[row, HELD] + place * rows[row, N_HELD] + (number >> 6)
    bit, patches = np.uint64(number & 63), held[place]
    if not (patches >> bit) & ONE:
        return -1
    return numbers[place] + np.int64(n_bits(patches & ((ONE << bit) - ONE)))


@njit(nogil=True, cache=True, inline="always")
def find_in_patch(x, y, patch, table):
    """Number of voxel (x, y) of a patch, as of `find_patch`, among those of all tiles; -1 if it is not held."""
    words, firsts = table[6], table[7]
    word = 4 * patch + ((y & INSIDE_PATCH) >> 2)
    bit = np.uint64(((y & 3) << PATCH_BITS) | (x & INSIDE_PATCH))
    voxels = words[word]
    if not (voxels >> bit) & ONE:
        return -1
    return firsts[word] + np.int64(n_bits(voxels & ((ONE << bit) - ONE)))


@njit(nogil=True, cache=True, inline="always")
def is_near_voxels(place, reaches, table):
    """Whether voxels that lie within some reaches of a place may be held at all: False is certain, True is not.

    place : (x, y, z) in voxels; reaches : along x, y and z, in voxels. Whole patches are looked at, layers below each
    other at once.
    """
    rows, grid, corner, layers, held, _ = table[:6]
    x_low, x_high = np.int64(np.floor(place[0] - reaches[0])), np.int64(np.floor(place[0] + reaches[0]))
    y_low, y_high = np.int64(np.floor(place[1] - reaches[1])), np.int64(np.floor(place[1] + reaches[1]))
    z_low, z_high = np.int64(np.floor(place[2] - reaches[2])), np.int64(np.floor(place[2] + reaches[2]))
    for y in range(y_low >> PATCH_BITS, (y_high >> PATCH_BITS) + 1):
        for x in range(x_low >> PATCH_BITS, (x_high >> PATCH_BITS) + 1):
            slot_x, slot_y = (x >> BETWEEN_BITS) - corner[0], (y >> BETWEEN_BITS) - corner[1]
            if not (0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]):
                continue
            row = grid[slot_y, slot_x]
            first = rows[row, FIRST_LAYER]
            end = min(z_high + 1 - first, rows[row, N_LAYERS])
            column = (y & (TILE_PATCHES - 1)) * TILE_PATCHES + (x & (TILE_PATCHES - 1))
            column = rows[row, HELD] + column * rows[row, N_HELD]
            for layer in range(max(z_low - first, 0), end):
                number = layers[rows[row, LAYERS] + layer]
                if number >= 0 and (held[column + (number >> 6)] >> np.uint64(number & 63)) & ONE:
                    return True
    return False


@njit(nogil=True, cache=True, inline="always")
def plane_of_voxel(number, x, y, z, cell, table):
    """Normal of a held voxel, (nx, ny, nz), and mean of its points, (x, y, z), m; `number` as of `find_in_patch`."""
    normals, means = table[8], table[10]
    return (
        np.float64(normals[number, 0]),
        np.float64(normals[number, 1]),
        np.float64(normals[number, 2]),
        (x + (np.float64(means[number, 0]) + 0.5) * MEAN_STEP) * cell,
        (y + (np.float64(means[number, 1]) + 0.5) * MEAN_STEP) * cell,
        (z + (np.float64(means[number, 2]) + 0.5) * MEAN_STEP) * cell,
    )
