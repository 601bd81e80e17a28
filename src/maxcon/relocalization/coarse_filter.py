# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The coarse filter: large cells of a whole map that match nearly as many points as the best one, by branch and bound.

`recount` then counts around the places that are left in cells half as large.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maxcon.relocalization.coarse_map import BLOCK, N_BLOCKS, REGION, Region, Regions
from maxcon.relocalization.coarse_scan import HEADINGS, STEP_DEG, CandidateCells, CandidatePoses, CoarseScan, TurnedScan

# Squares that are split at a time: few at first, as a good count rules out most others.
FIRST_SPLIT, MOST_SPLIT = 256, 2**16
MOST_KEPT = 2**18
"""Cells that are kept at most, the highest: where more fit, nothing stands out."""

Nodes = NDArray[np.int64]
"""Squares (m, 3): heading, first cell (y, x) in the region."""
Counts = NDArray[np.int64]

# `recount`: offsets around the middle of a large cell, in cells of half the edge and headings of half the step.
HALF_STEP_DEG = 0.5 * STEP_DEG
HALF_HEADINGS = np.radians(np.arange(-180.0, 180.0, HALF_STEP_DEG))
AROUND = np.array(list(product(range(-2, 3), range(-1, 3), range(-1, 3))))


def filter_cells(scan: CoarseScan, regions: Regions, ratio: float, *, n_threads: int = 1) -> CandidateCells:
    """Find every cell whose count reaches a ratio of the highest one: the same as `reference.filter_cells` finds.

    In each region, the bound of a block of 4 x 4 cells counts every point that matches at any cell of the block. Blocks
    that may reach the ratio of the best count so far, of all regions, are split into squares of 2 x 2 cells, the
    highest bound first, and these into cells.

    scan: the points to count.
    regions: where a scanner may stand.
    ratio: above 0, at most 1.
    n_threads: threads that share headings and squares; what is found does not depend on their number (D8).
    Returns at most the `MOST_KEPT` highest cells; then `left_out` says how high the others may count.
    """
    turned = scan.turned(HEADINGS, regions.tiles.cell)
    kept = _Kept(ratio)
    with ThreadPoolExecutor(n_threads) as pool:
        search = _RegionSearch(turned, kept, pool, n_threads)
        blocks = {}
        for key in regions.keys:
            region = regions.load(key)
            nodes, bounds = search.blocks(region)
            search.split(region, nodes[:FIRST_SPLIT], bounds[:FIRST_SPLIT])
            blocks[key] = nodes[FIRST_SPLIT:], bounds[FIRST_SPLIT:]
        for key in sorted(blocks, key=lambda key: (-blocks[key][1].max(initial=0), key)):
            nodes, bounds = search.open(*blocks.pop(key))
            if len(nodes):
                search.split(regions.load(key), nodes, bounds)
    return kept.candidates()


@dataclass
class _Kept:
    """Cells found so far, the best count, and the highest count that was dropped for lack of room."""

    ratio: float
    best: int = 0
    dropped: int = 0
    n_counted: int = 0
    cells: list[Nodes] = field(default_factory=lambda: [np.empty((0, 3), np.int64)])
    counts: list[Counts] = field(default_factory=lambda: [np.empty(0, np.int64)])

    @property
    def least(self) -> float:
        """Least count of a cell to be kept."""
        return max(self.ratio * self.best, 1.0, self.dropped)

    def add(self, cells: Nodes, counts: Counts) -> None:
        """Take in cells (global indices) that may be kept."""
        self.best = max(self.best, int(counts.max(initial=0)))
        reaches = counts >= self.least
        self.cells.append(cells[reaches])
        self.counts.append(counts[reaches])
        if sum(map(len, self.counts)) > 2 * MOST_KEPT:
            self._drop()

    def _drop(self) -> None:
        """Drop cells below the ratio of the best count, and the lowest for which there is no room."""
        cells, counts = np.concatenate(self.cells), np.concatenate(self.counts)
        reaches = counts >= max(self.ratio * self.best, 1.0)
        cells, counts = cells[reaches], counts[reaches]
        if len(counts) > MOST_KEPT:
            order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], -counts))
            self.dropped = max(self.dropped, int(counts[order[MOST_KEPT]]))
            cells, counts = cells[order[:MOST_KEPT]], counts[order[:MOST_KEPT]]
        self.cells, self.counts = [cells], [counts]

    def candidates(self) -> CandidateCells:
        """The cells left, of all regions."""
        self._drop()
        left_out = max(self.ratio, self.dropped / self.best) if self.best else self.ratio
        return CandidateCells.sorted(self.cells[0], self.counts[0], left_out, self.n_counted)


