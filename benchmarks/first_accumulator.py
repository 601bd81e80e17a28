# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The first version of the exhaustive search, kept to be measured against: every scan point by itself."""

from dataclasses import dataclass

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from maxcon.geometry import voxel_indices
from maxcon.point_map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS
from maxcon.search.matching import level, turn

ROUNDER = 1.5 * 2.0**52 * 2.0**-24
TILE_BITS = TILE_VOXELS.bit_length() - 1
PATCH_BITS = PATCH_VOXELS.bit_length() - 1


@dataclass(frozen=True)
class FirstVersion:
    """`occupied` with cosines, on one thread. Makes its index of the map's tiles once, as their cache did."""

    factors: dict

    @classmethod
    def of(cls, point_map):
        """Index all tiles of a map."""
        factors = {}
        for key in point_map.tile_keys:
            (tile,) = point_map.tiles_within(*((np.array(key) + 0.5) * TILE_VOXELS * point_map.cell), 1.0)
            factors[key] = np.ones((len(tile), 4), np.float32)
            factors[key][:, 1:] = tile.normals[:, [0, 0, 1]] * tile.normals[:, [0, 1, 1]]
        return cls(factors)

    def __call__(self, scan, point_map, prior, space):
        """Moments of all cells, (headings, ny, nx, 4)."""
        levelled, cell = level(scan, prior), point_map.cell
        scan_layers = voxel_indices(levelled.points, cell)[:, 2]
        order = reading_order(levelled.points, scan_layers, 64 * cell)
        points, normals = levelled.points[order], levelled.normals[order]
        scan_layers, ranks = np.unique(scan_layers[order], return_inverse=True)
        tiles = tiles_met(points, point_map, prior, space)
        keys = np.array([tile.key for tile in tiles]).reshape(-1, 2)
        corner = keys.min(axis=0)
        nx, ny = keys.max(axis=0) - corner + 1
        field = []
        for tile in tiles:
            layers = tile.index.layers
            numbers = np.minimum(np.searchsorted(layers, scan_layers), len(layers) - 1)
            field.append((tile, np.where(layers[numbers] == scan_layers, numbers, -1)))
        slots = (keys[:, 1] - corner[1]) * nx + keys[:, 0] - corner[0]
        grid = ((int(corner[0]), int(corner[1])), (int(ny), int(nx)))
        moments = np.zeros((*space.shape, 4))
        for heading, angle in enumerate(prior.heading + space.headings):
            columns, turned = np.empty((len(points), 2), np.int64), np.empty((len(points), 3), np.float32)
            turn_to_voxels(
                points, normals, np.cos(angle), np.sin(angle), prior.x, prior.y, cell, columns, turned
            )
            moments[heading] = self._heading(space, field, slots, grid, columns, ranks, turned, point_map)
        return moments

    def _heading(self, space, field, slots, grid, columns, ranks, turned, point_map):
        n_cells, rim = space.shape[1], PATCH_VOXELS - 1
        first = -(n_cells // 2)
        sums = np.zeros((n_cells + 2 * rim, n_cells + 2 * rim, 4))
        starts, numbers = points_of_tiles(columns, first, n_cells - 1 + first, *grid)
        for slot, (tile, layers) in zip(slots, field, strict=True):
            accumulate_tile(
                numbers[starts[slot] : starts[slot + 1]], columns, ranks, layers, turned,
                (tile.key[0] * TILE_VOXELS, tile.key[1] * TILE_VOXELS), tile.index.patch_starts, tile.columns,
                tile.normals, self.factors[tile.key].reshape(-1), (first, n_cells), point_map.is_signed,
                sums.reshape(-1),
            )  # fmt: skip
        return sums[rim : rim + n_cells, rim : rim + n_cells]


def tiles_met(points, point_map, prior, space):
    """Tiles of the map that a levelled scan, (n, 3), can fall in at any cell."""
    places = turn(points, prior.heading)[:, :2] + [prior.x, prior.y]
    largest_turn = float(np.abs(space.headings).max())
    reach = np.hypot(points[:, 0], points[:, 1]) * largest_turn + space.reach + space.cell
    return point_map.tiles_met(places - reach[:, None], places + reach[:, None])


def reading_order(points, layers, edge):
    places = np.floor(points[:, :2] / edge)
    number = np.zeros(len(points))
    for column in (layers.astype(np.float64), places[:, 1], places[:, 0]):
        number = number * (column.max() - column.min() + 1.0) + (column - column.min())
    return np.argsort(number.astype(np.int64), kind="stable")


@intrinsic
def _add_contribution(typing_context, sums, cell, factors, voxel, weighted):
    """sums[cell : cell + 4] += round((1, weighted, weighted, weighted) * factors[voxel : voxel + 4])."""
    signature = types.void(sums, types.int64, factors, types.int64, types.float64)

    def generate(context, builder, signature, arguments):
        sums, cell, factors, voxel, weighted = arguments
        four_floats = ir.VectorType(ir.FloatType(), 4)
        four_doubles = ir.VectorType(ir.DoubleType(), 4)

        def at(array, array_type, position, vector_type):
            data = context.make_array(array_type)(context, builder, array).data
            return builder.bitcast(builder.gep(data, [position]), vector_type.as_pointer())

        factor_pointer = at(factors, signature.args[2], voxel, four_floats)
        factor = builder.fpext(builder.load(factor_pointer, align=4), four_doubles)
        weights = ir.Constant(four_doubles, ir.Undefined)
        one = ir.Constant(ir.DoubleType(), 1.0)
        for lane, value in enumerate((one, weighted, weighted, weighted)):
            weights = builder.insert_element(weights, value, ir.Constant(ir.IntType(32), lane))
        rounder = ir.Constant(four_doubles, [ROUNDER] * 4)
        product = builder.fmul(weights, factor)
        product = builder.fsub(builder.fadd(product, rounder), rounder)
        sum_pointer = at(sums, signature.args[0], cell, four_doubles)
        total = builder.fadd(builder.load(sum_pointer, align=8), product)
        builder.store(total, sum_pointer, align=8)
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True)
def turn_to_voxels(points, normals, cosine, sine, x, y, cell, columns, turned):
    for i in range(points.shape[0]):
        columns[i, 0] = np.int64(np.floor((points[i, 0] * cosine - points[i, 1] * sine + x) / cell))
        columns[i, 1] = np.int64(np.floor((points[i, 0] * sine + points[i, 1] * cosine + y) / cell))
        turned[i, 0] = normals[i, 0] * cosine - normals[i, 1] * sine
        turned[i, 1] = normals[i, 0] * sine + normals[i, 1] * cosine
        turned[i, 2] = normals[i, 2]


@njit(nogil=True)
def points_of_tiles(columns, first, last, corner, shape):
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


@njit(nogil=True)
def accumulate_tile(
    points, columns, ranks, layers, normals, corner, patch_starts, voxel_columns, voxel_normals, factors,
    offsets, is_signed, sums,
):  # fmt: skip
    first, n_cells = offsets
    rim = PATCH_VOXELS - 1
    stride = n_cells + 2 * rim
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
            for k in range(patch_starts[row + px_first], patch_starts[row + px_last + 1]):
                cosine = nx * voxel_normals[k, 0] + ny * voxel_normals[k, 1] + nz * voxel_normals[k, 2]
                weight = np.float64(max(cosine, back * cosine))
                cell = voxel_columns[k, 1] * stride + voxel_columns[k, 0] + base
                _add_contribution(sums, 4 * cell, factors, 4 * k, weight)
