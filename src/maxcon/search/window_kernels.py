# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: the moments of all cells of a window (D5)."""

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from maxcon._system.kernel_cache import njit
from maxcon.search.matching import ROUNDER
from maxcon.search.visit_kernels import RIM, TileVoxels

__all__ = ["accumulate_tile"]

# Voxels that are laid out at a time, a multiple of BLOCK: they fit into the L1 cache.
CAPACITY = 256

# Weights are computed in blocks of this many, so that the vectorized loop has no remainder.
BLOCK = 32


def _adding(is_once):
    """Make the one vector operation of a match; the compiler does not find it in four scalar ones.

    add(sums, cell, factors, weights, times, j): sums[cell : cell + 4] += (1 or times[j], rounded products of
    weights[j] and factors[4 j + 1 : 4 j + 4]). Lane 0 of the factors is 0.
    """

    @intrinsic
    def add(typing_context, sums, cell, factors, weights, times, j):
        signature = types.void(sums, types.int64, factors, weights, times, types.int64)

        def generate(context, builder, signature, arguments):
            sums, cell, factors, weights, times, j = arguments
            four_doubles = ir.VectorType(ir.DoubleType(), 4)
            index = ir.IntType(32)
            undefined = ir.Constant(four_doubles, ir.Undefined)

            def at(array, number, position):
                data = context.make_array(signature.args[number])(context, builder, array).data
                return builder.gep(data, [position])

            def four_at(array, number, position):
                return builder.bitcast(at(array, number, position), four_doubles.as_pointer())

            factor = builder.load(four_at(factors, 2, builder.shl(j, ir.Constant(j.type, 2))), align=8)
            weight = builder.insert_element(undefined, builder.load(at(weights, 3, j)), ir.Constant(index, 0))
            weight = builder.shuffle_vector(weight, undefined, ir.Constant(ir.VectorType(index, 4), [0] * 4))
            rounder = ir.Constant(four_doubles, [ROUNDER] * 4)
            # The product of two numbers of 24 bits is exact: to fuse it with the sum changes nothing. With
            # times it is not.
            flags = ("contract",) if is_once else ()
            product = builder.fadd(builder.fmul(weight, factor, flags=flags), rounder, flags=flags)
            lane_0 = ROUNDER - 1.0 if is_once else ROUNDER
            product = builder.fsub(product, ir.Constant(four_doubles, [lane_0] + [ROUNDER] * 3))
            if not is_once:
                product = builder.insert_element(product, builder.load(at(times, 4, j)), ir.Constant(index, 0))
            pointer = four_at(sums, 0, cell)
            builder.store(builder.fadd(builder.load(pointer, align=8), product), pointer, align=8)
            return context.get_dummy_value()

        return signature, generate

    return add


_add_once = _adding(True)
_add_times = _adding(False)


@intrinsic
def _add_alike(typing_context, sums, cell, rows, n_alike, j):
    """sums[cell : cell + 4] += n_alike * rows[4 j : 4 j + 4], in one vector operation."""
    signature = types.void(sums, types.int64, rows, types.float64, types.int64)

    def generate(context, builder, signature, arguments):
        sums, cell, rows, n_alike, j = arguments
        four_doubles, index = ir.VectorType(ir.DoubleType(), 4), ir.IntType(32)
        undefined = ir.Constant(four_doubles, ir.Undefined)

        def four_at(array, number, position):
            data = context.make_array(signature.args[number])(context, builder, array).data
            return builder.bitcast(builder.gep(data, [position]), four_doubles.as_pointer())

        row = builder.load(four_at(rows, 2, builder.shl(j, ir.Constant(j.type, 2))), align=8)
        times = builder.insert_element(undefined, n_alike, ir.Constant(index, 0))
        times = builder.shuffle_vector(times, undefined, ir.Constant(ir.VectorType(index, 4), [0] * 4))
        pointer = four_at(sums, 0, cell)
        # Both are multiples of a step that float64 holds exactly: to fuse them changes nothing.
        added = builder.fmul(times, row, flags=("contract",))
        total = builder.fadd(builder.load(pointer, align=8), added, flags=("contract",))
        builder.store(total, pointer, align=8)
        return context.get_dummy_value()

    return signature, generate


class LaidOut(NamedTuple):
    """Voxels laid out in arrays to be matched with scan points, at most c, and room for intermediate results.

    normals : (3, c) float32; factors : (4 c,) float64, 0, nx nx, nx ny, ny ny; cells : (c,) int32, where in the sums a
    scan point in voxel (0, 0) meets them; times : (c,) float64, their counts, or empty where a voxel counts once.
    weights : (c,) float64, of the matches of one point; rows : (4 c,) float64, what points without a normal add.
    """

    normals: Any
    factors: Any
    cells: Any
    times: Any
    weights: Any
    rows: Any


