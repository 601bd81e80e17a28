# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The sieve: large cells of a whole map that match nearly as many points as the best one, by branch and bound."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maxcon.relocalization.regions import BLOCK, N_BLOCKS, Region, Regions
from maxcon.relocalization.sieve_scan import SieveScan, Turned
from maxcon.relocalization.sifted import HEADINGS, Sifted

__all__ = ["MOST_KEPT", "sift"]

# Squares that are split at a time: few at first, as a good count rules out most others.
FIRST_SPLIT, MOST_SPLIT = 256, 2**16
MOST_KEPT = 2**18
"""Cells that are kept at most, the highest: where more fit, nothing stands out."""

Nodes = NDArray[np.int64]
"""Squares (m, 3): heading, first cell (y, x) in the region."""


def sift(scan: SieveScan, regions: Regions, share: float, *, n_threads: int = 1) -> Sifted:
    """Find every cell whose count reaches a share of the highest one: the same as `reference.sift` finds.

    In each region, the bound of a block of 4 x 4 cells counts every point that matches at any cell of the block. Blocks
    that may reach the share of the best count so far, of all regions, are split into squares of 2 x 2 cells, the
    highest bound first, and these into cells.

    Parameters
    ----------
    scan : SieveScan
        The points to count.
    regions : Regions
        Where a scanner may stand.
    share : float
        Above 0, at most 1.
    n_threads : int
        Threads that share headings and squares; what is found does not depend on their number (D8).

    Returns
    -------
    Sifted
        At most the `MOST_KEPT` highest cells; then `left_out` says how high the others may count.
    """
    turned = scan.turned(HEADINGS, regions.tiles.cell)
    kept = _Kept(share)
    with ThreadPoolExecutor(n_threads) as pool:
        sieve = _RegionSieve(turned, kept, pool, n_threads)
        blocks = {}
        for key in regions.keys:
            region = regions.load(key)
            nodes, bounds = sieve.blocks(region)
            sieve.split(region, nodes[:FIRST_SPLIT], bounds[:FIRST_SPLIT])
            blocks[key] = nodes[FIRST_SPLIT:], bounds[FIRST_SPLIT:]
        for key in sorted(blocks, key=lambda key: (-blocks[key][1].max(initial=0), key)):
            nodes, bounds = sieve.open(*blocks.pop(key))
            if len(nodes):
                sieve.split(regions.load(key), nodes, bounds)
    return kept.sifted()


@dataclass
class _Kept:
    """Cells found so far, the best count, and the highest count that was dropped for lack of room."""

    share: float
    best: int = 0
    let_go: int = 0
    n_counted: int = 0
    cells: list[Nodes] = field(default_factory=lambda: [np.empty((0, 3), np.int64)])
    counts: list[NDArray[np.int64]] = field(default_factory=lambda: [np.empty(0, np.int64)])

    @property
    def least(self) -> float:
        """Least count of a cell to be kept."""
        return max(self.share * self.best, 1.0, self.let_go)

    def add(self, cells: Nodes, counts: NDArray[np.int64]) -> None:
        """Take in cells (global indices) that may be kept."""
        self.best = max(self.best, int(counts.max(initial=0)))
        reaches = counts >= self.least
        self.cells.append(cells[reaches])
        self.counts.append(counts[reaches])
        if sum(map(len, self.counts)) > 2 * MOST_KEPT:
            self._let_go()

    def _let_go(self) -> None:
        cells, counts = self._reaching()
        if len(counts) > MOST_KEPT:
            order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], -counts))
            self.let_go = max(self.let_go, int(counts[order[MOST_KEPT]]))
            cells, counts = cells[order[:MOST_KEPT]], counts[order[:MOST_KEPT]]
        self.cells, self.counts = [cells], [counts]

    def _reaching(self) -> tuple[Nodes, NDArray[np.int64]]:
        cells, counts = np.concatenate(self.cells), np.concatenate(self.counts)
        reaches = counts >= max(self.share * self.best, 1.0)
        return cells[reaches], counts[reaches]

    def sifted(self) -> Sifted:
        """The cells left, of all regions."""
        self._let_go()
        left_out = max(self.share, self.let_go / self.best) if self.best else self.share
        return Sifted.of(self.cells[0], self.counts[0], left_out, self.n_counted)