@dataclass(frozen=True, eq=False)
class _RegionSearch:
    """Bounds the blocks of a region, and splits them."""

    turned: TurnedScan
    kept: _Kept
    pool: ThreadPoolExecutor
    n_threads: int

    def blocks(self, region: Region) -> tuple[Nodes, Counts]:
        """Blocks that may hold cells to be kept, the highest bound first, and their bounds."""
        from maxcon.relocalization import kernels

        bounds = np.zeros((len(HEADINGS), N_BLOCKS, N_BLOCKS), np.uint16)
        least, turned, rows = math.ceil(self.kept.least), self.turned, region.rows

        def bound(some: NDArray[np.int64]) -> None:
            part = slice(int(some[0]), int(some[-1]) + 1)
            kernels.bound_blocks(
                region.voxels.blocks, turned.layers, turned.columns[part], turned.bins[part], rows, region.margin,
                least, bounds[part],
            )  # fmt: skip

        n_parts = min(self.n_threads, len(HEADINGS))
        list(self.pool.map(bound, np.array_split(np.arange(len(HEADINGS)), n_parts)))
        self.kept.n_counted += int(np.bitwise_count(rows).sum()) * len(HEADINGS)
        nodes = np.argwhere(bounds)
        found = bounds[tuple(nodes.T)].astype(np.int64)
        order = np.argsort(-found, kind="stable")
        return nodes[order] * np.array([1, BLOCK, BLOCK]), found[order]

    def split(self, region: Region, nodes: Nodes, bounds: Counts) -> None:
        """Split blocks, the highest bounds first, and keep the cells that may reach the ratio."""
        at_once, place = FIRST_SPLIT, 0
        while place < len(nodes) and bounds[place] >= self.kept.least:
            some = nodes[place : place + at_once][bounds[place : place + at_once] >= self.kept.least]
            halves, _ = self.open(*self._children(region, some, region.voxels.pooled, BLOCK // 2))
            cells, counts = self._children(region, halves, region.voxels.bins, 1)
            is_allowed = region.is_allowed[cells[:, 1], cells[:, 2]]
            corner = np.array([0, region.first[1], region.first[0]])
            self.kept.add(cells[is_allowed] + corner, counts[is_allowed])
            place += at_once
            at_once = min(2 * at_once, MOST_SPLIT)

    def open(self, nodes: Nodes, bounds: Counts) -> tuple[Nodes, Counts]:
        """Squares that may still hold cells to be kept."""
        is_open = bounds >= self.kept.least
        return nodes[is_open], bounds[is_open]

    def _children(self, region: Region, nodes: Nodes, grid: NDArray[np.uint8], step: int) -> tuple[Nodes, Counts]:
        """The four parts of each square, and a bound of the count of each."""
        from maxcon.relocalization import kernels

        turned, counts = self.turned, np.empty((len(nodes), 4), np.uint16)

        def count(part: slice) -> None:
            kernels.count_children(
                grid, turned.layers, turned.columns, turned.bins, nodes[part], step, region.margin, counts[part]
            )

        size = max(1, -(-len(nodes) // self.n_threads))
        list(self.pool.map(count, [slice(k, k + size) for k in range(0, len(nodes), size)]))
        self.kept.n_counted += counts.size
        parts = nodes[:, None, :] + step * np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1]])
        return parts.reshape(-1, 3), counts.reshape(-1).astype(np.int64)


def recount(scan: CoarseScan, candidates: CandidatePoses, cell: float, regions: Regions) -> CandidatePoses:
    """Count the cells around candidates once more, in voxels of half the edge.

    scan: the scan, with more points than the coarse filter had.
    candidates: middles of large cells, at headings of `HEADINGS`.
    cell: edge of these cells, m.
    regions: of half the edge.
    Returns for each candidate the best cell around it, the first in index order; the highest count first.
    """
    from maxcon.relocalization import kernels

    if not len(candidates):
        return candidates
    middles = np.round(candidates.poses[:, [2, 1, 0]] / [math.radians(HALF_STEP_DEG), 0.5 * cell, 0.5 * cell])
    cells = middles.astype(np.int64)[:, None, :] + AROUND
    cells[..., 0] = (cells[..., 0] + len(HALF_HEADINGS) // 2) % len(HALF_HEADINGS)
    used, heading = np.unique(cells[..., 0], return_inverse=True)
    turned = scan.turned(HALF_HEADINGS[used], regions.tiles.cell)
    keys, counts = cells[:, 0, 1:] // REGION, np.empty(cells.shape[:2], np.int64)
    for key_y, key_x in np.unique(keys, axis=0).tolist():
        mine = (keys == [key_y, key_x]).all(axis=1)
        region = regions.load((key_x, key_y))
        inside = cells[mine] - [0, key_y * REGION, key_x * REGION]
        inside[..., 0] = heading.reshape(counts.shape)[mine]
        found = np.empty(inside.shape[0] * inside.shape[1], np.int64)
        kernels.count_cells(
            region.voxels.bins, turned.layers, turned.columns, turned.bins, inside.reshape(-1, 3), region.margin, found
        )
        counts[mine] = found.reshape(len(inside), -1)
    each, best = np.arange(len(cells)), np.argmax(counts, axis=1)
    heading_of_best, y, x = cells[each, best].T
    edge = regions.tiles.cell
    poses = np.stack([(x + 0.5) * edge, (y + 0.5) * edge, HALF_HEADINGS[heading_of_best]], 1)
    order = np.argsort(-counts[each, best], kind="stable")
    return CandidatePoses(poses[order], counts[each, best][order], candidates.left_out)
