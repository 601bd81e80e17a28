# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Moments of the points in each voxel, and what follows from them: normals of planes, and vegetation (D5)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.map import TILE_VOXELS
from maxcon.mapping.build.bucketing import POINT

PADDING = 16
ROW = TILE_VOXELS + 2 * PADDING
LAYER = ROW * ROW

REACH = 2
"""Neighbourhoods are (2 reach + 1)^3 voxels: cubes of 30 cm at 6 cm."""
COUNT_CAP = 8.0
"""A voxel weighs at most as many points."""
LEAST_VOXELS = 4
"""Fewer occupied voxels in a neighbourhood leave its plane or shape open."""
N_LEVELS = 3
"""Where a plane is left open (few points, a line, a bush), voxels of 2 and of 4 times the edge are tried."""
FLATNESS = 0.3
"""Largest ratio of the smallest to the middle eigenvalue of a plane."""
HALO_VOXELS = 8
"""The coarsest neighbourhood of normals: 2 voxels of 4 cells on each side."""

SHAPE_EDGE = 0.12
"""Edge of the voxels whose shape tells vegetation, m: the power of two of a map's voxels nearest to this."""
SCATTERED = 0.2
"""Smallest ratio of eigenvalues, smallest to largest, of scattered points: the corner of a house stays below."""
LEAST_SCATTERED = 0.55
"""Smallest fraction of scattered voxels within cubes of 1.2 m of vegetation."""


@dataclass(frozen=True, slots=True, eq=False)
class VoxelMoments:
    """Moments of the voxels of one tile (and its halo), by ascending (z, y, x)."""

    # (n, 3): (x, y, z) voxel indices; x and y less the tile's first, so -8 to 519 with the halo
    indices: NDArray[np.int32]
    counts: NDArray[np.float64]  # (n,): Points in each voxel
    sums: NDArray[np.float64]  # (n, 3): Sum of positions from the voxel's corner, m
    outers: NDArray[np.float64]  # (n, 6): Sum of products xx, xy, xz, yy, yz, zz, m^2
    sides: NDArray[np.float64]  # (n, 3): Sum of the points' directions to the sensor, or of their normals

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def keys(self) -> NDArray[np.int64]:
        """Number z * LAYER + y * ROW + x of each voxel, ascending."""
        return voxel_keys(self.indices)

    @property
    def is_own(self) -> NDArray[np.bool_]:
        """Which voxels lie in the tile itself, not in its halo."""
        return np.asarray(((self.indices[:, :2] >= 0) & (self.indices[:, :2] < TILE_VOXELS)).all(axis=1))

    def mean_heights(self, cell: float) -> NDArray[np.float64]:
        """Mean height of the points of each voxel, local frame, m."""
        return np.asarray(self.indices[:, 2] * cell + self.sums[:, 2] / self.counts)

    @classmethod
    def from_records(cls, parts: Iterable[NDArray[np.void]]) -> Self:
        """Moments of points (`POINT`) that come in parts; memory is bounded by the voxels."""
        moments = cls._of_part(np.empty(0, POINT))
        for number, records in enumerate(parts):
            part = cls._of_part(records)
            moments = cls.concatenate([moments, part]) if number else part
        return moments

    @classmethod
    def _of_part(cls, records: NDArray[np.void]) -> Self:
        from maxcon.mapping.build.kernels import gather_points

        indices = np.column_stack([records["column"], records["layer"]]).astype(np.int32)
        keys, order, firsts = _grouped(indices)
        moments = cls._zeros(indices[order[firsts]])
        inside, side = np.ascontiguousarray(records["inside"]), np.ascontiguousarray(records["side"])
        gather_points(order, keys, inside, side, moments.counts, moments.sums, moments.outers, moments.sides)
        return moments

    @classmethod
    def _zeros(cls, indices: NDArray[np.int32]) -> Self:
        n = len(indices)
        return cls(indices, np.zeros(n), np.zeros((n, 3)), np.zeros((n, 6)), np.zeros((n, 3)))

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Moments of all parts; voxels that occur in several are summed."""
        indices = np.concatenate([part.indices for part in parts])
        _, order, firsts = _grouped(indices)

        def total(name: str) -> NDArray[np.float64]:
            values: NDArray[np.float64] = np.concatenate([getattr(part, name) for part in parts])[order]
            return np.add.reduceat(values, firsts, axis=0) if len(firsts) else values

        return cls(indices[order[firsts]], total("counts"), total("sums"), total("outers"), total("sides"))

    def select(self, is_chosen: NDArray[np.bool_], shift: tuple[int, int] = (0, 0)) -> Self:
        """Keep some voxels, with x and y moved by `shift` voxels."""
        chosen = {name: values[is_chosen] for name, values in self.arrays.items()}
        chosen["indices"] = chosen["indices"] + np.array([*shift, 0], dtype=np.int32)
        return type(self)(**chosen)

    def coarser(self, edge: float) -> Self:
        """Moments of voxels twice as large; `edge` is that of these voxels, m."""
        from maxcon.mapping.build.kernels import merge_voxels

        parents = self.indices >> 1
        keys, order, firsts = _grouped(parents)
        merged = self._zeros(parents[order[firsts]])
        shifts = (self.indices - 2 * parents) * edge
        merge_voxels(
            order, keys, shifts, self.counts, self.sums, self.outers, merged.counts, merged.sums, merged.outers
        )
        return merged


def voxel_keys(indices: NDArray[np.int32]) -> NDArray[np.int64]:
    """One number per voxel that ascends with (z, y, x); rows are padded, so neighbours in x differ by 1."""
    x, y, z = indices.T.astype(np.int64)
    return np.asarray(z * LAYER + (y + PADDING) * ROW + (x + PADDING))


def _grouped(indices: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]]:
    """Keys of voxels, their order by keys, and where in that order each voxel begins."""
    keys = voxel_keys(indices)
    order = np.argsort(keys, kind="stable")
    return keys, order, np.flatnonzero(np.diff(keys[order], prepend=-(2**62)))


def plane_normals(moments: VoxelMoments, cell: float, is_wanted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Unit normals of voxels, their sign open, from the smallest neighbourhood that determines a plane.

    `moments`: the voxels of a tile with its halo; `cell`: voxel edge, m; `is_wanted` (n,): voxels whose normal is asked
    for (not the halo's).

    Returns shape (n, 3); zeros where no neighbourhood determines a plane, or none is asked for.
    """
    from maxcon.mapping.build.kernels import neighbourhood_normals

    normals = np.zeros((len(moments), 3))
    if len(moments) < LEAST_VOXELS:  # at no level are there more
        return normals
    level, edge = moments, cell
    place = np.arange(len(moments))  # the voxel of this level that holds each voxel
    for number in range(N_LEVELS):
        if number > 0:
            level, edge, place = _next_level(level, edge, place)
        is_open = is_wanted & ~normals.any(axis=1)
        is_asked = np.zeros(len(level), bool)
        is_asked[place[is_open]] = True
        fitted = np.zeros((len(level), 3))
        neighbourhood_normals(
            level.keys, level.counts, level.sums, level.outers, is_asked, edge, ROW, LAYER, REACH,
            COUNT_CAP, LEAST_VOXELS, FLATNESS, fitted,
        )  # fmt: skip
        normals[is_open] = fitted[place[is_open]]
    return normals