class TurnedPoints(NamedTuple):
    """The points of a scan at some headings: columns, (headings, 2, n) int32, and normals, (headings, 3, n) float32."""

    columns: Any
    normals: Any


@njit(nogil=True, cache=True)
def _select(columns, first, last, low, span, selected, n_selected):
    """Append to `selected` those voxels of a run that lie in a rectangle; without a branch. Returns how many."""
    for k in range(first, last):
        selected[n_selected] = k
        x = np.uint32(np.int32(columns[np.uint64(k), 0]) - low[0])
        y = np.uint32(np.int32(columns[np.uint64(k), 1]) - low[1])
        n_selected += np.uint64((x <= span[0]) & (y <= span[1]))
    return n_selected


@njit(nogil=True, cache=True)
def _lay_out_voxels(selected, voxels, stride, out):
    """Lay out the selected voxels, those with a normal first, then the others. Returns how many have one."""
    has_counts = voxels.counts.shape[0] > 0
    one, n_normals, n_left = np.uint64(1), np.uint64(0), np.uint64(selected.shape[0])
    for number in selected:
        k = np.uint64(number)
        nx, ny, nz = voxels.normals[k, 0], voxels.normals[k, 1], voxels.normals[k, 2]
        has_normal = np.uint64((nx != 0.0) | (ny != 0.0) | (nz != 0.0))
        n_left -= one - has_normal
        to = n_normals if has_normal == one else n_left
        n_normals += has_normal
        out.normals[0, to], out.normals[1, to], out.normals[2, to] = nx, ny, nz
        at = np.uint64(4) * to
        out.factors[at + np.uint64(1)] = nx * nx
        out.factors[at + np.uint64(2)] = nx * ny
        out.factors[at + np.uint64(3)] = ny * ny
        out.cells[to] = np.int32(4) * (np.int32(voxels.columns[k, 1]) * stride + np.int32(voxels.columns[k, 0]))
        if has_counts:
            out.times[to] = voxels.counts[k]
    return np.int64(n_normals)


@njit(nogil=True, cache=True)
def _lay_out_alike(n_voxels, without_normal, out):
    """Lay out what a match of weight `without_normal` adds at each voxel."""
    has_counts = out.times.shape[0] > 0
    for j in range(n_voxels):
        at, n_points = np.uint64(4 * j), 1.0
        if has_counts:
            n_points = out.times[j]
        weight, out.rows[at] = without_normal * n_points, n_points
        for channel in range(np.uint64(1), np.uint64(4)):
            out.rows[at + channel] = weight * out.factors[at + channel] + ROUNDER - ROUNDER


