# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled look-ups of single voxels in many tiles, by the addresses of the tiles' arrays.

Addresses, since tiles come and go: an array of all tiles in reach would be a copy of 11 MB, 1.3 to 2.7 ms of processor
time where a whole epoch takes 32 to 34 ms (kitti360-suburb, default method). How long an address is valid: see
`tile.Addresses`.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import MEAN_STEPS, PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS

TILE_BITS, PATCH_BITS = TILE_VOXELS.bit_length() - 1, PATCH_VOXELS.bit_length() - 1
BETWEEN_BITS = TILE_BITS - PATCH_BITS
INSIDE_TILE, INSIDE_PATCH = TILE_VOXELS - 1, PATCH_VOXELS - 1
MEAN_STEP = 1.0 / MEAN_STEPS

# Columns of a row of `VoxelLookup`.
FIRST_LAYER, N_LAYERS, LAYERS, N_HELD, HELD, NUMBERS, WORDS, FIRSTS, NORMALS, COUNTS, MEANS = range(11)


def _reading(item, llvm_item):
    """Make the function that reads item `number` of an array of which only the address is known."""

    @intrinsic
    def read(typing_context, address, number):
        def generate(context, builder, signature, arguments):
            start = builder.inttoptr(arguments[0], llvm_item.as_pointer())
            return builder.load(builder.gep(start, [arguments[1]]))

        return item(types.uint64, types.uint64), generate

    return read


int32_at = _reading(types.int32, ir.IntType(32))
uint8_at = _reading(types.uint8, ir.IntType(8))
uint64_at = _reading(types.uint64, ir.IntType(64))
float32_at = _reading(types.float32, ir.FloatType())


@intrinsic
def fetch(typing_context, address):
    """Prefetch the item at an address into the cache."""

    def generate(context, builder, signature, arguments):
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        place = builder.inttoptr(arguments[0], pointer)
        builder.call(function, [place, number(0), number(3), number(1)])  # to read, often, data
        return context.get_dummy_value()

    return types.void(types.uint64), generate


@intrinsic
def n_bits(typing_context, word):
    """How many bits of a uint64 are set."""

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit(nogil=True, cache=True)
def find_patch(x, y, z, rows, grid, corner):
    """Row of the tile that holds the patch of voxel (x, y, z), and the patch's number in it; row 0 where there is none.

    rows, grid, corner : of a `VoxelLookup`.
    """
    nowhere = np.uint64(0), np.uint64(0)
    slot_x, slot_y = (x >> TILE_BITS) - corner[0], (y >> TILE_BITS) - corner[1]
    if not (0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]):
        return nowhere
    row = np.uint64(grid[slot_y, slot_x])
    layer = z - np.int64(rows[row, FIRST_LAYER])
    if not 0 <= layer < np.int64(rows[row, N_LAYERS]):
        return nowhere
    number = np.int64(int32_at(rows[row, LAYERS], np.uint64(layer)))
    if number < 0:
        return nowhere
    place = np.uint64(((y & INSIDE_TILE) >> PATCH_BITS) * TILE_PATCHES + ((x & INSIDE_TILE) >> PATCH_BITS))
    place = place * rows[row, N_HELD] + np.uint64(number >> 6)
    bit, patches = np.uint64(number & 63), uint64_at(rows[row, HELD], place)
    if not (patches >> bit) & np.uint64(1):
        return nowhere
    before = patches & ((np.uint64(1) << bit) - np.uint64(1))
    return row, np.uint64(int32_at(rows[row, NUMBERS], place)) + n_bits(before)


@njit(nogil=True, cache=True)
def find_in_patch(x, y, row, patch, rows):
    """Whether a patch holds voxel (x, y) of its layer, and the voxel's number in the tile.

    row, patch : as `find_patch` gave them; rows : of a `VoxelLookup`.
    """
    word = np.uint64(4) * patch + np.uint64((y & INSIDE_PATCH) >> 2)
    bit = np.uint64(((y & 3) << PATCH_BITS) | (x & INSIDE_PATCH))
    voxels = uint64_at(rows[row, WORDS], word)
    if not (voxels >> bit) & np.uint64(1):
        return False, np.uint64(0)
    before = voxels & ((np.uint64(1) << bit) - np.uint64(1))
    return True, np.uint64(int32_at(rows[row, FIRSTS], word)) + n_bits(before)


@njit(nogil=True, cache=True)
def is_near_voxels(place, reaches, rows, grid, corner):
    """Whether voxels that lie within some reaches of a place may be held at all: False is certain, True is not.

    place : (x, y, z) in voxels; reaches : along x, y and z, in voxels; rows, grid, corner : of a `VoxelLookup`. Whole
    patches are looked at, layers below each other at once.
    """
    x_low, x_high = np.int64(np.floor(place[0] - reaches[0])), np.int64(np.floor(place[0] + reaches[0]))
    y_low, y_high = np.int64(np.floor(place[1] - reaches[1])), np.int64(np.floor(place[1] + reaches[1]))
    z_low, z_high = np.int64(np.floor(place[2] - reaches[2])), np.int64(np.floor(place[2] + reaches[2]))
    for y in range(y_low >> PATCH_BITS, (y_high >> PATCH_BITS) + 1):
        for x in range(x_low >> PATCH_BITS, (x_high >> PATCH_BITS) + 1):
            slot_x, slot_y = (x >> BETWEEN_BITS) - corner[0], (y >> BETWEEN_BITS) - corner[1]
            if not (0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]):
                continue
            row = np.uint64(grid[slot_y, slot_x])
            first = np.int64(rows[row, FIRST_LAYER])
            end = min(z_high + 1 - first, np.int64(rows[row, N_LAYERS]))
            patches = np.uint64((y & (TILE_PATCHES - 1)) * TILE_PATCHES + (x & (TILE_PATCHES - 1)))
            patches *= rows[row, N_HELD]
            for layer in range(max(z_low - first, np.int64(0)), end):
                number = np.int64(int32_at(rows[row, LAYERS], np.uint64(layer)))
                if number < 0:
                    continue
                held = uint64_at(rows[row, HELD], patches + np.uint64(number >> 6))
                if (held >> np.uint64(number & 63)) & np.uint64(1):
                    return True
    return False


@njit(nogil=True, cache=True)
def plane_of_voxel(row, number, x, y, z, cell, rows):
    """Normal of a held voxel, (nx, ny, nz), and mean of its points, (x, y, z), m; `number` as of `find_in_patch`."""
    normals, means, at = rows[row, NORMALS], rows[row, MEANS], np.uint64(3) * number
    one, two = np.uint64(1), np.uint64(2)
    return (
        np.float64(float32_at(normals, at)),
        np.float64(float32_at(normals, at + one)),
        np.float64(float32_at(normals, at + two)),
        (x + (np.float64(uint8_at(means, at)) + 0.5) * MEAN_STEP) * cell,
        (y + (np.float64(uint8_at(means, at + one)) + 0.5) * MEAN_STEP) * cell,
        (z + (np.float64(uint8_at(means, at + two)) + 0.5) * MEAN_STEP) * cell,
    )
