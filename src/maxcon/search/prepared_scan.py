"""PreparedScan: a scan and the tiles of the map around it, prepared once for a search.

It answers three questions: the moments of all cells of some headings, the moments of single cells, and the most that
the matches of each cell of some headings can add up to along an axis.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, voxel_indices
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.voxel_table import VoxelTable
from maxcon.scan import Scan
from maxcon.search.accumulator import Multiplicity, Weighting, upright
from maxcon.search.objectives import Moments
from maxcon.search.space import SearchSpace

SQUARE_BITS = 4  # points of one height layer in a square of 2^4 x 2^4 voxels are a group: they visit the map together

# Bits that the y and x of a square, and a layer, take of the number by which points are sorted: 63 in all.
KEY_BITS = 18

# Headings whose cells are summed in one pass over the map share what is read of it; the sums of a pass take 32 MiB at
# most, unless those of one heading alone take more.
PASS_HEADINGS, PASS_CELLS = 16, 2**20

# Headings at which the turned scan is kept for more single cells; the oldest is dropped first.
MOST_HEADINGS_KEPT = 32

Headings = NDArray[np.int64]  # numbers of some headings of a search space, shape (h,)


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """An upright scan in groups of neighbouring points, and the tiles that it can fall in at any cell of a space.

    A group is the points of one layer in one square of voxels at the prior's heading: they fall in nearly the same
    voxels at any cell. Those with a normal come first in it. With weights of one normals are dropped.
    """

    point_map: PointMap
    prior: Pose
    space: SearchSpace
    points: NDArray[np.float64]  # (2, n), x and y from the sensor, not turned by any heading, m
    normals: NDArray[np.float64]  # (3, n), not turned by any heading
    starts: NDArray[np.int64]  # (groups + 1,), first point of each
    middles: NDArray[np.int64]  # (groups,), first point of each without a normal
    layers: NDArray[np.int64]  # (groups,), z voxel index
    tiles: dict[int, VoxelTile]  # by their slot in the grid
    corner: TileKey  # key of the first tile of the grid
    shape: tuple[int, int]  # of the grid, (ny, nx)
    cell: float  # the map's voxel edge, from which the space's may differ by rounding
    is_once: bool  # whether a voxel counts once
    without_normal: float  # weight of matches of points without a normal
    spread: NDArray[np.float64]  # (3,), sums of nx nx, nx ny and ny ny
    _at_heading: dict[int, tuple[NDArray[np.int32], NDArray[np.float32]]] = field(
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
        from maxcon.search import visit_kernels

        cell, aligned = point_map.cell, upright(scan, prior)
        heights = voxel_indices(aligned.points, cell)[:, 2]
        points, normals = (np.ascontiguousarray(each.T) for each in (aligned.points[:, :2], aligned.normals))
        spread = np.array([normals[0] @ normals[0], normals[0] @ normals[1], normals[1] @ normals[1]])
        if weighting is Weighting.ONE:
            normals = np.zeros_like(normals)
        distances = np.hypot(*points)
        farthest = float(distances.max(initial=0.0)) + space.reach + cell
        voxel_indices(prior.position + [[-farthest, -farthest, 0.0], [farthest, farthest, 0.0]], cell)

        turn = np.array([[np.cos(prior.heading), np.sin(prior.heading)]])
        columns = visit_kernels.turn_to_columns(points, turn, (prior.x, prior.y), cell)[0]
        order, starts, middles = _groups(columns, heights, (normals == 0.0).all(axis=0))
        firsts, columns = starts[:-1], columns[:, order]
        # How far a group can come to lie from its box at the prior, and which tiles it meets then.
        radii = np.maximum.reduceat(distances[order], firsts)
        reaches = radii * float(np.abs(space.headings).max()) + (space.reach + cell)
        around = float((radii + reaches).max(initial=0.0)) + 2.0 * cell  # a box sticks out by a cell
        edge = point_map.tile_voxels * cell
        low = np.floor((np.minimum.reduceat(columns, firsts, axis=1) * cell - reaches) / edge)
        high = np.floor(((np.maximum.reduceat(columns, firsts, axis=1) + 1) * cell + reaches) / edge)
        keys = [
            (x, y)
            for x, y in point_map.keys_within(prior.x, prior.y, around)
            if ((low[0] <= x) & (x <= high[0]) & (low[1] <= y) & (y <= high[1])).any()
        ]
        corner = min((x for x, _ in keys), default=0), min((y for _, y in keys), default=0)
        nx, ny = (1 + max((key[axis] - corner[axis] for key in keys), default=-1) for axis in (0, 1))
        tiles = {(y - corner[1]) * nx + x - corner[0]: point_map.tile((x, y)) for x, y in keys}
        return cls(
            point_map, prior, space, np.take(points, order, axis=1), np.take(normals, order, axis=1), starts, middles,
            heights[order][firsts].astype(np.int64), tiles, corner, (ny, nx), cell,
            multiplicity is Multiplicity.OCCUPIED, weighting.without_normal, spread,
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
            self, points=self.points.compress(adds, axis=1), normals=self.normals.compress(adds, axis=1), starts=starts,
            middles=starts[1:], layers=self.layers[sizes > 0],
        )  # fmt: skip

    def moments_of_headings(self, headings: Headings, n_threads: int = 1) -> NDArray[np.float64]:
        """Moments of all cells at some headings, shape (h, ny, nx, 4)."""
        _, ny, nx = self.space.shape
        moments = np.empty((len(headings), ny, nx, 4))
        most = min(PASS_HEADINGS, max(1, PASS_CELLS // (ny * nx)))
        n_rounds = -(-len(headings) // (most * n_threads))

        def sum_up(part: slice) -> None:
            self._sum_moments(headings[part], moments[part])

        in_threads(sum_up, len(headings), n_rounds * n_threads, n_threads)
        return moments

    def moments_of_cells(self, heading: int, cells: NDArray[np.int64]) -> Moments:
        """Moments of some cells (n, 3) of one heading, by number, without those of the cells around; shape (n, 4)."""
        from maxcon.search import cell_kernels, visit_kernels

        if heading not in self._at_heading:
            turns = self._turns(np.array([heading]))
            normals = visit_kernels.turn_normals(self.normals, turns)
            self._at_heading[heading] = self._columns(turns)[0], normals[0]
            if len(self._at_heading) > MOST_HEADINGS_KEPT:
                del self._at_heading[next(iter(self._at_heading))]
        _, ny, nx = self.space.shape
        offsets = np.column_stack([cells[:, 2] - nx // 2, cells[:, 1] - ny // 2])
        moments = np.zeros((len(cells), 4))
        cell_kernels.moments_of_cells(
            offsets, *self._at_heading[heading], *self._layers_of_tiles, self._edge_bits, self._table,
            self.without_normal, self.is_once, self.point_map.is_signed, moments,
        )  # fmt: skip
        return moments

    def largest_sums(
        self,
        headings: Headings,
        weight: float | None,
        axis: tuple[np.float32, np.float32],
        least: float,
        unit: float,
        n_threads: int = 1,
    ) -> NDArray[np.signedinteger]:
        """Upper limits of the sums of each cell at some headings, in whole units (powers of two), shape (h, ny, nx).

        A match adds its weight (that of normals if None) times (n . u)^2 along the axis u, or its weight if that is
        zeros, rounded up. The sums lack voxels whose (n . u)^2, times how often they count, is no more than `least`.
        """
        from maxcon.search import window_kernels
        from maxcon.search.visit_kernels import RIM

        _, ny, nx = self.space.shape
        width = nx + 2 * RIM
        sums = np.zeros((len(headings), ny + 2 * RIM, width), np.int32 if self.is_once else np.int64)

        normals = np.ascontiguousarray(self.normals.T, dtype=np.float32)

        def sum_up(part: slice) -> None:
            turns = self._turns(headings[part])
            columns = self._columns(turns)
            bases = window_kernels.bases_of_points(columns, width, sums[0].size)
            for stops, runs, voxels in self._stops(columns):
                window_kernels.sum_tile(
                    stops, runs, voxels, bases, normals, turns.astype(np.float32),
                    self.without_normal if weight is None else weight, weight is not None, self.point_map.is_signed,
                    axis, self._window, width, np.float32(least), np.float32(1.0 / unit), sums[part].reshape(-1),
                )  # fmt: skip

        in_threads(sum_up, len(headings), n_threads, n_threads)
        return sums[:, RIM:-RIM, RIM:-RIM]

    def _sum_moments(self, headings: Headings, moments: NDArray[np.float64]) -> None:
        """Write the moments at a few headings in one pass over the map, shape (h, ny, nx, 4)."""
        from maxcon.search import visit_kernels, window_kernels
        from maxcon.search.visit_kernels import RIM

        _, ny, nx = self.space.shape
        turns = self._turns(headings)
        columns, normals = self._columns(turns), visit_kernels.turn_normals(self.normals, turns)
        width = nx + 2 * RIM
        width += (2 - width) % 4  # an odd number of cache lines: a cell and the one above share no cache set
        sums = _aligned_zeros((len(headings), ny + 2 * RIM, width, 4))
        for stops, runs, voxels in self._stops(columns):
            window_kernels.accumulate_tile(
                stops, runs, voxels, columns, normals, self._window, width, self.without_normal,
                self.point_map.is_signed, sums.reshape(len(headings), -1),
            )  # fmt: skip
        moments[...] = sums[:, RIM : RIM + ny, RIM : RIM + nx]

    def _turns(self, headings: Headings) -> NDArray[np.float64]:
        """Cosine and sine of some headings in the map's axes, shape (h, 2), one by one as in `accumulator.turn`."""
        azimuths = self.prior.heading + self.space.headings[headings]
        return np.array([(np.cos(azimuth), np.sin(azimuth)) for azimuth in azimuths])

    def _columns(self, turns: NDArray[np.float64]) -> NDArray[np.int32]:
        """Voxel (x, y) of each point at h headings, shape (h, 2, n)."""
        from maxcon.search import visit_kernels

        place = self.prior.x, self.prior.y
        columns: NDArray[np.int32] = visit_kernels.turn_to_columns(self.points, turns, place, self.cell)
        return columns

    def _stops(
        self, columns: NDArray[np.int32]
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], tuple[Any, ...]]]:
        """Yield stops and runs in each tile at the cells of some headings (`visit_kernels`), and the `TileVoxels`."""
        from maxcon.search import visit_kernels

        visits = visit_kernels.plan_visits(self.starts, columns)
        firsts, numbers, rectangles = visit_kernels.visits_of_tiles(
            visits, self._window, self._edge_bits, self.corner, self.shape
        )
        for slot, tile in self.tiles.items():
            mine = slice(firsts[slot], firsts[slot + 1])
            stops, runs = visit_kernels.stops_in_tile(
                visits, numbers[mine], rectangles[mine], self.starts, self.middles, self.layers,
                int(tile.index.layers[0]) if len(tile.index.layers) else 0, tile.layer_numbers,
                tile.index.patch_starts, tile.n_patches,
            )  # fmt: skip
            counts = tile.counts[:0] if self.is_once else tile.counts
            yield stops, runs, (tile.corner, tile.columns, tile.normals, counts)

    @cached_property
    def _window(self) -> tuple[int, int, int, int]:
        """First and last offset of a cell in x and in y, in voxels, both included."""
        _, ny, nx = self.space.shape
        return -(nx // 2), nx - 1 - nx // 2, -(ny // 2), ny - 1 - ny // 2

    @property
    def _edge_bits(self) -> int:
        """A tile has 2^edge_bits voxels along an edge."""
        return self.point_map.tile_voxels.bit_length() - 1

    @cached_property
    def _table(self) -> VoxelTable:
        """The tiles, as single points are looked up in them."""
        return self.point_map.table_of(tile.key for tile in self.tiles.values())

    @cached_property
    def _layers_of_tiles(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Number of each point's layer in the scan, (n,); of these in each tile, (t, m), one too high for none."""
        (rows, grid, corner), (layers, ranks) = self._table[:3], np.unique(self.layers, return_inverse=True)
        numbers = np.zeros((len(rows), len(layers)), np.int32)
        for tile in self.tiles.values():
            own = tile.index.layers
            x, y = tile.key - corner
            numbers[grid[y, x]] = np.where(np.isin(layers, own), np.searchsorted(own, layers), len(own))
        return np.repeat(ranks, np.diff(self.starts)).astype(np.int32), numbers


def _groups(
    columns: NDArray[np.int32], layers: NDArray[np.int32], is_bare: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Order points, (2, n), into groups of one square and layer, those with a normal first; `starts` and `middles`."""
    inside = 2**SQUARE_BITS - 1
    parts = np.stack([columns[1] >> SQUARE_BITS, columns[0] >> SQUARE_BITS, layers])
    keys = np.zeros(columns.shape[1], np.int64)
    for part in parts:  # places repeat after 2^18 squares or layers: a group in two parts is two groups
        keys = keys << KEY_BITS | (part & (1 << KEY_BITS) - 1)
    for part, bits in ((is_bare, 1), (columns[1] & inside, SQUARE_BITS), (columns[0] & inside, SQUARE_BITS)):
        keys = keys << bits | part
    order = np.argsort(keys)
    parts = parts[:, order]
    is_first = np.append(True, (parts[:, 1:] != parts[:, :-1]).any(axis=0))[: len(order)]
    starts = np.append(np.flatnonzero(is_first), len(order))
    return order, starts, starts[1:] - np.add.reduceat(is_bare[order].astype(np.int64), starts[:-1])


def in_threads(do: Callable[[slice], None], n: int, n_parts: int, n_threads: int) -> None:
    """Call a function with each of the parts of n items, at most so many of them at a time."""
    edges = np.linspace(0, n, min(n, n_parts) + 1).astype(int).tolist()
    parts = [slice(*each) for each in pairwise(edges)]
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