@njit(nogil=True, cache=True, forceinline=True)
def _weigh(normals, n_normals, turned, i, back, weights):
    """Weights of the matches of a scan point: w = max(c, 0) where normals have a side, |c| = max(c, -c) where not.

    back : 0 where normals have a side, otherwise -1.
    """
    nx, ny, nz = turned[0, i], turned[1, i], turned[2, i]
    for j in range((n_normals + BLOCK - 1) // BLOCK * BLOCK):
        cosine = nx * normals[0, j] + ny * normals[1, j] + nz * normals[2, j]
        weights[j] = max(cosine, back * cosine)


@njit(nogil=True, cache=True)
def _accumulate(headings, points, turned, origin, stride, back, n_normals, n_voxels, laid_out, sums):
    """Add the matches of scan points with the laid out voxels to the sums of some headings.

    headings, points : first and end; origin : where in the sums a point in voxel (0, 0) meets a voxel (0, 0).
    """
    columns, cells, weights = turned.columns, laid_out.cells, laid_out.weights
    for heading in range(headings[0], headings[1]):
        cell_sums = sums[heading]
        for i in range(points[0], points[1]):
            base = 4 * ((origin[1] - columns[heading, 1, i]) * stride + origin[0] - columns[heading, 0, i])
            _weigh(laid_out.normals, n_normals, turned.normals[heading], i, back, weights)
            for j in range(n_normals):
                _add_once(cell_sums, base + cells[j], laid_out.factors, weights, laid_out.times, j)
            for j in range(n_normals, n_voxels):
                cell_sums[np.uint64(base + cells[j])] += 1.0


@njit(nogil=True, cache=True)
def _accumulate_times(headings, points, turned, origin, stride, back, n_normals, n_voxels, laid_out, sums):
    """As `_accumulate`, each voxel as often as it has points."""
    columns, cells, weights, times = turned.columns, laid_out.cells, laid_out.weights, laid_out.times
    for heading in range(headings[0], headings[1]):
        cell_sums = sums[heading]
        for i in range(points[0], points[1]):
            base = 4 * ((origin[1] - columns[heading, 1, i]) * stride + origin[0] - columns[heading, 0, i])
            _weigh(laid_out.normals, n_normals, turned.normals[heading], i, back, weights)
            for j in range(n_normals):
                weights[j] *= times[j]
            for j in range(n_normals):
                _add_times(cell_sums, base + cells[j], laid_out.factors, weights, times, j)
            for j in range(n_normals, n_voxels):
                cell_sums[np.uint64(base + cells[j])] += times[j]


@njit(nogil=True, cache=True)
def _accumulate_alike(headings, points, columns, origin, stride, n_voxels, laid_out, sums):
    """Add the matches of scan points without a normal: those in one voxel add the same, and are added at once.

    headings, points : first and end; points in one voxel follow each other.
    """
    cells, rows = laid_out.cells, laid_out.rows
    for heading in range(headings[0], headings[1]):
        cell_sums, i = sums[heading], points[0]
        while i < points[1]:
            x, y, n_alike = columns[heading, 0, i], columns[heading, 1, i], 0.0
            while i < points[1] and columns[heading, 0, i] == x and columns[heading, 1, i] == y:
                n_alike += 1.0
                i += 1
            base = 4 * ((origin[1] - y) * stride + origin[0] - x)
            for j in range(n_voxels):
                _add_alike(cell_sums, base + cells[j], rows, n_alike, j)


@njit(nogil=True, cache=True)
def _match(selected, headings, points, turned, voxels, origin, stride, weighting, laid_out, sums):
    """Add the matches of the scan points of a stop with the selected voxels, at all its headings."""
    n_voxels, (without_normal, back) = selected.shape[0], weighting
    first, middle, end = points
    n_normals = _lay_out_voxels(selected, voxels, stride, laid_out)
    some = (first, middle)
    if laid_out.times.shape[0] == 0:
        _accumulate(headings, some, turned, origin, stride, back, n_normals, n_voxels, laid_out, sums)
    else:
        _accumulate_times(headings, some, turned, origin, stride, back, n_normals, n_voxels, laid_out, sums)
    if middle < end:
        _lay_out_alike(n_voxels, without_normal, laid_out)
        _accumulate_alike(headings, (middle, end), turned.columns, origin, stride, n_voxels, laid_out, sums)


@njit(nogil=True, cache=True)
def accumulate_tile(stops, runs, tile, columns, normals, window, stride, without_normal, is_signed, sums):
    """Add all matches of some scan points with one tile to the sums of some headings.

    stops, runs : see `stops_in_tile`; tile : fields of `TileVoxels`; columns : (headings, 2, n) int32, voxels of the
    points; normals : (headings, 3, n) float32, theirs.
    window : (x first, x last, y first, y last) offset; stride : cells from one row of the sums to the next;
    without_normal : weight of a match whose scan point has no normal; sums : (headings, 4 rows stride) float64, with a
    rim of RIM cells where voxels fall that only other points of a visit meet.
    """
    voxels, stride = TileVoxels(*tile), np.int32(stride)
    origin = (RIM + voxels.corner[0] - window[0], RIM + voxels.corner[1] - window[2])
    weighting = (np.float64(without_normal), np.float32(0.0 if is_signed else -1.0))
    turned, selected = TurnedPoints(columns, normals), np.empty(CAPACITY, np.int64)
    laid_out = LaidOut(
        np.zeros((3, CAPACITY), np.float32), np.zeros(4 * CAPACITY), np.empty(CAPACITY, np.int32),
        np.empty(CAPACITY if voxels.counts.shape[0] > 0 else 0), np.empty(CAPACITY), np.empty(4 * CAPACITY),
    )  # fmt: skip
    for at in range(stops.shape[0]):
        first, middle, end, since, until, x_first, x_last, y_first, y_last, run, end_run = stops[at]
        points, headings = (first, middle, end), (since, until)
        low, span = (x_first, y_first), (np.uint32(x_last - x_first), np.uint32(y_last - y_first))
        n_selected, k, end_k = np.uint64(0), runs[run, 0], runs[run, 1]
        while run < end_run:
            to = min(end_k, k + CAPACITY - np.int64(n_selected))
            n_selected = _select(voxels.columns, k, to, low, span, selected, n_selected)
            k = to
            if k == end_k:
                run += 1
                if run < end_run:
                    k, end_k = runs[run, 0], runs[run, 1]
            if n_selected == CAPACITY or (run == end_run and n_selected > 0):
                _match(
                    selected[:n_selected], headings, points, turned, voxels, origin, stride, weighting, laid_out, sums
                )  # fmt: skip
                n_selected = np.uint64(0)
