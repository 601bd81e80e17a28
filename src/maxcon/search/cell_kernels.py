"""Compiled: the moments of single cells, each by itself; to the last bit those of all cells together."""

import numpy as np

from maxcon._system.kernel_cache import njit
from maxcon.map.layout import PATCH_VOXELS
from maxcon.map.lookup_kernels import HELD, N_HELD, find_in_patch, n_bits
from maxcon.search.accumulator import CONTRIBUTION_STEP, ROUNDER

PATCH_BITS = PATCH_VOXELS.bit_length() - 1
ONE, LAYER_BITS, IN_WORD = np.uint64(1), np.uint64(6), np.uint64(63)


@njit(nogil=True, cache=True)
def moments_of_cells(
    offsets, columns, normals, ranks, layers, edge_bits, table, without_normal, is_once, is_signed, moments
):  # fmt: skip
    """Write the moments of some cells of one heading: what the voxels add that scan points fall in.

    offsets : (c, 2) int64, (x, y) of each cell, voxels; columns : (2, n) int32 and normals : (3, n) float32, of the
    points turned by the heading; ranks : (n,) int32, number of each point's layer among the scan's; layers : (t + 1, l)
    int32, number of each of these layers in each tile of the table, of a layer that is not there one too high;
    edge_bits : a tile has 2^edge_bits voxels along an edge; table : of the tiles, see `VoxelTable`;
    without_normal : weight of a match whose point has no normal; is_once : whether a voxel counts once; is_signed :
    whether the map's normals have a side; moments : (c, 4) float64, out. With the arithmetic of `window_kernels`, in
    whole numbers of steps, which are added in any order.
    """
    rows, grid, corner, _, held, numbers = table[:6]
    voxel_normals, counts = table[8], table[9]
    back, inside, row_bits = np.float32(0.0 if is_signed else -1.0), (1 << edge_bits) - 1, edge_bits - PATCH_BITS
    for c in range(offsets.shape[0]):
        n, xx, xy, yy = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
        row, last_x, last_y = np.uint64(0), np.int64(0), np.int64(0)
        n_held, first_held = np.uint64(0), np.uint64(0)
        for number in range(columns.shape[1]):
            i = np.uint64(number)
            x, y = columns[np.uint64(0), i] + offsets[c, 0], columns[ONE, i] + offsets[c, 1]
            if number == 0 or x >> edge_bits != last_x or y >> edge_bits != last_y:  # points in one tile follow others
                last_x, last_y = x >> edge_bits, y >> edge_bits
                slot_x, slot_y, row = last_x - corner[0], last_y - corner[1], np.uint64(0)
                if 0 <= slot_x < grid.shape[1] and 0 <= slot_y < grid.shape[0]:
                    row = np.uint64(grid[slot_y, slot_x])
                n_held, first_held = np.uint64(rows[row, N_HELD]), np.uint64(rows[row, HELD])
            # `held` has a bit for each layer of a patch, 64 layers a word.
            place = np.uint64((((y & inside) >> PATCH_BITS) << row_bits) | ((x & inside) >> PATCH_BITS))
            layer = np.uint64(layers[row, np.uint64(ranks[i])])
            place = first_held + place * n_held + (layer >> LAYER_BITS)
            patches, bit = held[place], layer & IN_WORD
            if not (patches >> bit) & ONE:
                continue
            k = find_in_patch(x, y, np.int64(numbers[place]) + np.int64(n_bits(patches & ((ONE << bit) - ONE))), table)
            if k < 0:
                continue
            ax, ay, az = normals[0, i], normals[1, i], normals[2, i]
            nx, ny, nz = voxel_normals[k, 0], voxel_normals[k, 1], voxel_normals[k, 2]
            cosine = ax * nx + ay * ny + az * nz
            weight = np.float64(max(cosine, back * cosine))
            if (ax == 0.0) & (ay == 0.0) & (az == 0.0):
                weight = without_normal
            times = np.int64(1) if is_once else np.int64(counts[k])
            weight *= times
            n += times
            xx += np.int64((weight * np.float64(nx * nx) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
            xy += np.int64((weight * np.float64(nx * ny) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
            yy += np.int64((weight * np.float64(ny * ny) + ROUNDER - ROUNDER) * (1.0 / CONTRIBUTION_STEP))
        moments[c, 0], moments[c, 1] = n, xx * CONTRIBUTION_STEP
        moments[c, 2], moments[c, 3] = xy * CONTRIBUTION_STEP, yy * CONTRIBUTION_STEP
