# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled inner loops of the exhaustive search. Arrays in, arrays out; shapes are checked above."""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from maxcon.point_map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS

__all__ = ["accumulate_tile", "points_of_tiles", "turn_to_voxels"]

# Adding and subtracting 1.5 * 2^52 * step rounds a float64 to whole multiples of the step, ties to even,
# as numpy.rint does. The step is search.matching.CONTRIBUTION_STEP.
ROUNDER = 1.5 * 2.0**52 * 2.0**-24

# Shifts instead of divisions: with these the search took 1.16 times as long.
TILE_BITS = TILE_VOXELS.bit_length() - 1
PATCH_BITS = PATCH_VOXELS.bit_length() - 1


@intrinsic
def _add_contribution(typing_context, sums, cell, factors, voxel, times, weighted):
    """sums[cell : cell + 4] += round((times, weighted, weighted, weighted) * factors[voxel : voxel + 4]).

    As one vector operation: the compiler does not find it in four scalar ones.
    """
    signature = types.void(sums, types.int64, factors, types.int64, types.float64, types.float64)

    def generate(context, builder, signature, arguments):
        sums, cell, factors, voxel, times, weighted = arguments
        four_floats = ir.VectorType(ir.FloatType(), 4)
        four_doubles = ir.VectorType(ir.DoubleType(), 4)
        index = ir.IntType(32)

        def at(array, array_type, position, vector_type):
            data = context.make_array(array_type)(context, builder, array).data
            return builder.bitcast(builder.gep(data, [position]), vector_type.as_pointer())

        factor_pointer = at(factors, signature.args[2], voxel, four_floats)
        factor = builder.fpext(builder.load(factor_pointer, align=4), four_doubles)
        weights = ir.Constant(four_doubles, ir.Undefined)
        for lane, value in enumerate((times, weighted, weighted, weighted)):
            weights = builder.insert_element(weights, value, ir.Constant(index, lane))
        rounder = ir.Constant(four_doubles, [ROUNDER] * 4)
        product = builder.fmul(weights, factor)
        product = builder.fsub(builder.fadd(product, rounder), rounder)
        sum_pointer = at(sums, signature.args[0], cell, four_doubles)
        total = builder.fadd(builder.load(sum_pointer, align=8), product)
        builder.store(total, sum_pointer, align=8)
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True, cache=True)
def turn_to_voxels(points, normals, cosine, sine, x, y, cell, columns, turned):
    """Turn a levelled scan by a heading about the sensor: voxel columns and normals in the map's axes.

    points, normals : (n, 3) float64; columns : (n, 2) int64, out; turned : (n, 3) float32, out.
    """
    for i in range(points.shape[0]):
        columns[i, 0] = np.int64(np.floor((points[i, 0] * cosine - points[i, 1] * sine + x) / cell))
        columns[i, 1] = np.int64(np.floor((points[i, 0] * sine + points[i, 1] * cosine + y) / cell))
        turned[i, 0] = normals[i, 0] * cosine - normals[i, 1] * sine
        turned[i, 1] = normals[i, 0] * sine + normals[i, 1] * cosine
        turned[i, 2] = normals[i, 2]


