# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PreparedScan: the points of a scan grouped by height layer and voxel square, and the tiles of the map in reach."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices, voxel_indices
from maxcon.options import Multiplicity, Weighting
from maxcon.point_map import PointMap, TileKey, VoxelTile
from maxcon.scan import Scan
from maxcon.search.window import Window
from maxcon.search_space import SearchSpace

if TYPE_CHECKING:
    from maxcon.search.visit_kernels import Met, Planned, TileVoxels

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

        cell, rotation = point_map.cell, rotation_matrices(prior.roll, prior.pitch, 0.0)
        points, normals = group_kernels.level(
            scan.points, scan.normals, np.ascontiguousarray(rotation), prior.z
        )
        _check_indices(points, prior, space.reach, cell)
        nx, ny, _ = normals
        spread = np.array([nx @ nx, nx @ ny, ny @ ny])
        if weighting is Weighting.ONE:
            normals[:] = 0.0
        turn = _turns(np.array([prior.heading]))
        groups = group_kernels.group_points(points, normals, turn, (prior.x, prior.y), cell)
        tiles = _tiles_met(point_map, prior, space, groups.boxes, groups.radii)
        keys = np.array([tile.key for tile in tiles], dtype=np.int64).reshape(-1, 2)
        corner = keys.min(axis=0, initial=2**31)
        nx, ny = keys.max(axis=0, initial=-(2**31)) - corner + 1 if tiles else (0, 0)
        slots = (keys[:, 1] - corner[1]) * nx + keys[:, 0] - corner[0]
        return cls(
            prior,
            space,
            groups.points,
            groups.normals,
            groups.starts,
            groups.middles,
            groups.ranks,
            {
                slot: (tile, group_kernels.number_layers(tile.index.layers, groups.layers))
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

    @property
    def matches_nothing(self) -> bool:
        """Whether there is no point, or no tile in reach: then all cells are alike."""
        return not (self.n_points and self.tiles)

    def turns(self, headings: NDArray[np.int64]) -> NDArray[np.float64]:
        """Cosine and sine of some headings, by number, in the map's axes, shape (h, 2)."""
        return _turns(self.prior.heading + self.space.headings[headings])

    def turned(self, headings: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Voxel columns (h, 2, n) and normals (h, 3, n) of the points at h headings, by number, in the map's axes."""
        from maxcon.search import visit_kernels

        turns, place = self.turns(headings), (self.prior.x, self.prior.y)
        columns = visit_kernels.turn_to_columns(self.points, turns, place, self.cell)
        return columns, visit_kernels.turn_normals(self.normals, turns)

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

        turns, place = self.turns(headings), (self.prior.x, self.prior.y)
        columns: NDArray[np.int32] = visit_kernels.turn_to_columns(self.points, turns, place, self.cell)
        return columns

    def planned(self, columns: NDArray[np.int32]) -> "Planned":
        """Plan the visits of the groups to the map, from their voxels (h, 2, n) at h headings."""
        from maxcon.search import visit_kernels

        visits = visit_kernels.plan_visits(self.starts, columns)
        return visit_kernels.Planned(visits, self.starts, self.middles, self.ranks)

    def visited(self, planned: "Planned", window: Window) -> Iterator[tuple["Met", "TileVoxels"]]:
        """Yield, for each tile, the visits that meet it at some offset of a window, and its voxels."""
        from maxcon.search import visit_kernels

        starts, numbers, rectangles = visit_kernels.visits_of_tiles(
            planned.visits, tuple(window), self.edge.bit_length() - 1, self.corner, self.shape
        )
        for slot, (tile, layers) in self.tiles.items():
            mine = slice(starts[slot], starts[slot + 1])
            counts = tile.counts[:0] if self.is_once else tile.counts
            yield (
                visit_kernels.Met(numbers[mine], rectangles[mine], layers),
                visit_kernels.TileVoxels(
                    tile.corner, tile.edge, tile.index.patch_starts, tile.columns, tile.normals, counts
                ),
            )


def _turns(azimuths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cosine and sine of headings, shape (h, 2), one by one as `matching.turn` asks for them."""
    return np.array([(np.cos(azimuth), np.sin(azimuth)) for azimuth in azimuths])


def _check_indices(points: NDArray[np.float64], prior: Pose, reach: float, cell: float) -> None:
    """Refuse points, (3, n), or a prior, so far out that voxels within reach of them have no index."""
    extremes = np.array([points.min(axis=1, initial=0.0), points.max(axis=1, initial=0.0)])
    voxel_indices(extremes, cell)
    squares = points[0] * points[0]
    squares += points[1] * points[1]
    reach += float(np.sqrt(squares.max(initial=0.0))) + cell
    voxel_indices(prior.position + [[-reach, -reach, 0.0], [reach, reach, 0.0]], cell)


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
