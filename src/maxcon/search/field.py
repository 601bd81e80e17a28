# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Field: what the compiled searches make of a scan, a prior and the tiles around before they begin."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.geometry import Pose, voxel_indices
from maxcon.point_map import TILE_VOXELS, PointMap, TileKey, VoxelTile
from maxcon.scan import Scan
from maxcon.search.matching import Multiplicity, Weighting, level
from maxcon.search_space import SearchSpace

__all__ = ["Field"]

TileArrays = tuple[
    tuple[int, int], NDArray[np.int64], NDArray[np.int16], NDArray[np.float32], NDArray[np.int32]
]
"""(x, y) voxel index of a tile, its patch starts, and columns, normals and counts of its voxels; no counts where a
voxel counts once."""


@dataclass(frozen=True, slots=True)
class Field:
    """What all headings share: the levelled scan and the tiles it can fall in.

    Points of one height layer in one square of SQUARE_VOXELS voxels, at the prior's heading, are a group.
    Those with a normal come first in it, those in one voxel follow each other; neighbouring groups read the
    same voxels. With weights of one all points count as if they had a normal.

    Parameters
    ----------
    points : array, shape (2, n)
        x and y of each point, levelled, about the sensor, m.
    normals : array, shape (3, n)
        Their normals, levelled.
    starts, middles : array, shape (groups + 1,) and (groups,)
        First point of each group, and its first without a normal.
    ranks : array, shape (groups,)
        Number of each group's height layer among those of the scan.
    tiles : dict
        Tiles by their slot in the grid, with the layer each rank has in the tile (-1 for none).
    corner, shape : tuple of 2 int
        Key (x, y) of the first tile of the grid that covers the tiles, and its size (ny, nx).
    cell : float
        Voxel edge of the map, m: that of the space may differ from it by rounding.
    is_once, is_weighted, is_signed : bool
        Whether a voxel counts once, whether weights are cosines, and whether the map's normals have a side.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    starts: NDArray[np.int64]
    middles: NDArray[np.int64]
    ranks: NDArray[np.int64]
    tiles: dict[int, tuple[VoxelTile, NDArray[np.int64]]]
    corner: TileKey
    shape: tuple[int, int]
    cell: float
    is_once: bool
    is_weighted: bool
    is_signed: bool

    @classmethod
    def prepare(
        cls,
        scan: Scan,
        point_map: PointMap,
        prior: Pose,
        space: SearchSpace,
        multiplicity: Multiplicity,
        weighting: Weighting,
    ) -> "Field":
        """Level a scan, part it into groups and find its tiles.

        Raises
        ------
        ArrayError
            If the prior lies so far out that voxels have no index there.
        """
        levelled = level(scan, prior)
        cell = point_map.cell
        is_weighted = weighting is Weighting.COSINE
        layers = voxel_indices(levelled.points, cell)[:, 2]
        radii = np.hypot(levelled.points[:, 0], levelled.points[:, 1])
        _check_indices(prior, float(radii.max(initial=0.0)) + space.reach + cell, cell)
        points, normals = (
            np.ascontiguousarray(levelled.points[:, :2].T),
            np.ascontiguousarray(levelled.normals.T),
        )
        columns, _ = _turned(points, normals, prior, [prior.heading], cell)
        is_plain = np.asarray(~normals.any(axis=0) & is_weighted, dtype=np.bool_)
        order, starts = _groups(columns[0], layers, is_plain)
        n_plain = np.concatenate([[0], np.cumsum(is_plain[order])])
        scan_layers, ranks = np.unique(layers[order[starts[:-1]]], return_inverse=True)
        tiles = _tiles_met(point_map, space, columns[0].take(order, axis=1), radii[order], starts)
        keys = np.array([tile.key for tile in tiles], dtype=np.int64).reshape(-1, 2)
        corner = keys.min(axis=0, initial=2**31)
        nx, ny = keys.max(axis=0, initial=-(2**31)) - corner + 1 if tiles else (0, 0)
        slots = (keys[:, 1] - corner[1]) * nx + keys[:, 0] - corner[0]
        return cls(
            points.take(order, axis=1),
            normals.take(order, axis=1),
            starts,
            starts[1:] - np.diff(n_plain[starts]),
            ranks,
            {
                int(slot): (tile, _layers_in(tile, scan_layers))
                for slot, tile in zip(slots, tiles, strict=True)
            },
            (int(corner[0]), int(corner[1])),
            (int(ny), int(nx)),
            cell,
            multiplicity is Multiplicity.OCCUPIED,
            is_weighted,
            point_map.is_signed,
        )

    def turned(self, prior: Pose, headings: ArrayLike) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Voxel columns (h, 2, n) and normals (h, 3, n) of the points at h headings, in the map's axes."""
        return _turned(self.points, self.normals, prior, headings, self.cell)

    def visited(
        self, visits: NDArray[np.int64], first: int, last: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], TileArrays]]:
        """Yield each tile as the kernels take it, with what meets it.

        Parameters
        ----------
        visits : array, shape (m, 7)
            As `visit_kernels.plan_visits` planned them.
        first, last : int
            Offsets, voxels.

        Yields
        ------
        numbers : array
            The visits that meet the tile at some offset.
        layers : array
            The layer that each rank has in the tile, -1 for none.
        tile : tuple
            Its arrays.
        """
        from maxcon.search import visit_kernels

        starts, numbers = visit_kernels.visits_of_tiles(visits, first, last, self.corner, self.shape)
        for slot, (tile, layers) in self.tiles.items():
            corner = (tile.key[0] * TILE_VOXELS, tile.key[1] * TILE_VOXELS)
            counts = tile.counts[:0] if self.is_once else tile.counts
            arrays = (corner, tile.index.patch_starts, tile.columns, tile.normals, counts)
            yield numbers[starts[slot] : starts[slot + 1]], layers, arrays


