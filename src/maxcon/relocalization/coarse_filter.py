"""The coarse filter: large cells of a whole map that match nearly as many points as the best one, by branch and bound.

A point matches where the voxel that it falls in has its orientation bin; the scanner is in the middle of a cell.
`recount` counts around the cells that are left in cells half as large.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, wrap_angle
from maxcon.map import TileKey
from maxcon.relocalization import kernels
from maxcon.relocalization.coarse_map import ANY_BIN, BIN_WIDTH, HIGHEST, N_BINS, REACH, Circle, CoarseMap, blocks_of
from maxcon.relocalization.kernels import BLOCK, N_BLOCKS, REGION
from maxcon.scan import Scan
from maxcon.search.accumulator import upright

STEP_DEG = 2.0
HEADINGS = np.radians(np.arange(-180.0, 180.0, STEP_DEG))  # that are tried, rad
HALF_HEADINGS = np.radians(np.arange(-180.0, 180.0, 0.5 * STEP_DEG))
LOWEST = 0.4  # m above the scan's ground: lower points do not take part, as they may be the ground itself
LEAST_HORIZONTAL = 0.5  # a point has an orientation bin where its normal is within 60 degrees of horizontal
FIRST_SPLIT, MOST_SPLIT = 256, 2**16  # squares split at a time: few at first, as a good count rules out most others
MOST_KEPT = 2**15  # cells at most, the highest: more than all those of the places that are followed afterwards
PARTS = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1]])  # the four parts of a square, (heading, y, x)
# `recount`: squares of 2 x 2 cells around the middle of a large cell, (heading, y, x), and their cells in index order.
SQUARES = np.array(list(product(range(-2, 3), (-1, 1), (-1, 1))))
IN_ORDER = np.lexsort((SQUARES[:, None] + PARTS).reshape(-1, 3).T[::-1])

Nodes = NDArray[np.int64]  # cells or squares (m, 3): heading, first cell (y, x)
Counts = NDArray[np.int64]


class TurnedScan(NamedTuple):
    """Points of a scan at some headings, in voxels."""

    layers: NDArray[np.int64]  # (n,): height of each point above the ground
    columns: NDArray[np.int32]  # (h, n, 2): (x, y) from the cell in whose middle the scanner stands to the point's
    bins: NDArray[np.uint8]  # (h, n): number of the bit of its orientation, which a voxel must have to match


@dataclass(frozen=True, slots=True, eq=False)
class CoarseScan:
    """Points of a scan that take part, with roll and pitch applied, from the ground up."""

    points: NDArray[np.float64]  # (n, 3): x and y about the scanner, z above the ground, m
    normals: NDArray[np.float64]  # (n, 3): same axes, zeros for none

    @classmethod
    def of(cls, scan: Scan, T_ground_sensor: Pose) -> "CoarseScan":
        """Align a scan with its ground plane, the lowest points first; not those far off, or on the ground."""
        aligned = upright(scan, T_ground_sensor)
        points = aligned.points
        away = np.hypot(points[:, 0], points[:, 1])
        takes_part = (points[:, 2] >= LOWEST) & (points[:, 2] < HIGHEST) & (away < REACH)
        order = np.argsort(points[takes_part, 2], kind="stable")
        return cls(points[takes_part][order], aligned.normals[takes_part][order])

    def __len__(self) -> int:
        return len(self.points)

    def turned(self, headings: NDArray[np.float64], cell: float) -> TurnedScan:
        """Voxels (edge `cell`, m) of the points at headings (h,), rad, of a scanner in the middle of a cell."""
        cosines = np.array([math.cos(heading) for heading in headings.tolist()])[:, None]
        sines = np.array([math.sin(heading) for heading in headings.tolist()])[:, None]
        x, y, z = self.points.T
        turned = np.stack([x * cosines - y * sines, x * sines + y * cosines], axis=2)
        columns = np.floor(turned / cell + 0.5).astype(np.int32)
        # A point whose normal is not nearly horizontal matches any voxel.
        is_upright = np.hypot(self.normals[:, 0], self.normals[:, 1]) > LEAST_HORIZONTAL
        azimuths = np.arctan2(self.normals[:, 1], self.normals[:, 0])
        bins = np.floor((azimuths + headings[:, None]) / BIN_WIDTH + 0.5).astype(np.int64) % N_BINS
        bins = np.where(is_upright, bins, ANY_BIN)
        return TurnedScan(np.floor(z / cell).astype(np.int64), columns, bins.astype(np.uint8))


@dataclass(frozen=True, eq=False)
class Regions:
    """The regions of a map that are searched: in an area, if there is one, as far as a scanner may stand there."""

    map: CoarseMap
    area: Circle | None = None

    @cached_property
    def allowed(self) -> dict[TileKey, NDArray[np.bool_]]:
        """Whether a scanner may stand in each cell of each region where it may in any: see `CoarseMap.allowed`."""
        return self.map.allowed(self.area)

    @cached_property
    def n_cells(self) -> int:
        """Cells, of all headings, in which a scanner may stand."""
        return sum(int(each.sum()) for each in self.allowed.values()) * len(HEADINGS)


@dataclass(frozen=True, slots=True, eq=False)
class CountedCells:
    """Cells in which a scan may have been taken, the highest count first."""

    cells: Nodes  # (n, 3): (heading, y, x): number of the heading, index of the cell in the local frame
    counts: Counts  # (n,): points that match there
    left_out: float  # ratio to the highest count that none of the other cells reaches
    headings: NDArray[np.float64]  # (h,): rad
    edge: float  # of a cell, m

    @classmethod
    def sorted(cls, cells: Nodes, counts: Counts, left_out: float, edge: float) -> "CountedCells":
        """Put large cells in order: the first in index order where counts are the same."""
        order = in_order(cells, counts)
        return cls(cells[order], counts[order], left_out, HEADINGS, edge)

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Middles of the cells, shape (n, 3): x, y (local frame, m) and heading (rad)."""
        return np.column_stack([(self.cells[:, [2, 1]] + 0.5) * self.edge, self.headings[self.cells[:, 0]]])

    def reaching(self, ratio: float) -> "CountedCells":
        """Those that reach a ratio of the highest count."""
        kept = self.counts >= ratio * self.counts.max(initial=0)
        left_out = max(self.left_out, ratio)
        return replace(self, cells=self.cells[kept], counts=self.counts[kept], left_out=left_out)

    def distinct(self, same: float, same_turn: float, most: int) -> "CountedCells":
        """One of each place, the first of those within `same` (m) and `same_turn` (rad); at most `most`."""
        kept: list[int] = []
        poses, left_out, is_left = self.poses, self.left_out, np.ones(len(self), bool)
        for number in range(len(self)):
            if not is_left[number]:
                continue
            if len(kept) == most:
                left_out = max(left_out, float(self.counts[number] / self.counts[0]))
                break
            kept.append(number)
            x, y, heading = poses[number]
            near = number + np.flatnonzero(np.hypot(poses[number:, 0] - x, poses[number:, 1] - y) <= same)
            is_left[near[np.abs(wrap_angle(poses[near, 2] - heading)) <= same_turn]] = False
        return replace(self, cells=self.cells[kept], counts=self.counts[kept], left_out=left_out)


