# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Cells that may be the best, and the scores of those that were looked at."""

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import Moments, Objective, Scores
from maxcon.point_map.tile import PATCH_VOXELS, Addresses
from maxcon.search.cell_grid import CellGrid
from maxcon.search.exhaustive import moments_of_window
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.window import Window
from maxcon.search_space import Cell

__all__ = ["Candidates", "CellScores"]

# The scan is kept as it lies at so many headings.
MOST_TURNED = 32


@dataclass(frozen=True, slots=True)
class Candidates:
    """Cells that may be looked for, shape (n, 3), and what they score at most, (n,)."""

    cells: NDArray[np.int64]
    upper: Scores

    @classmethod
    def none(cls) -> "Candidates":
        """No cell."""
        return cls(np.empty((0, 3), np.int64), np.empty(0))

    def joined(self, other: "Candidates") -> "Candidates":
        """These and others."""
        return Candidates(
            np.concatenate([self.cells, other.cells]), np.concatenate([self.upper, other.upper])
        )

    def below(self, upper: Scores) -> "Candidates":
        """The same cells, also bounded by this."""
        return Candidates(self.cells, np.minimum(self.upper, upper))

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.int64]) -> "Candidates":
        return Candidates(self.cells[which], self.upper[which])


@dataclass(frozen=True, slots=True)
class TileTable:
    """The tiles of a prepared scan in one array, so that one call of the kernel looks up points in all of them.

    Parameters
    ----------
    rows : array, shape (n_tiles + 1, 8), uint64
        Addresses of the arrays of each tile, as `exact_kernels.moments_of_cells` reads them. The first row is for
        where there is no tile.
    grid : array, shape (ny, nx), int32
        Rows of the tiles, by their keys.
    kept : tuple
        What lies at the addresses: it lives as long as the table.
    """

    rows: NDArray[np.uint64]
    grid: NDArray[np.int32]
    kept: tuple[NDArray[Any] | Addresses, ...]

    @classmethod
    def of(cls, prepared: PreparedScan) -> "TileTable":
        """Table of the tiles of a prepared scan."""
        n_ranks = int(prepared.ranks.max(initial=0)) + 1
        layers = np.zeros((len(prepared.tiles) + 1, n_ranks), np.int32)
        nothing, kept = np.zeros((prepared.edge // PATCH_VOXELS) ** 2, np.uint64), []
        rows, grid = np.empty((len(layers), 8), np.uint64), np.zeros(prepared.shape, np.int32)
        rows[:, 0] = layers.ctypes.data + layers.strides[0] * np.arange(len(layers))
        rows[0, 1:] = [1, *[nothing.ctypes.data] * 6]
        for row, (slot, (tile, tile_layers)) in enumerate(prepared.tiles.items(), 1):
            grid.flat[slot] = row
            layers[row] = tile_layers
            layers[row, tile_layers < 0] = len(tile.index.layers)  # none
            rows[row, 1], rows[row, 2:] = tile.occupancy.held.shape[2], tile.addresses.values[:6]
            kept.append(tile.addresses)
        return cls(rows, grid, (layers, nothing, *kept))


@dataclass
class CellScores:
    """Scores of single cells, equal to those of the exhaustive search.

    Parameters
    ----------
    prepared : PreparedScan
        The scan and the tiles around.
    objective : Objective
        What a cell is worth.
    guard_radius : float
        The runner-up lies farther than this from the guarded cell, m.
    guarded : tuple of 3 int, optional
        That cell; the best one so far if not given.
    best : float
        Highest score so far.
    cell : tuple of 3 int
        Its cell, the first in index order at ties (D8).
    scored : dict
        Score and moments of each cell that was scored by itself, and of the best of each window.
    kept : Candidates
        Cells of windows of which all cells were scored, with their scores.
    n_in_windows : int
        How many cells these windows have.
    """

    prepared: PreparedScan
    objective: Objective
    guard_radius: float
    guarded: Cell | None = None
    best: float = -math.inf
    cell: Cell = (0, 0, 0)
    scored: dict[Cell, tuple[float, Moments]] = field(default_factory=dict)
    kept: Candidates = field(default_factory=Candidates.none)
    n_in_windows: int = 0
    _table: TileTable | None = None
    _points: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
    _turned: dict[int, tuple[NDArray[np.uint64], NDArray[np.float32]]] = field(default_factory=dict)

    def score(self, cells: NDArray[np.int64]) -> None:
        """Score cells that are not yet, and keep the best."""
        new: dict[int, list[Cell]] = defaultdict(list)
        for heading, y, x in dict.fromkeys(map(tuple, cells.tolist())):
            if (heading, y, x) not in self.scored:
                new[heading].append((heading, y, x))
        for heading, mine in new.items():
            moments = self.moments(heading, np.array(mine, np.int64))
            scores = self.objective.score(moments).tolist()
            for cell, score, four in zip(mine, scores, moments, strict=True):
                self._note(cell, score, four)

    def score_window(self, headings: NDArray[np.int64], window: Window, n_threads: int) -> CellGrid:
        """Scores of all cells of a window at some headings; keep the best."""
        moments = moments_of_window(self.prepared, headings, window, n_threads)
        grid = CellGrid.of(self.prepared.space, headings, window, self.objective.score(moments))
        four = CellGrid.of(self.prepared.space, headings, window, moments)
        highest = grid.first_highest()
        heading, y, x = highest[0].tolist()
        self._note((heading, y, x), float(grid.at(highest)[0]), four.at(highest)[0])
        self.n_in_windows += grid.numbers.size
        return grid

    def _note(self, cell: Cell, score: float, moments: Moments) -> None:
        """Keep what a cell scores, and whether it is the best."""
        self.scored[cell] = score, moments
        if (-score, cell) < (-self.best, self.cell):
            self.best, self.cell = score, cell

    def moments(self, heading: int, cells: NDArray[np.int64]) -> Moments:
        """Moments of some cells of one heading, shape (n, 4), to the last bit those of the exhaustive search."""
        from maxcon.search import exact_kernels

        prepared = self.prepared
        if self._table is None:
            self._table = TileTable.of(prepared)
        _, ny, nx = prepared.space.shape
        offsets = cells[:, :0:-1] - np.array([nx // 2, ny // 2])
        voxels, normals, ranks = self._laid_out(heading)
        moments = np.zeros((len(cells), 4))
        exact_kernels.moments_of_cells(
            offsets, voxels, normals, ranks, self._table.rows, prepared.edge.bit_length() - 1,
            self._table.grid, prepared.corner,
            prepared.is_once, prepared.is_signed, moments,
        )  # fmt: skip
        return moments

    def _laid_out(self, heading: int) -> tuple[NDArray[np.uint64], NDArray[np.float32], NDArray[np.int32]]:
        """Voxels, normals and ranks of layers of all points at a heading, as the kernel takes them."""
        from maxcon.search import exact_kernels, group_kernels

        prepared = self.prepared
        if self._points is None:
            self._points = group_kernels.points_of_groups(
                prepared.starts, prepared.starts[1:], prepared.ranks
            )
        numbers, ranks = self._points
        if heading not in self._turned:
            (columns,), (turned,) = prepared.turned(np.array([heading]))
            self._turned[heading] = exact_kernels.lay_out(columns, turned, numbers, prepared.without_normal)
        while len(self._turned) > MOST_TURNED:
            self._turned.pop(next(iter(self._turned)))
        return *self._turned[heading], ranks

    def is_beyond(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether cells lie farther than the guard radius from the guarded one."""
        offsets = cells[:, 1:] - np.array((self.guarded or self.cell)[1:])
        return np.asarray(
            np.hypot(offsets[:, 0], offsets[:, 1]) * self.prepared.space.cell_edge > self.guard_radius
        )

    def highest_of(self, cells: NDArray[np.int64]) -> float:
        """Highest score of some cells that were scored by themselves."""
        return max(self.scored[heading, y, x][0] for heading, y, x in cells.tolist())

    def runner_up(self) -> float:
        """Highest score beyond the guard radius among the cells that were scored and kept."""
        scored = self._scored_and_kept()
        return float(scored.upper.max(where=self.is_beyond(scored.cells), initial=0.0))

    def reaching(self, least: float) -> Candidates:
        """Cells that were scored and kept and score at least so much, with their scores."""
        scored = self._scored_and_kept()
        return scored[scored.upper >= least]

    def _scored_and_kept(self) -> Candidates:
        singles = Candidates(
            np.array(list(self.scored), np.int64).reshape(-1, 3),
            np.array([score for score, _ in self.scored.values()]),
        )
        return self.kept.joined(singles)
