# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: adding one match to the four sums of a cell, in one vector operation."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["ROUNDER", "add_alike", "add_once", "add_times"]

# Adding and subtracting 1.5 * 2^52 * step rounds a float64 to whole multiples of the step, ties to even,
# as numpy.rint does. The step is search.matching.CONTRIBUTION_STEP.
ROUNDER = 1.5 * 2.0**52 * 2.0**-24


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
                product = builder.insert_element(
                    product, builder.load(at(times, 4, j)), ir.Constant(index, 0)
                )
            pointer = four_at(sums, 0, cell)
            builder.store(builder.fadd(builder.load(pointer, align=8), product), pointer, align=8)
            return context.get_dummy_value()

        return signature, generate

    return add


add_once = _adding(True)
add_times = _adding(False)


@intrinsic
def add_alike(typing_context, sums, cell, rows, n_alike, j):
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
