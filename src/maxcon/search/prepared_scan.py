# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PreparedScan: a scan and the tiles of the map around it, prepared once for a search.

It answers three questions: the moments of all cells of a window, the moments of single cells, and the most that the
matches of each cell of a window can add up to along an axis.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices, voxel_indices
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.tile import VoxelTable
from maxcon.scan import Scan
from maxcon.search.accumulator import Multiplicity, Weighting
from maxcon.search.objectives import Moments
from maxcon.search.space import SearchSpace, Window

# Headings whose cells are summed in one pass over the map share what is read of it; the sums of a pass take 32 MiB at
# most, unless those of one heading alone take more.
PASS_HEADINGS, PASS_CELLS = 16, 2**20

# Headings at which the turned scan is kept for more single cells; the oldest is dropped first.
MOST_HEADINGS_KEPT = 32

Headings = NDArray[np.int64]
"""Numbers of some headings of a search space, shape (h,)."""


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """An upright scan in groups of neighbouring points, and the tiles that it can fall in at any cell of a space.

    Points of one height layer in one square of SQUARE_VOXELS voxels, at the prior's heading, are a group.
    Those with a normal come first in it, those in one voxel follow each other; neighbouring groups read the
    same voxels. With weights of one normals are dropped here: all points take `without_normal`.

    point_map: the map.
    prior: T_map_sensor before localization, local frame of the map.
    space: the cells, around the prior.
    points: shape (2, n); x and y of each point of the upright scan, from the sensor, m.
    normals: shape (3, n); normals of the points of the upright scan, not turned by any heading.
    starts, middles: shape (groups + 1,) and (groups,); first point of each group, and its first without a normal.
    ranks: shape (groups,); rank of each group's height layer among the layers of the scan.
    tiles: tiles by their slot in the grid, with the layer each rank has in the tile (-1 for none).
    corner, shape: key (x, y) of the first tile of the grid that covers the tiles, and its size (ny, nx).
    edge: voxels along an edge of a tile.
    cell: voxel edge of the map, m: that of the space may differ from it by rounding.
    is_once, is_signed: whether a voxel counts once, and whether the map's normals have a side.
    without_normal: weight of the matches of points without a normal.
    spread: shape (3,); sums of nx nx, nx ny and ny ny over all normals of the upright scan, not turned by any heading:
        from them follows which axis is probably determined least, before anything is scored.
    """

    point_map: PointMap
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
    _at_heading: dict[int, tuple[NDArray[np.uint64], NDArray[np.float32]]] = field(
        default_factory=dict, init=False, repr=False
    )

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
        """Set a scan upright, sort its points into groups and find the tiles in reach."""
        from maxcon.search import group_kernels

        cell, rotation = point_map.cell, rotation_matrices(prior.roll, prior.pitch, 0.0)
        turn = np.array([[np.cos(prior.heading), np.sin(prior.heading)]])
        groups = group_kernels.group_scan(
            scan.points, scan.normals, np.ascontiguousarray(rotation), prior.z, weighting is not Weighting.ONE, turn,
            (prior.x, prior.y), cell,
        )  # fmt: skip
        farthest = float(groups.radii.max(initial=0.0)) + space.reach + cell
        voxel_indices(groups.extent, cell)
        voxel_indices(prior.position + [[-farthest, -farthest, 0.0], [farthest, farthest, 0.0]], cell)

        # How far a group can come to lie from its box at the prior, and which tiles it meets then.
        reaches = groups.radii * float(np.abs(space.headings).max()) + (space.reach + cell)
        around = float((groups.radii + reaches).max(initial=0.0)) + 2.0 * cell  # a box sticks out by a cell
        keys = np.array(point_map.keys_within(prior.x, prior.y, around), dtype=np.int64).reshape(-1, 2)
        tile_edge = point_map.tile_voxels * cell
        keys = keys[group_kernels.meets_tiles(groups.boxes, reaches, cell, tile_edge, keys)]
        corner = keys.min(axis=0, initial=2**31)
        nx, ny = keys.max(axis=0, initial=-(2**31)) - corner + 1 if len(keys) else (0, 0)
        tiles = {}
        for x, y in keys.tolist():
            tile = point_map.tile((x, y))
            layers = group_kernels.number_layers(tile.index.layers, groups.layers)
            tiles[int((y - corner[1]) * nx + x - corner[0])] = tile, layers
        return cls(
            point_map, prior, space, groups.points, groups.normals, groups.starts, groups.middles, groups.ranks, tiles,
            (int(corner[0]), int(corner[1])), (int(ny), int(nx)), point_map.tile_voxels, cell,
            multiplicity is Multiplicity.OCCUPIED, point_map.is_signed, weighting.without_normal, groups.spread,
        )  # fmt: skip

    @property
    def n_points(self) -> int:
        """How many points there are."""
        return int(self.points.shape[1])

    @property
    def matches_nothing(self) -> bool:
        """Whether there is no point, or no tile in reach: then all cells are alike."""
        return not (self.n_points and self.tiles)

    def constraining(self) -> "PreparedScan":
        """The same with only those points that add to N; the others are just counted."""
        if self.without_normal > 0.0:
            return self
        adds = self.normals.any(axis=0)
        sizes = self.middles - self.starts[:-1]
        starts = np.append(0, np.cumsum(sizes[sizes > 0]))
        return replace(
            self,
            points=self.points.compress(adds, axis=1),
            normals=self.normals.compress(adds, axis=1),
            starts=starts,
            middles=starts[1:],
            ranks=self.ranks[sizes > 0],
        )

    def moments_of_window(self, headings: Headings, window: Window, n_threads: int = 1) -> NDArray[np.float64]:
        """Moments of all cells of a window at some headings, shape (h, ny, nx, 4)."""
        moments = np.empty((len(headings), *window.shape, 4))
        most = min(PASS_HEADINGS, max(1, PASS_CELLS // math.prod(window.shape)))
        n_rounds = -(-len(headings) // (most * n_threads))
        parts = np.array_split(np.arange(len(headings)), min(len(headings), n_rounds * n_threads))

        def sum_up(part: NDArray[np.int64]) -> None:
            self._sum_moments(headings[part], window, moments[part[0] : part[-1] + 1])

        _in_threads(sum_up, parts, n_threads)
        return moments

    def moments_of_cells(self, heading: int, cells: NDArray[np.int64]) -> Moments:
        """Moments of some cells (n, 3) of one heading, by number, without those of the cells around; shape (n, 4)."""
        from maxcon.search import cell_kernels

        if heading not in self._at_heading:
            self._at_heading[heading] = cell_kernels.points_at_heading(
                self.points, self.normals, self._turns(np.array([heading])), (self.prior.x, self.prior.y), self.cell,
                self.without_normal,
            )  # fmt: skip
            if len(self._at_heading) > MOST_HEADINGS_KEPT:
                del self._at_heading[next(iter(self._at_heading))]
        voxels, normals = self._at_heading[heading]
        _, ny, nx = self.space.shape
        offsets = np.column_stack([cells[:, 2] - nx // 2, cells[:, 1] - ny // 2])
        moments = np.zeros((len(cells), 4))
        cell_kernels.moments_of_cells(
            offsets, voxels, normals, self._layers, self._layers_of_tiles, self.edge.bit_length() - 1, self._table,
            self.is_once, self.is_signed, moments,
        )  # fmt: skip
        return moments

    def largest_sums(
        self,
        headings: Headings,
        window: Window,
        weighed_normals: NDArray[np.float32],
        axis: tuple[np.float32, np.float32],
        least: float,
        unit: float,
        n_threads: int = 1,
    ) -> NDArray[np.signedinteger]:
        """Upper limits of the sums over the matches of each cell of a window, in whole units, shape (h, ny, nx).

        headings: shape (h,); numbers of the headings.
        window: the cells.
        weighed_normals: shape (n, 4), float32; normal of each point, zeros for none, and what is added to the weight of
            its matches.
        axis: a match adds its weight times (n . u)^2 along this unit vector u; or its weight, where that is zeros.
        least: voxels whose (n . u)^2, times how often the voxel counts, is no more than this are left out: the sums
            lack what they add.
        unit: what each match adds is rounded up to a multiple of this, a power of two.
        n_threads: headings are shared out among that many threads; the sums do not depend on it.
        """
        from maxcon.search import window_kernels
        from maxcon.search.visit_kernels import RIM

        turns = self._turns(headings)
        columns, visits = self._turned(turns)
        height, width = (n_cells + 2 * RIM for n_cells in window.shape)
        sums = np.zeros((len(headings), height, width), np.int32 if self.is_once else np.int64)
        bases = window_kernels.bases_of_points(columns, width, height * width)

        def vote(part: NDArray[np.int64]) -> None:
            for stops, runs, voxels in self._stops(visits, window):
                window_kernels.sum_tile(
                    stops, runs, voxels, bases, weighed_normals, turns.astype(np.float32),
                    (int(part[0]), int(part[-1]) + 1), axis, tuple(window), width, self.is_signed,
                    np.float32(least), np.float32(1.0 / unit), sums.reshape(-1),
                )  # fmt: skip

        _in_threads(vote, np.array_split(np.arange(len(headings)), min(n_threads, len(headings))), n_threads)
        return sums[:, RIM:-RIM, RIM:-RIM]

    def _sum_moments(self, headings: Headings, window: Window, moments: NDArray[np.float64]) -> None:
        """Write the moments of a window at a few headings in one pass over the map, shape (h, ny, nx, 4)."""
        from maxcon.search import group_kernels, window_kernels
        from maxcon.search.visit_kernels import RIM

        turns, (ny, nx) = self._turns(headings), window.shape
        columns, visits = self._turned(turns)
        normals = group_kernels.turn_normals(self.normals, turns)
        width = nx + 2 * RIM
        width += (2 - width) % 4  # an odd number of cache lines: a cell and the one above share no cache set
        sums = _aligned_zeros((len(headings), ny + 2 * RIM, width, 4))
        for stops, runs, voxels in self._stops(visits, window):
            window_kernels.accumulate_tile(
                stops, runs, voxels, columns, normals, tuple(window), width, self.without_normal, self.is_signed,
                sums.reshape(len(headings), -1),
            )  # fmt: skip
        moments[...] = sums[:, RIM : RIM + ny, RIM : RIM + nx]

    def _turns(self, headings: Headings) -> NDArray[np.float64]:
        """Cosine and sine of some headings in the map's axes, shape (h, 2), one by one as in `accumulator.turn`."""
        azimuths = self.prior.heading + self.space.headings[headings]
        return np.array([(np.cos(azimuth), np.sin(azimuth)) for azimuth in azimuths])

    def _turned(self, turns: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Voxel (x, y) of each point at h headings, shape (h, 2, n), and the visits of the groups (`plan_visits`)."""
        from maxcon.search import group_kernels, visit_kernels

        columns = group_kernels.turn_to_columns(self.points, turns, (self.prior.x, self.prior.y), self.cell)
        return columns, visit_kernels.plan_visits(self.starts, columns)

    def _stops(
        self, visits: NDArray[np.int64], window: Window
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], tuple[Any, ...]]]:
        """Yield stops and runs in each tile at the offsets of a window (`visit_kernels`), and the `TileVoxels`."""
        from maxcon.search import visit_kernels

        firsts, numbers, rectangles = visit_kernels.visits_of_tiles(
            visits, tuple(window), self.edge.bit_length() - 1, self.corner, self.shape
        )
        for slot, (tile, layers) in self.tiles.items():
            mine = slice(firsts[slot], firsts[slot + 1])
            stops, runs = visit_kernels.stops_in_tile(
                visits, numbers[mine], rectangles[mine], self.starts, self.middles, self.ranks, layers,
                tile.index.patch_starts, tile.n_patches,
            )  # fmt: skip
            counts = tile.counts[:0] if self.is_once else tile.counts
            yield stops, runs, (tile.corner, tile.columns, tile.normals, counts)

    @cached_property
    def _table(self) -> VoxelTable:
        """The tiles, as single points are looked up in them."""
        return self.point_map.table_of(tile.key for tile, _ in self.tiles.values())

    @cached_property
    def _layers_of_tiles(self) -> NDArray[np.int32]:
        """Layer of each row of the table that each layer of the scan has, one too high where it has none."""
        (rows, grid, corner), n_layers = self._table[:3], int(self.ranks.max(initial=0)) + 1
        numbers = np.zeros((len(rows), n_layers), np.int32)
        for tile, layers in self.tiles.values():
            x, y = tile.key - corner
            numbers[grid[y, x]] = np.where(layers < 0, len(tile.index.layers), layers)[:n_layers]
        return numbers

    @cached_property
    def _layers(self) -> NDArray[np.int32]:
        """Number of each point's height layer among those of the scan, shape (n,)."""
        return np.repeat(self.ranks, np.diff(self.starts)).astype(np.int32)


def _in_threads(do: Callable[[NDArray[np.int64]], None], parts: list[NDArray[np.int64]], n_threads: int) -> None:
    """Call a function with each part, at most so many of them at a time."""
    if n_threads == 1 or len(parts) == 1:
        for part in parts:
            do(part)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(do, parts))


def _aligned_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin with a cache line, of which a cell of four takes one half then, and never two."""
    size = math.prod(shape)
    zeros = np.zeros(size + 7)
    skipped = -zeros.ctypes.data % 64 // 8
    return zeros[skipped : skipped + size].reshape(shape)
