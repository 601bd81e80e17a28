# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single voxels of many tiles, looked up by the addresses of their arrays, compiled.

A scan meets tens of tiles: to hand over their arrays one by one took longer than to look up all points in them. What
lies at an address lives only as long as the object that gave it: see `tile.Addresses`, and who keeps that.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from maxcon.point_map.tile import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS

__all__ = ["find_voxel", "float32_at", "int32_at", "n_bits", "uint8_at", "uint64_at"]

TILE_BITS, PATCH_BITS = TILE_VOXELS.bit_length() - 1, PATCH_VOXELS.bit_length() - 1
INSIDE_TILE, INSIDE_PATCH = TILE_VOXELS - 1, PATCH_VOXELS - 1

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
def n_bits(typing_context, word):
    """How many bits of a uint64 are set."""

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit(nogil=True, cache=True)
def find_voxel(x, y, z, rows, grid, corner):
    """Row of the tile that holds voxel (x, y, z), and the voxel's number in it; row 0 where there is none.

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
    in_x, in_y = x & INSIDE_TILE, y & INSIDE_TILE
    place = np.uint64((in_y >> PATCH_BITS) * TILE_PATCHES + (in_x >> PATCH_BITS))
    place = place * rows[row, N_HELD] + np.uint64(number >> 6)
    bit, patches = np.uint64(number & 63), uint64_at(rows[row, HELD], place)
    if not (patches >> bit) & np.uint64(1):
        return nowhere
    before = patches & ((np.uint64(1) << bit) - np.uint64(1))
    patch = np.uint64(int32_at(rows[row, NUMBERS], place)) + n_bits(before)
    word = np.uint64(4) * patch + np.uint64((in_y & INSIDE_PATCH) >> 2)
    bit = np.uint64(((in_y & 3) << PATCH_BITS) | (in_x & INSIDE_PATCH))
    voxels = uint64_at(rows[row, WORDS], word)
    if not (voxels >> bit) & np.uint64(1):
        return nowhere
    before = voxels & ((np.uint64(1) << bit) - np.uint64(1))
    return row, np.uint64(int32_at(rows[row, FIRSTS], word)) + n_bits(before)
