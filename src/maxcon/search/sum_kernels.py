# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: upper limits of the sums over matches along one axis, for all cells of a window."""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from maxcon._system.kernel_cache import njit
from maxcon.search.visit_kernels import RIM, TileVoxels

__all__ = ["bases_of_points", "sum_tile"]

# Voxels that are laid out at a time: they fit into the L1 cache.
CAPACITY = 256

# Voxels whose votes are made at once.
LANES = 8


@intrinsic
def _vote(typing_context, sums, cells, rows, j, turned, places, n_turned, back):
    """Let points vote for the cells at which they meet LANES voxels, from number j on.

    For each point, sums[place + cell] of each voxel grows by what their match adds, rounded up to a whole number.

    rows : (4, CAPACITY) float32; turned : (n, 4) float32. Added is floor(max(p, back p) + rows[3] turned[3] + 2), where
    p is the sum of rows[i] turned[i] over the first three, the cosine of the normals times what the voxel adds; of the
    2 one rounds up, and one covers the errors of float32. The compiler does not find this in a loop: what belongs to
    the voxels stays in registers.
    """
    signature = types.void(sums, cells, rows, types.int64, turned, places, types.int64, types.float32)

    def generate(context, builder, signature, arguments):
        sums, cells, rows, turned, places = (
            context.make_array(signature.args[i])(context, builder, arguments[i]).data for i in (0, 1, 2, 4, 5)
        )
        j, n_turned, back = arguments[3], arguments[6], arguments[7]
        floats, index = ir.VectorType(ir.FloatType(), LANES), ir.IntType(32)
        undefined = ir.Constant(floats, ir.Undefined)
        flags = ("contract",)

        def row(number):
            position = builder.add(j, ir.Constant(j.type, number * CAPACITY))
            return builder.load(builder.bitcast(builder.gep(rows, [position]), floats.as_pointer()), align=4)

        def all_lanes(scalar):
            vector = builder.insert_element(undefined, scalar, ir.Constant(index, 0))
            return builder.shuffle_vector(vector, undefined, ir.Constant(ir.VectorType(index, LANES), [0] * LANES))

        voxels = [row(number) for number in range(4)]
        lanes = [builder.add(j, ir.Constant(j.type, lane)) for lane in range(LANES)]
        cells_here = [builder.sext(builder.load(builder.gep(cells, [lane])), ir.IntType(64)) for lane in lanes]
        back = all_lanes(back)
        with cgutils.for_range(builder, n_turned) as loop:
            first = builder.mul(loop.index, ir.Constant(j.type, 4))
            numbers = [builder.add(first, ir.Constant(j.type, i)) for i in range(4)]
            normal = [all_lanes(builder.load(builder.gep(turned, [number]))) for number in numbers]
            terms = [builder.fmul(voxels[i], normal[i], flags=flags) for i in range(4)]
            product = builder.fadd(builder.fadd(terms[0], terms[1], flags=flags), terms[2], flags=flags)
            opposite = builder.fmul(product, back)
            weight = builder.select(builder.fcmp_ordered(">", product, opposite), product, opposite)
            rounded = builder.fadd(builder.fadd(weight, terms[3], flags=flags), ir.Constant(floats, [2.0] * LANES))
            added = builder.fptosi(rounded, ir.VectorType(index, LANES))
            start = builder.gep(sums, [builder.load(builder.gep(places, [loop.index]))])
            for lane in range(LANES):
                pointer = builder.gep(start, [cells_here[lane]])
                value = builder.extract_element(added, ir.Constant(index, lane))
                if pointer.type.pointee.width > value.type.width:
                    value = builder.sext(value, pointer.type.pointee)
                builder.store(builder.add(builder.load(pointer), value), pointer)
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True, cache=True)
def bases_of_points(columns, stride, plane):
    """Where a voxel (0, 0) meets each point in the sums of each heading, less the origin; (n, headings) int64.

    columns : (headings, 2, n) int32; stride, plane : cells from one row, and from one heading, to the next.
    All headings of a point are read together.
    """
    bases = np.empty((columns.shape[2], columns.shape[0]), np.int64)
    for i in range(columns.shape[2]):
        for heading in range(columns.shape[0]):
            x, y = np.int64(columns[heading, 0, i]), np.int64(columns[heading, 1, i])
            bases[i, heading] = heading * plane - y * stride - x
    return bases