def in_order(cells: Nodes, counts: Counts) -> NDArray[np.intp]:
    """Order of cells, the highest count first, then by their indices."""
    return np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], -counts))


def counts_of_region(scan: CoarseScan, regions: Regions, key: TileKey) -> NDArray[np.int32]:
    """Points that match at each heading and cell (y, x) of a region; -1 in cells in which no scanner may stand."""
    turned, voxels = scan.turned(HEADINGS, regions.map.cell), regions.map.region(key).bins
    counts = np.zeros((len(HEADINGS), REGION, REGION), np.int32)
    for heading in range(len(HEADINGS)):
        columns = turned.columns[heading] + regions.map.margin
        for layer, (x, y), bit in zip(turned.layers, columns, turned.bins[heading], strict=True):
            counts[heading] += (voxels[layer, y : y + REGION, x : x + REGION] & (1 << int(bit))) != 0
    counts[:, ~regions.allowed[key]] = -1
    return counts


def count_all(scan: CoarseScan, regions: Regions, ratio: float, fewest: float = 1.0) -> CountedCells:
    """Find every cell whose count reaches `fewest` and a ratio of the highest one: each at every heading is counted."""
    counts = {key: counts_of_region(scan, regions, key) for key in regions.allowed}
    best = max((int(each.max()) for each in counts.values()), default=0)
    cells, scores = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    if best > 0:
        for (key_x, key_y), each in counts.items():
            reaching = np.argwhere(each >= max(ratio * best, fewest))
            cells.append(reaching + np.array([0, key_y * REGION, key_x * REGION]))
            scores.append(each[tuple(reaching.T)].astype(np.int64))
    left_out = max(ratio, fewest / best) if best >= fewest else ratio
    return CountedCells.sorted(np.concatenate(cells), np.concatenate(scores), left_out, regions.map.cell)


