"""NormalGrid: the normals of a level of the map in a dense grid around a place, as the coarse search reads them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.arrays import read_only_view
from maxcon.map.layout import ROW_BLOCK
from maxcon.map.tile import VoxelTile

STEP, HEIGHT_STEP = 15.0, 3.0
"""Grids begin and end at multiples of these, along x and y and in height, m: the epochs that follow find their own in
the same grid."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalGrid:
    """Normals of the voxels around a place, and how much each determines along the axis that fewest surfaces face."""

    low: NDArray[np.int64]  # (3,): x, y and z index of the first voxel
    shape: tuple[int, int, int]  # (nz, ny, nx), numbers of voxels; the arrays are flat, in this order, and padded
    cell: float  # edge of a voxel, m
    normals: NDArray[np.int8]  # (n, 2): x and y of the unit normals, in 127ths; zeros where there is none
    along: NDArray[np.uint8]  # (n,): the squared product of those with a horizontal axis, in 64ths, rounded up
    across: NDArray[np.uint8]  # (n,): the same with the axis at right angles to it

    @classmethod
    def of(
        cls, tiles: Sequence[VoxelTile], cell: float, low: NDArray[np.int64], high: NDArray[np.int64]
    ) -> "NormalGrid":
        """Grid of the voxels of some tiles from index `low` to `high`, (x, y, z), both included."""
        from maxcon.map import tile_kernels

        nx, ny, nz = (high - low + 1).tolist()
        n = nx * ny * nz + ROW_BLOCK
        normals, along, across = np.zeros((n, 2), np.int8), np.zeros(n, np.uint8), np.zeros(n, np.uint8)
        products = sum((tile.normal_products for tile in tiles), np.zeros((2, 2)))
        axis = np.ascontiguousarray(np.linalg.eigh(products)[1][:, 0])
        for tile in tiles:
            corner = np.array([tile.key[0] * tile.edge, tile.key[1] * tile.edge, 0]) - low
            tile_kernels.fill_normals(
                read_only_view(tile.columns), read_only_view(tile.layers), read_only_view(tile.normals), corner,
                (nz, ny, nx), axis, normals, along, across,
            )  # fmt: skip
        return cls(low, (nz, ny, nx), cell, normals, along, across)

    def covers(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> bool:
        """Whether the voxels from index `low` to `high`, (x, y, z), both included, lie in the grid."""
        end = self.low + np.array(self.shape[::-1])
        return bool((low >= self.low).all() and (high < end).all())


def grid_extent(
    cell: float, x: float, y: float, reach: float, z: tuple[float, float]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last index (x, y, z) of the voxels within whole steps around a place, `z` lowest and highest; m."""
    steps = np.maximum(1, np.round(np.array([STEP, STEP, HEIGHT_STEP]) / cell)).astype(np.int64)
    low, high = np.array([x - reach, y - reach, z[0]]), np.array([x + reach, y + reach, z[1]])
    first, last = (np.floor(each / (steps * cell)).astype(np.int64) for each in (low, high))
    return first * steps, (last + 1) * steps - 1
