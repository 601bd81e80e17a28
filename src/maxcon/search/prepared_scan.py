# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PreparedScan: the points of a scan grouped by height layer and voxel square, and the tiles of the map in reach."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maxcon.compiled import read_only_view
from maxcon.geometry import Pose, rotation_matrices, voxel_indices
from maxcon.point_map import PointMap, TileKey, VoxelTile
from maxcon.scan import Scan
from maxcon.search.matching import Multiplicity, Weighting
from maxcon.search.window import Window
from maxcon.search_space import SearchSpace

__all__ = ["PreparedScan"]


@dataclass(frozen=True, slots=True)
class PreparedScan:
    """A levelled scan in groups of neighbouring points, and the tiles that it can fall in at any cell of a space.

    Points of one height layer in one square of SQUARE_VOXELS voxels, at the prior's heading, are a group.
    Those with a normal come first in it, those in one voxel follow each other; neighbouring groups read the
    same voxels. With weights of one normals are dropped here: all points take `without_normal`.

    Parameters
    ----------
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells, around the prior.
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
    edge : int
        Voxels along an edge of a tile.
    cell : float
        Voxel edge of the map, m: that of the space may differ from it by rounding.
    is_once, is_signed : bool
        Whether a voxel counts once, and whether the map's normals have a side.
    without_normal : float
        Weight of the matches of points without a normal.
    spread : array, shape (3,)
        Sums of nx nx, nx ny and ny ny over all normals of the scan, levelled: they tell which axis is probably
        determined least before anything is scored.
    """

    prior: Pose
    space: SearchSpace
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    starts: NDArray[np.int64]
    middles: NDArray[np.int64]
    ranks: NDArray[np.int64]
    tiles: dict[int, tuple[VoxelTile, NDArray[np.int64]]]
    corner: TileKey
    shape: tuple[int, int]
    edge: int
    cell: float
    is_once: bool
    is_signed: bool
    without_normal: float
    spread: NDArray[np.float64]

    @classmethod
    def prepare(
        cls,
        scan: Scan,
        point_map: PointMap,
        prior: Pose,
        space: SearchSpace,
        multiplicity: Multiplicity,
        weighting: Weighting,
    ) -> "PreparedScan":
        """Level a scan, part it into groups and find its tiles.

        Raises
        ------
        ArrayError
            If the prior lies so far out that voxels have no index there.
        """
        from maxcon.search import group_kernels

        cell = point_map.cell
        points, normals = _levelled(scan, prior)
        nx, ny, _ = normals
        spread = np.array([nx @ nx, nx @ ny, ny @ ny])
        if weighting is Weighting.ONE:
            normals[:] = 0.0
        _check_indices(points, prior, space.reach, cell)
        columns, layers = _columns(points, prior, cell), group_kernels.to_layers(points[2], cell)
        order, keys = group_kernels.sort_keys(_keys(columns, layers, normals))
        points, normals = group_kernels.gather(points[:2], order), group_kernels.gather(normals, order)
        groups = group_kernels.find_groups(keys, order, points, columns, layers)
        starts, middles, group_layers, boxes, radii = groups
        ranks, scan_layers = group_kernels.rank(group_layers)
        tiles = _tiles_met(point_map, prior, space, boxes, radii)
        tile_keys = np.array([tile.key for tile in tiles], dtype=np.int64).reshape(-1, 2)
        corner = tile_keys.min(axis=0, initial=2**31)
        nx, ny = tile_keys.max(axis=0, initial=-(2**31)) - corner + 1 if tiles else (0, 0)
        slots = (tile_keys[:, 1] - corner[1]) * nx + tile_keys[:, 0] - corner[0]
        return cls(
            prior,
            space,
            points,
            normals,
            starts,
            middles,
            ranks,
            {
                slot: (tile, group_kernels.number_layers(tile.index.layers, scan_layers))
                for slot, tile in zip(slots.tolist(), tiles, strict=True)
            },
            (int(corner[0]), int(corner[1])),
            (int(ny), int(nx)),
            point_map.tile_voxels,
            cell,
            multiplicity is Multiplicity.OCCUPIED,
            point_map.is_signed,
            weighting.without_normal,
            spread,
        )

    @property
    def n_points(self) -> int:
        """How many points there are."""
        return int(self.points.shape[1])

    def azimuths(self, headings: NDArray[np.int64]) -> NDArray[np.float64]:
        """Headings of the search space, by number, as headings in the map, rad."""
        return self.prior.heading + self.space.headings[headings]

    def turned(self, headings: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Voxel columns (h, 2, n) and normals (h, 3, n) of the points at h headings, by number, in the map's axes."""
        from maxcon.search import visit_kernels

        turned = np.empty((len(headings), *self.normals.shape), np.float32)
        for i, azimuth in enumerate(self.azimuths(headings)):
            visit_kernels.turn_normals(self.normals, np.cos(azimuth), np.sin(azimuth), turned[i])
        return self.voxels_at(headings), turned

    def constraining(self) -> "PreparedScan":
        """The points that add to N alone: the others are only counted."""
        if self.without_normal > 0.0:
            return self
        from maxcon.search import group_kernels

        numbers, _ = group_kernels.points_of_groups(self.starts, self.middles, self.ranks)
        sizes = self.middles - self.starts[:-1]
        starts = np.append(0, np.cumsum(sizes[sizes > 0]))
        return replace(
            self,
            points=group_kernels.gather(self.points, numbers),
            normals=group_kernels.gather(self.normals, numbers),
            starts=starts,
            middles=starts[1:],
            ranks=self.ranks[sizes > 0],
        )

    def voxels_at(self, headings: NDArray[np.int64]) -> NDArray[np.int32]:
        """Voxel columns (h, 2, n) of the points at h headings, by number, in the map's axes."""
        from maxcon.search import visit_kernels

        prior, columns = self.prior, np.empty((len(headings), *self.points.shape), np.int32)
        for i, azimuth in enumerate(self.azimuths(headings)):
            visit_kernels.turn_to_columns(
                self.points, np.cos(azimuth), np.sin(azimuth), prior.x, prior.y, self.cell, columns[i]
            )
        return columns

    def visited(
        self, visits: NDArray[np.int64], window: Window
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], VoxelTile]]:
        """Yield each tile with what meets it.

        Parameters
        ----------
        visits : array, shape (m, 7)
            As `visit_kernels.plan_visits` planned them.
        window : Window
            Offsets.

        Yields
        ------
        numbers : array
            The visits that meet the tile at some offset of the window.
        layers : array
            The layer that each rank has in the tile, -1 for none.
        tile : VoxelTile
        """
        from maxcon.search import visit_kernels

        starts, numbers = visit_kernels.visits_of_tiles(
            visits, tuple(window), self.edge.bit_length() - 1, self.corner, self.shape
        )
        for slot, (tile, layers) in self.tiles.items():
            yield numbers[starts[slot] : starts[slot + 1]], layers, tile


