# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the accumulator cannot be faster than: its additions alone.

`addresses_of_matches` writes down where in the sums each match of a search is added, in the order in which the
search adds them: visit by visit, at each heading, for each scan point, for each voxel inside its window. `add_all`
then adds four float64 at each of these addresses, in sums of the same size and layout: one address is read, one
cell is read, changed and written for each match. Nothing is looked up, weighed or rounded. The search itself adds
less in one case: points without a normal only add a count, once for all in one voxel.
"""

import inspect

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from maxcon.search.visit_kernels import RIM
from maxcon.search.window_kernels import accumulate_tile

SIGNATURE = inspect.signature(accumulate_tile.py_func)


def addresses_of_matches(calls, n_matches):
    """Number of the first float64 of each match's cell, (n_matches,) int32, from all calls of accumulate_tile."""
    addresses = np.empty(n_matches, np.int32)
    n = 0
    for call in calls:
        given = SIGNATURE.bind(*call).arguments
        corner, voxel_columns, *_ = given["tile"]
        n = write_addresses(
            given["stops"], given["runs"], given["columns"], corner, voxel_columns, given["window"], given["stride"],
            given["sums"].shape[1], addresses, n,
        )  # fmt: skip
    assert n == n_matches, (n, n_matches)
    return addresses


@njit(nogil=True)
def write_addresses(stops, runs, columns, corner, voxel_columns, window, stride, size, addresses, n):
    nx, ny = window[1] - window[0] + 1, window[3] - window[2] + 1
    for at in range(stops.shape[0]):
        first, _, end, since, until = stops[at, :5]
        for heading in range(since, until):
            for i in range(first, end):
                x_first = columns[heading, 0, i] + window[0] - corner[0]
                y_first = columns[heading, 1, i] + window[2] - corner[1]
                for run in range(stops[at, 9], stops[at, 10]):
                    for k in range(runs[run, 0], runs[run, 1]):
                        x, y = voxel_columns[k, 0] - x_first, voxel_columns[k, 1] - y_first
                        if x >= 0 and x < nx and y >= 0 and y < ny:
                            addresses[n] = heading * size + 4 * ((y + RIM) * stride + x + RIM)
                            n += 1
    return n


@intrinsic
def _add_four(typing_context, sums, cell):
    """sums[cell : cell + 4] += 1, as one vector operation."""
    signature = types.void(sums, types.int64)

    def generate(context, builder, signature, arguments):
        four_doubles = ir.VectorType(ir.DoubleType(), 4)
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        pointer = builder.bitcast(builder.gep(data, [arguments[1]]), four_doubles.as_pointer())
        total = builder.fadd(builder.load(pointer, align=8), ir.Constant(four_doubles, [1.0] * 4))
        builder.store(total, pointer, align=8)
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True)
def add_all(addresses, sums):
    """Add 1 to the four float64 at each address of the flat sums."""
    for i in range(addresses.shape[0]):
        _add_four(sums, np.int64(addresses[i]))