@dataclass(frozen=True)
class _RegionSieve:
    """Bounds the blocks of a region, and splits them."""

    turned: Turned
    kept: _Kept
    pool: ThreadPoolExecutor
    n_threads: int

    def blocks(self, region: Region) -> tuple[Nodes, NDArray[np.int64]]:
        """Blocks that may hold cells to be kept, the highest bound first, and their bounds."""
        from maxcon.relocalization import kernels

        bounds = np.zeros((len(HEADINGS), N_BLOCKS, N_BLOCKS), np.uint16)
        least, turned, rows = math.ceil(self.kept.least), self.turned, region.rows

        def bound(some: NDArray[np.int64]) -> None:
            part = slice(int(some[0]), int(some[-1]) + 1)
            kernels.bound_blocks(
                region.voxels.blocks, turned.layers, turned.columns[part], turned.facings[part], rows,
                region.margin, least, bounds[part],
            )  # fmt: skip

        n_parts = min(self.n_threads, len(HEADINGS))
        list(self.pool.map(bound, np.array_split(np.arange(len(HEADINGS)), n_parts)))
        self.kept.n_counted += int(np.bitwise_count(rows).sum()) * len(HEADINGS)
        nodes = np.argwhere(bounds)
        found = bounds[tuple(nodes.T)].astype(np.int64)
        order = np.argsort(-found, kind="stable")
        return nodes[order] * np.array([1, BLOCK, BLOCK]), found[order]

    def split(self, region: Region, nodes: Nodes, bounds: NDArray[np.int64]) -> None:
        """Split blocks, the highest bounds first, and keep the cells that may reach the share."""
        at_once, place = FIRST_SPLIT, 0
        while place < len(nodes) and bounds[place] >= self.kept.least:
            some = nodes[place : place + at_once][bounds[place : place + at_once] >= self.kept.least]
            halves, _ = self.open(*self._children(region, some, region.voxels.pooled, BLOCK // 2))
            cells, counts = self._children(region, halves, region.voxels.facings, 1)
            is_allowed = region.is_allowed[cells[:, 1], cells[:, 2]]
            corner = np.array([0, region.first[1], region.first[0]])
            self.kept.add(cells[is_allowed] + corner, counts[is_allowed])
            place += at_once
            at_once = min(2 * at_once, MOST_SPLIT)

    def open(self, nodes: Nodes, bounds: NDArray[np.int64]) -> tuple[Nodes, NDArray[np.int64]]:
        """Squares that may still hold cells to be kept."""
        is_open = bounds >= self.kept.least
        return nodes[is_open], bounds[is_open]

    def _children(
        self, region: Region, nodes: Nodes, grid: NDArray[np.uint8], step: int
    ) -> tuple[Nodes, NDArray[np.int64]]:
        """The four parts of each square, and a bound of the count of each."""
        from maxcon.relocalization import kernels

        turned, counts = self.turned, np.empty((len(nodes), 4), np.uint16)

        def count(part: slice) -> None:
            kernels.count_children(
                grid, turned.layers, turned.columns, turned.facings, nodes[part], step, region.margin, counts[part]
            )

        size = max(1, -(-len(nodes) // self.n_threads))
        list(self.pool.map(count, [slice(k, k + size) for k in range(0, len(nodes), size)]))
        self.kept.n_counted += counts.size
        parts = nodes[:, None, :] + step * np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1]])
        return parts.reshape(-1, 3), counts.reshape(-1).astype(np.int64)