def filter_cells(
    scan: CoarseScan, regions: Regions, ratio: float, fewest: float = 1.0, *, n_threads: int = 1
) -> CountedCells:
    """Find every cell whose count reaches `fewest` and a ratio of the highest one, at most `MOST_KEPT` of them.

    The bound of a block of 4 x 4 cells counts points that match at any of them. Blocks that may reach the ratio of the
    best count so far are split into squares, the highest bound first, and these into cells. Threads share headings and
    squares, and do not change what is found (D8).
    """
    with ThreadPoolExecutor(n_threads) as pool:
        search = _Filter(regions, scan.turned(HEADINGS, regions.map.cell), ratio, fewest, pool, n_threads)
        blocks = {}
        for key in regions.allowed:
            nodes, bounds = search.blocks(key)
            search.split(key, nodes[:FIRST_SPLIT], bounds[:FIRST_SPLIT])
            blocks[key] = nodes[FIRST_SPLIT:], bounds[FIRST_SPLIT:]
        for key in sorted(blocks, key=lambda key: (-blocks[key][1].max(initial=0), key)):
            search.split(key, *search.open(*blocks.pop(key)))
    search.drop()
    left_out = max(ratio, max(search.dropped, fewest) / search.best) if search.best >= fewest else ratio
    return CountedCells.sorted(search.cells[0], search.counts[0], left_out, regions.map.cell)