def _levelled(scan: Scan, prior: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (3, n) and normals (3, n) as `matching.level` gives them, to the last bit, but as rows."""
    from maxcon.search import group_kernels

    rotation = np.ascontiguousarray(rotation_matrices(prior.roll, prior.pitch, 0.0))
    points = group_kernels.level(read_only_view(scan.points), rotation)
    normals = group_kernels.level(read_only_view(scan.normals), rotation)
    points[2] += prior.z
    return points, normals


def _check_indices(points: NDArray[np.float64], prior: Pose, reach: float, cell: float) -> None:
    """Refuse points, (3, n), or a prior, so far out that voxels within reach of them have no index."""
    extremes = np.array([points.min(axis=1, initial=0.0), points.max(axis=1, initial=0.0)])
    voxel_indices(extremes, cell)
    squares = points[0] * points[0]
    squares += points[1] * points[1]
    reach += float(np.sqrt(squares.max(initial=0.0))) + cell
    voxel_indices(prior.position + [[-reach, -reach, 0.0], [reach, reach, 0.0]], cell)


def _columns(points: NDArray[np.float64], prior: Pose, cell: float) -> NDArray[np.int32]:
    """Voxel columns (2, n) of levelled points (3, n) at the prior."""
    from maxcon.search import visit_kernels

    columns = np.empty((2, points.shape[1]), np.int32)
    cosine, sine = np.cos(prior.heading), np.sin(prior.heading)
    visit_kernels.turn_to_columns(points[:2], cosine, sine, prior.x, prior.y, cell, columns)
    return columns


def _keys(
    columns: NDArray[np.int32], layers: NDArray[np.int32], normals: NDArray[np.float64]
) -> NDArray[np.uint64]:
    """Numbers by which points with normals (3, n) are sorted, see `group_kernels.key_points`."""
    from maxcon.search import group_kernels
    from maxcon.search.visit_kernels import SQUARE_VOXELS

    if not len(layers):
        return np.empty(0, np.uint64)
    low_x, low_y = (columns.min(axis=1) // SQUARE_VOXELS).tolist()
    high_x, high_y = (columns.max(axis=1) // SQUARE_VOXELS).tolist()
    low, nx, ny = int(layers.min()), high_x - low_x + 1, high_y - low_y + 1
    n_layers = int(layers.max()) - low + 1
    if ny * nx * n_layers * group_kernels.GROUP_KEYS > 2**63:
        return _keys(*_closed_up(columns, layers), normals)
    lows, sizes = (low_y, low_x, low), (nx, n_layers)
    keys: NDArray[np.uint64] = group_kernels.key_points(columns, layers, normals, lows, sizes)
    return keys


def _closed_up(
    columns: NDArray[np.int32], layers: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Columns and layers of the same groups in the same order, but without the empty space between them.

    Points thousands of kilometres apart have keys of 64 bits again; there is no need for that to be fast.
    """
    from maxcon.search.visit_kernels import SQUARE_VOXELS

    squares = columns.astype(np.int64) // SQUARE_VOXELS
    inside = columns - squares * SQUARE_VOXELS
    _, number = np.unique(squares[1] * 2**32 + squares[0], return_inverse=True)
    _, layer = np.unique(layers, return_inverse=True)
    return np.array([number * SQUARE_VOXELS + inside[0], inside[1]], np.int32), layer.astype(np.int32)


def _tiles_met(
    point_map: PointMap, prior: Pose, space: SearchSpace, boxes: NDArray[np.int64], radii: NDArray[np.float64]
) -> list[VoxelTile]:
    """Tiles that any group can fall in at any cell, from its box (4,) of voxels and its radius, m, at the prior."""
    from maxcon.search import group_kernels

    if not len(boxes):
        return []
    cell, largest_turn = point_map.cell, float(np.abs(space.headings).max())
    reaches = radii * largest_turn + (space.reach + cell)
    farthest = float((radii + reaches).max()) + 2.0 * cell  # a box may stick out of its circle by a cell
    near = np.array(point_map.keys_within(prior.x, prior.y, farthest), dtype=np.int64).reshape(-1, 2)
    is_met = group_kernels.meets_tiles(boxes, reaches, cell, point_map.tile_voxels * cell, near)
    return [point_map.tile((x, y)) for x, y in near[is_met].tolist()]
