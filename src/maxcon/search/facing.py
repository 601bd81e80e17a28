# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Axes along which matches are bounded, and the voxels of a tile that face along them: all that the bounds read."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.point_map import VoxelTile

__all__ = ["LEAST_FACING", "N_AXES", "Axis", "Facing"]

# A bound is as good along an axis within 1.4 degrees of the best one: (sin 1.4 deg)^2 is 0.0006.
N_AXES = 64

LEAST_FACING = 0.002
"""Voxels that add no more than this along an axis do not face along it: walls across it, up to 2.6 degrees of noise."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One of the N_AXES horizontal directions in which bounds are made, or none: then matches are counted.

    Parameters
    ----------
    number : int
        Its azimuth in steps of pi / N_AXES, or -1.
    """

    number: int

    @classmethod
    def near(cls, azimuth: float) -> "Axis":
        """Return the axis nearest to an azimuth, rad."""
        return cls(round(azimuth / math.pi * N_AXES) % N_AXES)

    @classmethod
    def none(cls) -> "Axis":
        """Count matches instead."""
        return cls(-1)

    @property
    def is_none(self) -> bool:
        """Whether matches are counted."""
        return self.number < 0

    @property
    def across(self) -> "Axis":
        """The axis at right angles."""
        return Axis((self.number + N_AXES // 2) % N_AXES)

    @property
    def vector(self) -> tuple[np.float32, np.float32]:
        """Unit vector (x, y); zeros for none."""
        if self.is_none:
            return np.float32(0.0), np.float32(0.0)
        azimuth = self.number * math.pi / N_AXES
        return np.float32(math.cos(azimuth)), np.float32(math.sin(azimuth))


@dataclass(frozen=True, slots=True)
class Facing:
    """The voxels of a tile that face along an axis, in the order of the tile.

    Parameters
    ----------
    patch_starts : array, shape (n_layers * TILE_PATCHES**2 + 1,), int32
        As those of the tile's index.
    columns : array, shape (n, 2), int16
        (x, y) voxel index less the tile's first.
    normal_steps : array, shape (n, 3), int16
        Normals, in `facing_kernels.NORMAL_STEP`.
    values : array, shape (n,), float32
        What a match of weight one adds along the axis: (n . u)^2, as often as the voxel counts.
    """

    patch_starts: NDArray[np.int32]
    columns: NDArray[np.int16]
    normal_steps: NDArray[np.int16]
    values: NDArray[np.float32]

    @classmethod
    def of(cls, tile: VoxelTile, axis: Axis, *, is_once: bool) -> "Facing":
        """Voxels of a tile; made once, and kept with it as long as they are among the last ones asked for."""

        def make(tile: VoxelTile) -> Facing:
            from maxcon.search.facing_kernels import facing_voxels

            starts = np.empty(len(tile.index.patch_starts), np.int32)
            columns, steps = np.empty((len(tile) + 1, 2), np.int16), np.empty((len(tile) + 1, 3), np.int16)
            values = np.empty(len(tile) + 1, np.float32)
            n_facing = facing_voxels(
                tile.index.patch_starts, tile.columns, tile.normals, tile.counts[:0] if is_once else tile.counts,
                axis.vector, np.float32(LEAST_FACING), starts, columns, steps, values,
            )  # fmt: skip
            end = n_facing + 1  # the kernel writes one too many before it knows
            return cls(starts, columns[:end].copy(), steps[:end].copy(), values[:end].copy())

        return tile.derived((Facing, axis, is_once), make)

    @property
    def n_bytes(self) -> int:
        """Memory it takes."""
        arrays = (self.patch_starts, self.columns, self.normal_steps, self.values)
        return sum(array.nbytes for array in arrays)