@dataclass(eq=False)
class _Filter:
    """Cells found so far, the best count, and the highest count that was dropped for lack of room."""

    regions: Regions
    turned: TurnedScan
    ratio: float
    fewest: float
    pool: ThreadPoolExecutor
    n_threads: int
    best: int = 0
    dropped: int = 0
    cells: list[Nodes] = field(default_factory=lambda: [np.empty((0, 3), np.int64)])
    counts: list[Counts] = field(default_factory=lambda: [np.empty(0, np.int64)])

    @property
    def least(self) -> float:
        """Least count of a cell to be kept."""
        return max(self.ratio * self.best, self.fewest, self.dropped)

    def drop(self) -> None:
        """Drop cells of too low counts, and the lowest for which there is no room."""
        cells, counts = np.concatenate(self.cells), np.concatenate(self.counts)
        reaches = counts >= max(self.ratio * self.best, self.fewest)
        cells, counts = cells[reaches], counts[reaches]
        if len(counts) > MOST_KEPT:
            order = in_order(cells, counts)
            self.dropped = max(self.dropped, int(counts[order[MOST_KEPT]]))
            cells, counts = cells[order[:MOST_KEPT]], counts[order[:MOST_KEPT]]
        self.cells, self.counts = [cells], [counts]

    def blocks(self, key: TileKey) -> tuple[Nodes, Counts]:
        """Blocks of a region that may hold cells to be kept, the highest bound first, and their bounds."""
        bounds = np.zeros((len(HEADINGS), N_BLOCKS, N_BLOCKS), np.uint16)
        blocks, rows = self.regions.map.region(key).blocks, blocks_of(self.regions.allowed[key])
        least, (layers, columns, bins), margin = math.ceil(self.least), self.turned, self.regions.map.margin

        def bound(some: NDArray[np.int64]) -> None:
            part = slice(int(some[0]), int(some[-1]) + 1)
            kernels.bound_blocks(blocks, layers, columns[part], bins[part], rows, margin, least, bounds[part])

        n_parts = min(self.n_threads, len(HEADINGS))
        list(self.pool.map(bound, np.array_split(np.arange(len(HEADINGS)), n_parts)))
        nodes = np.argwhere(bounds)
        found = bounds[tuple(nodes.T)].astype(np.int64)
        order = np.argsort(-found, kind="stable")
        return nodes[order] * np.array([1, BLOCK, BLOCK]), found[order]

    def split(self, key: TileKey, nodes: Nodes, bounds: Counts) -> None:
        """Split blocks of a region, the highest bounds first, and keep the cells that may reach the ratio."""
        region, is_allowed, at_once, place = self.regions.map.region(key), self.regions.allowed[key], FIRST_SPLIT, 0
        while place < len(nodes) and bounds[place] >= self.least:
            some, _ = self.open(nodes[place : place + at_once], bounds[place : place + at_once])
            halves, _ = self.open(*self._parts(region.pooled, some, BLOCK // 2))
            cells, counts = self._parts(region.bins, halves, 1)
            kept = is_allowed[cells[:, 1], cells[:, 2]]
            cells, counts = cells[kept] + np.array([0, key[1] * REGION, key[0] * REGION]), counts[kept]
            self.best = max(self.best, int(counts.max(initial=0)))
            cells, counts = self.open(cells, counts)
            self.cells.append(cells)
            self.counts.append(counts)
            if sum(map(len, self.counts)) > 2 * MOST_KEPT:
                self.drop()
            place += at_once
            at_once = min(2 * at_once, MOST_SPLIT)

    def open(self, nodes: Nodes, bounds: Counts) -> tuple[Nodes, Counts]:
        """Squares that may still hold cells to be kept."""
        is_open = bounds >= self.least
        return nodes[is_open], bounds[is_open]

    def _parts(self, grid: NDArray[np.uint8], nodes: Nodes, step: int) -> tuple[Nodes, Counts]:
        """The four parts of each square, and a bound of the count of each."""
        size = max(1, -(-len(nodes) // self.n_threads))
        some = [nodes[k : k + size] for k in range(0, len(nodes), size)]
        margin = self.regions.map.margin
        counts = list(self.pool.map(lambda part: _count_parts(grid, self.turned, part, step, margin), some))
        parts = nodes[:, None, :] + step * PARTS
        return parts.reshape(-1, 3), np.concatenate([np.empty(0, np.int64), *counts])


def _count_parts(grid: NDArray[np.uint8], turned: TurnedScan, nodes: Nodes, step: int, margin: int) -> Counts:
    """Count the matches of the four parts of squares of a region, one after the other, shape (4 m,)."""
    counts = np.empty((len(nodes), 4), np.uint16)
    kernels.count_children(grid, *turned, nodes, step, margin, counts)
    return counts.reshape(-1).astype(np.int64)


def recount(scan: CoarseScan, candidates: CountedCells, half: CoarseMap) -> CountedCells:
    """Return the best cell around each large one, counted in voxels of half the edge, by a scan of more points."""
    squares = (2 * candidates.cells + [0, 1, 1])[:, None, :] + SQUARES
    squares[..., 0] %= len(HALF_HEADINGS)
    used, heading = np.unique(squares[..., 0], return_inverse=True)
    turned = scan.turned(HALF_HEADINGS[used], half.cell)
    keys = (2 * candidates.cells[:, 1:] + 1) // REGION
    counts = np.empty((len(candidates), 4 * len(SQUARES)), np.int64)
    for key_y, key_x in np.unique(keys, axis=0).tolist():
        mine = (keys == [key_y, key_x]).all(axis=1)
        inside = squares[mine] - [0, key_y * REGION, key_x * REGION]
        inside[..., 0] = heading.reshape(squares.shape[:2])[mine]
        found = _count_parts(half.region((key_x, key_y)).bins, turned, inside.reshape(-1, 3), 1, half.margin)
        counts[mine] = found.reshape(len(inside), -1)
    each, best = np.arange(len(candidates)), IN_ORDER[np.argmax(counts[:, IN_ORDER], axis=1)]
    cells = (squares[:, :, None, :] + PARTS).reshape(len(candidates), -1, 3)[each, best]
    order = np.argsort(-counts[each, best], kind="stable")
    return CountedCells(cells[order], counts[each, best][order], candidates.left_out, HALF_HEADINGS, half.cell)