@njit(nogil=True, cache=True)
def _lay_out_facing(voxels, axis, first, end, low, span, least, scale, stride, cells, rows, n_taken):
    """Lay out those voxels of a run that lie in a rectangle and of which a match adds more than `least`; no branch.

    voxels : `TileVoxels`; axis : (x, y) float32, unit, or zeros to count; scale : units in one.
    rows : (4, c) float32, out, normal times what a match of weight one adds along the axis, and that; cells : (c,)
    int32, out. Returns how many there are.
    """
    columns, normals, counts = voxels.columns, voxels.normals, voxels.counts
    has_counts, is_count = counts.shape[0] > 0, axis[0] == 0.0 and axis[1] == 0.0
    for k in range(np.uint64(first), np.uint64(end)):
        x, y = np.int32(columns[k, 0]), np.int32(columns[k, 1])
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        along = nx * axis[0] + ny * axis[1]
        value = np.float32(1.0) if is_count else along * along
        if has_counts:
            value *= np.float32(counts[k])
        units = value * scale
        cells[n_taken] = y * stride + x
        rows[0, n_taken], rows[1, n_taken], rows[2, n_taken] = nx * units, ny * units, nz * units
        rows[3, n_taken] = units
        is_inside = (np.uint32(x - low[0]) <= span[0]) & (np.uint32(y - low[1]) <= span[1])
        n_taken += np.uint64(is_inside & (value > least))
    return n_taken


@njit(nogil=True, cache=True)
def _turn(headings, points, bases, normals, turns, origin, turned, places):
    """Lay out points at the headings of a visit. Returns how many.

    turned : (p, 4) float32, places : (p,) int64, out.
    """
    n = np.uint64(0)
    for i in range(points[0], points[1]):
        nx, ny = normals[i, 0], normals[i, 1]
        for heading in range(headings[0], headings[1]):
            cosine, sine = turns[heading, 0], turns[heading, 1]
            turned[n, 0], turned[n, 1] = nx * cosine - ny * sine, nx * sine + ny * cosine
            turned[n, 2], turned[n, 3] = normals[i, 2], normals[i, 3]
            places[n] = origin + bases[i, heading]
            n += np.uint64(1)
    return n


@njit(nogil=True, cache=True)
def _vote_all(n_taken, n_turned, turned, places, back, cells, rows, sums):
    """Let points as they are laid out vote for the cells at which they meet the voxels laid out."""
    n_padded = (n_taken + LANES - 1) // LANES * LANES
    cells[n_taken:n_padded] = cells[n_taken - 1]  # less than 2 LANES units more, once for each point and cell
    rows[:, n_taken:n_padded] = np.float32(0.0)
    for j in range(0, n_padded, LANES):
        _vote(sums, cells, rows, j, turned, places, n_turned, back)


@njit(nogil=True, cache=True)
def sum_tile(
    stops, runs, tile, bases, normals, turns, within, axis, window, stride, is_signed, least, scale, sums
):  # fmt: skip
    """Add the most that all matches of some scan points with one tile can add to the sums of their cells.

    stops, runs : see `stops_in_tile`; tile : fields of `TileVoxels`; bases : (n, headings), see `bases_of_points`;
    normals : (n, 4) float32, normal at heading 0, or zeros for none, and what is added to the weight; turns :
    (headings, 2) float32, cosine and sine; within : first and end of the headings to look at.
    axis : (x, y) float32, unit, or zeros to count; window : (x first, x last, y first, y last) offset; stride : cells
    from one row of the sums to the next; least : voxels that add no more are left out; scale : float32, units of the
    sums in one; sums : (headings * rows * stride,) int32 or int64.
    """
    voxels, stride = TileVoxels(*tile), np.int32(stride)
    origin = (RIM + voxels.corner[1] - window[2]) * np.int64(stride) + RIM + voxels.corner[0] - window[0]
    back = np.float32(0.0 if is_signed else -1.0)
    cells, rows = np.empty(CAPACITY, np.int32), np.empty((4, CAPACITY), np.float32)
    n_most = 0
    for at in range(stops.shape[0]):
        n_most = max(n_most, (stops[at, 2] - stops[at, 0]) * turns.shape[0])
    turned, places = np.empty((n_most, 4), np.float32), np.empty(n_most, np.int64)
    for at in range(stops.shape[0]):
        first, _, end, since, until, x_first, x_last, y_first, y_last, run, end_run = stops[at]
        points, headings = (first, end), (max(since, within[0]), min(until, within[1]))
        if headings[0] >= headings[1]:
            continue
        low = (np.int32(x_first), np.int32(y_first))
        span = (np.uint32(x_last - x_first), np.uint32(y_last - y_first))
        n_taken, k, end_k = np.uint64(0), runs[run, 0], runs[run, 1]
        while run < end_run:
            to = min(end_k, k + CAPACITY - np.int64(n_taken))
            n_taken = _lay_out_facing(voxels, axis, k, to, low, span, least, scale, stride, cells, rows, n_taken)
            k = to
            if k == end_k:
                run += 1
                if run < end_run:
                    k, end_k = runs[run, 0], runs[run, 1]
            if n_taken == CAPACITY or (run == end_run and n_taken > 0):
                n_turned = _turn(headings, points, bases, normals, turns, origin, turned, places)
                _vote_all(np.int64(n_taken), n_turned, turned, places, back, cells, rows, sums)
                n_taken = np.uint64(0)