def _next_level(
    level: VoxelMoments, edge: float, place: NDArray[np.intp]
) -> tuple[VoxelMoments, float, NDArray[np.intp]]:
    """Voxels twice as large, their edge, and which of them holds each of the finest voxels."""
    coarser = level.coarser(edge)
    return coarser, 2.0 * edge, np.searchsorted(coarser.keys, voxel_keys(level.indices >> 1))[place]


def turn_to_side(normals: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn normals, shape (n, 3), to the side of the sensor, shape (n, 3); zeros where the side is not known."""
    return np.asarray(normals * np.sign((normals * sides).sum(axis=1))[:, None])


def is_vegetation(moments: VoxelMoments, cell: float) -> NDArray[np.bool_]:
    """Which voxels of a tile with its halo, without the ground, are vegetation: points scatter in all directions."""
    from maxcon.mapping.build.kernels import scatters, sums_near

    level, edge, place = moments, cell, np.arange(len(moments))
    for _ in range(max(0, round(math.log2(SHAPE_EDGE / cell)))):
        level, edge, place = _next_level(level, edge, place)
    scatter = np.empty(len(level))
    scatters(
        level.keys, level.counts, level.sums, level.outers, edge, ROW, LAYER, REACH, COUNT_CAP, LEAST_VOXELS, scatter
    )
    blocks, block_of_voxel = np.unique(voxel_keys(level.indices >> 1), return_inverse=True)
    is_known = np.isfinite(scatter)
    is_scattered = is_known & (np.nan_to_num(scatter) > SCATTERED)
    counted = np.column_stack([np.bincount(block_of_voxel, flags, len(blocks)) for flags in (is_scattered, is_known)])
    totals = np.zeros_like(counted)
    sums_near(blocks, counted, ROW, LAYER, REACH, totals)
    is_green = (totals[:, 1] > 0.0) & (totals[:, 0] >= LEAST_SCATTERED * totals[:, 1])
    return np.asarray(is_green[block_of_voxel][place])