def _groups(
    columns: NDArray[np.int32], layers: NDArray[np.int32], is_plain: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of points by square, height layer, whether they lack a normal, y and x; first point of each group."""
    from maxcon.search.visit_kernels import SQUARE_VOXELS

    if columns.shape[1] == 0:
        return np.empty(0, np.int64), np.zeros(1, np.int64)
    (x, y), (square_x, square_y) = columns, columns // SQUARE_VOXELS
    places = (y - square_y * SQUARE_VOXELS) * SQUARE_VOXELS + x - square_x * SQUARE_VOXELS
    parts = [square_y, square_x, layers, is_plain, places]
    lows = [int(part.min()) for part in parts]
    sizes = [int(part.max()) - low + 1 for part, low in zip(parts, lows, strict=True)]
    if math.prod(sizes) < 2**63:  # one number for each point sorts faster
        number = np.zeros(len(x), np.int64)
        for part, low, size in zip(parts, lows, sizes, strict=True):
            number *= size
            number += part
            number -= low
        order = np.argsort(number)
    else:
        order = np.lexsort(parts[::-1])
    is_first = np.ones(len(x), bool)
    is_first[1:] = np.any([part[order[1:]] != part[order[:-1]] for part in parts[:3]], axis=0)
    return order, np.append(np.flatnonzero(is_first), len(x))


def _tiles_met(
    point_map: PointMap,
    space: SearchSpace,
    columns: NDArray[np.int32],
    radii: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> list[VoxelTile]:
    """Tiles that any group can fall in at any cell, from its voxels (2, n) and distances (n,), m, at the prior."""
    if columns.shape[1] == 0:
        return []
    largest_turn = float(np.abs(space.headings).max())
    reach = np.maximum.reduceat(radii, starts[:-1]) * largest_turn + space.reach + point_map.cell
    low = np.minimum.reduceat(columns, starts[:-1], axis=1) * point_map.cell - reach
    high = (np.maximum.reduceat(columns, starts[:-1], axis=1) + 1) * point_map.cell + reach
    return point_map.tiles_met(low.T, high.T)


def _turned(
    points: NDArray[np.float64], normals: NDArray[np.float64], prior: Pose, headings: ArrayLike, cell: float
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Voxel columns (h, 2, n) and normals (h, 3, n) of a levelled scan at h headings, in the map's axes."""
    from maxcon.search import visit_kernels

    headings = np.asarray(headings)
    columns = np.empty((len(headings), *points.shape), np.int32)
    turned = np.empty((len(headings), *normals.shape), np.float32)
    for i, heading in enumerate(headings):
        visit_kernels.turn_to_voxels(
            points, normals, np.cos(heading), np.sin(heading), prior.x, prior.y, cell, columns[i], turned[i]
        )
    return columns, turned


def _check_indices(prior: Pose, reach: float, cell: float) -> None:
    """Refuse a prior so far out that voxels within reach have no index."""
    voxel_indices(prior.position + [[-reach, -reach, 0.0], [reach, reach, 0.0]], cell)


def _layers_in(tile: VoxelTile, scan_layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Number of each layer of the scan among the tile's, -1 where the tile has none."""
    layers = tile.index.layers
    numbers = np.minimum(np.searchsorted(layers, scan_layers), len(layers) - 1)
    return np.where(layers[numbers] == scan_layers, numbers, -1)