@njit(nogil=True, cache=True)
def points_of_tiles(columns, first, last, corner, shape):
    """For each tile of a grid, the points that meet it at some offset.

    columns : (n, 2) int64, (x, y) voxel of each point; it meets columns + first .. columns + last.
    corner : (x, y) key of the grid's first tile; shape : (ny, nx) tiles.
    Returns starts, (ny * nx + 1,), and points, so that tile t has points[starts[t] : starts[t + 1]].
    """
    ny, nx = shape
    starts = np.zeros(ny * nx + 1, np.int64)
    points = np.empty(0, np.int64)
    for is_filling in (False, True):
        for i in range(columns.shape[0]):
            tx_first = max(((columns[i, 0] + first) >> TILE_BITS) - corner[0], 0)
            tx_last = min(((columns[i, 0] + last) >> TILE_BITS) - corner[0], nx - 1)
            ty_first = max(((columns[i, 1] + first) >> TILE_BITS) - corner[1], 0)
            ty_last = min(((columns[i, 1] + last) >> TILE_BITS) - corner[1], ny - 1)
            for ty in range(ty_first, ty_last + 1):
                for tx in range(tx_first, tx_last + 1):
                    tile = ty * nx + tx
                    if is_filling:
                        points[starts[tile]] = i
                        starts[tile] += 1
                    else:
                        starts[tile + 1] += 1
        if is_filling:
            starts[1:] = starts[:-1].copy()
            starts[0] = 0
        else:
            starts = np.cumsum(starts)
            points = np.empty(starts[-1], np.int64)
    return starts, points


@njit(nogil=True, cache=True)
def accumulate_tile(
    points, columns, ranks, layers, normals, corner, patch_starts, voxel_columns, voxel_normals, factors, counts,
    offsets, is_signed, sums,
):  # fmt: skip
    """Add all matches of some scan points with one tile to the sums of one heading.

    points : numbers of the scan points; columns : (n, 2) int64, their voxels; ranks : (n,) int64, number of
    their height layer among the scan's; layers : its number in the tile, -1 for none; normals : (n, 3)
    float32, turned.
    corner : (x, y) voxel index of the tile; voxel_columns : (m, 2) int16; voxel_normals : (m, 3) float32;
    factors : (4 m,) float32, 1, nx nx, nx ny, ny ny; counts : (m,) int32, or empty where a voxel counts once.
    offsets : (first, number of cells) along x and along y; sums : flat (ny + 2 r, nx + 2 r, 4)
    float64 with a rim of r = PATCH_VOXELS - 1 cells, where the rest of a patch falls that the offsets cut.
    """
    first, n_cells = offsets
    rim = PATCH_VOXELS - 1
    stride = n_cells + 2 * rim
    is_once = counts.shape[0] == 0
    # w = max(c, 0) where normals have a side, |c| = max(c, -c) where not.
    back = np.float32(0.0 if is_signed else -1.0)
    for i in points:
        layer = layers[ranks[i]]
        if layer < 0:
            continue
        x_first = columns[i, 0] + first - corner[0]
        y_first = columns[i, 1] + first - corner[1]
        px_first = max(x_first >> PATCH_BITS, 0)
        px_last = min((x_first + n_cells - 1) >> PATCH_BITS, TILE_PATCHES - 1)
        py_first = max(y_first >> PATCH_BITS, 0)
        py_last = min((y_first + n_cells - 1) >> PATCH_BITS, TILE_PATCHES - 1)
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        base = (rim - y_first) * stride + rim - x_first
        for py in range(py_first, py_last + 1):
            row = (layer * TILE_PATCHES + py) * TILE_PATCHES
            run_start, run_end = patch_starts[row + px_first], patch_starts[row + px_last + 1]
            if is_once:
                for k in range(run_start, run_end):
                    cosine = nx * voxel_normals[k, 0] + ny * voxel_normals[k, 1] + nz * voxel_normals[k, 2]
                    weight = np.float64(max(cosine, back * cosine))
                    cell = voxel_columns[k, 1] * stride + voxel_columns[k, 0] + base
                    _add_contribution(sums, 4 * cell, factors, 4 * k, 1.0, weight)
            else:
                for k in range(run_start, run_end):
                    cosine = nx * voxel_normals[k, 0] + ny * voxel_normals[k, 1] + nz * voxel_normals[k, 2]
                    weight = np.float64(max(cosine, back * cosine))
                    cell = voxel_columns[k, 1] * stride + voxel_columns[k, 0] + base
                    times = np.float64(counts[k])
                    _add_contribution(sums, 4 * cell, factors, 4 * k, times, times * weight)
