# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""VoxelMoments: count, sums and products of the points of each voxel, which planes are fitted from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.spill import RECORD
from maxcon.map import TILE_VOXELS
from maxcon._system.atomic import atomic_file

__all__ = ["HALO_VOXELS", "VoxelMoments"]

# The coarsest neighbourhood (mapping.voxel_normals): 2 voxels of 4 cells on each side.
HALO_VOXELS = 8
PADDING = 16
ROW = TILE_VOXELS + 2 * PADDING
LAYER = ROW * ROW


@dataclass(frozen=True, slots=True)
class VoxelMoments:
    """Moments of the voxels of one tile (and its halo), by ascending (z, y, x).

    Parameters
    ----------
    indices : array, shape (n, 3), int32
        (x, y, z) voxel indices; x and y less the tile's first, so -8 to 519 with the halo.
    counts : array, shape (n,), float64
        Points in each voxel.
    sums : array, shape (n, 3), float64
        Sum of positions from the voxel's corner, m.
    outers : array, shape (n, 6), float64
        Sum of products xx, xy, xz, yy, yz, zz, m^2.
    sides : array, shape (n, 3), float64
        Sum of the points' directions to the sensor, or of their normals.
    """

    indices: NDArray[np.int32]
    counts: NDArray[np.float64]
    sums: NDArray[np.float64]
    outers: NDArray[np.float64]
    sides: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def n_bytes(self) -> int:
        """Memory of the arrays."""
        return sum(array.nbytes for array in (self.indices, self.counts, self.sums, self.outers, self.sides))

    @property
    def keys(self) -> NDArray[np.int64]:
        """Number z * LAYER + y * ROW + x of each voxel, ascending."""
        return voxel_keys(self.indices)

    @classmethod
    def from_records(cls, parts: Iterable[NDArray[np.void]]) -> Self:
        """Moments of points (mapping.spill.RECORD) that come in parts; memory is bounded by the voxels."""
        moments = None
        for records in parts:
            gathered = cls._gather(records)
            moments = gathered if moments is None else cls.concatenate([moments, gathered])
        return moments if moments is not None else cls._gather(np.empty(0, RECORD))

    @classmethod
    def _gather(cls, records: NDArray[np.void]) -> Self:
        from maxcon.mapping.build.kernels import gather_points

        indices = np.column_stack([records["column"], records["layer"]]).astype(np.int32)
        keys = voxel_keys(indices)
        order = np.argsort(keys, kind="stable")
        is_first = np.diff(keys[order], prepend=-(2**62)) != 0
        counts, sums, outers, sides = _zeros(int(is_first.sum()))
        inside, side = np.ascontiguousarray(records["inside"]), np.ascontiguousarray(records["side"])
        gather_points(order, keys, inside, side, counts, sums, outers, sides)
        return cls(indices[order[is_first]], counts, sums, outers, sides)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Moments of all parts; voxels that occur in several are summed."""
        indices = np.concatenate([part.indices for part in parts])
        keys = voxel_keys(indices)
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=-(2**62)))

        def total(name: str) -> NDArray[np.float64]:
            values = np.concatenate([getattr(part, name) for part in parts])[order]
            summed: NDArray[np.float64] = np.add.reduceat(values, starts, axis=0) if len(starts) else values
            return summed

        return cls(indices[order[starts]], total("counts"), total("sums"), total("outers"), total("sides"))

    def select(self, is_chosen: NDArray[np.bool_], shift: tuple[int, int] = (0, 0)) -> Self:
        """Keep some voxels, with x and y moved by `shift` voxels."""
        indices = self.indices[is_chosen] + np.array([*shift, 0], dtype=np.int32)
        return type(self)(
            indices,
            self.counts[is_chosen],
            self.sums[is_chosen],
            self.outers[is_chosen],
            self.sides[is_chosen],
        )

    def coarser(self, edge: float) -> Self:
        """Moments of voxels twice as large; `edge` is that of these voxels, m."""
        from maxcon.mapping.build.kernels import merge_voxels

        parents = self.indices >> 1
        keys = voxel_keys(parents)
        order = np.argsort(keys, kind="stable")
        is_first = np.diff(keys[order], prepend=-(2**62)) != 0
        counts, sums, outers, sides = _zeros(int(is_first.sum()))
        shifts = (self.indices - 2 * parents) * edge
        merge_voxels(order, keys, shifts, self.counts, self.sums, self.outers, counts, sums, outers)
        return type(self)(parents[order[is_first]], counts, sums, outers, sides)

    def save(self, path: Path) -> None:
        """Write to an uncompressed NPZ file, in a step."""
        with atomic_file(path) as partial, partial.open("wb") as file:
            np.savez(
                file,
                indices=self.indices,
                counts=self.counts,
                sums=self.sums,
                outers=self.outers,
                sides=self.sides,
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays:
            return cls(*(arrays[name] for name in ("indices", "counts", "sums", "outers", "sides")))


def voxel_keys(indices: NDArray[np.int32]) -> NDArray[np.int64]:
    """One number per voxel that ascends with (z, y, x); rows are padded, so neighbours in x differ by 1."""
    x, y, z = indices.T.astype(np.int64)
    keys: NDArray[np.int64] = z * LAYER + (y + PADDING) * ROW + (x + PADDING)
    return keys


def _zeros(
    n: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    return np.zeros(n), np.zeros((n, 3)), np.zeros((n, 6)), np.zeros((n, 3))
