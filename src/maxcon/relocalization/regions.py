# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Regions: squares of cells in which a scanner may stand, with the voxels that a scan can reach from there."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from maxcon.map import TileKey
from maxcon.map.tile import TileCache
from maxcon.relocalization.coarse_tiles import CoarseTiles

__all__ = ["BLOCK", "N_BLOCKS", "REACH", "REGION", "RIM", "Area", "Region", "Regions", "Voxels"]

REGION = 256
"""Cells along an edge of a region."""
REACH = 84.0
"""Farthest points of a scan that take part, m, horizontally."""
BLOCK = 4
"""Cells along an edge of the blocks that are bounded first."""
RIM = 3
"""Cells up to so many beyond a region can be counted with its voxels, too, as `closer` does."""
N_BLOCKS = REGION // BLOCK
"""Blocks in a row of a region: as many as a word has bits."""
KEPT_BYTES = 2**28
"""Regions are kept up to this size in all; the ones used longest ago go first."""


@dataclass(frozen=True, slots=True)
class Area:
    """A circle in which a scanner is known to stand.

    Parameters
    ----------
    x, y : float
        Its middle, local frame, m.
    radius : float
        m.
    """

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class Voxels:
    """The voxels of a region and of a margin around it, and unions of them for bounds.

    Parameters
    ----------
    facings : array, shape (n_layers, ny, nx), uint8
        See `facings_of_voxels`; 0 where there is no voxel.
    is_allowed : array, shape (REGION, REGION), bool
        Whether a scanner may stand in cell (y, x).
    """

    facings: NDArray[np.uint8]
    is_allowed: NDArray[np.bool_]

    @cached_property
    def pooled(self) -> NDArray[np.uint8]:
        """Union of the facings of 2 x 2 voxels from (y, x) on: for bounds of four cells."""
        return _pooled(self.facings, 1)

    @cached_property
    def blocks(self) -> NDArray[np.uint64]:
        """Union of the facings of 4 x 4 voxels, (n_layers, 8, 4, 4, n, 2): (layer, facing, py, px, Y, word).

        Bit X of both words is that of the block from voxel (4 Y + py, 4 X + px) on.
        """
        pooled = _pooled(self.pooled, 2)
        n_layers, width, _ = pooled.shape
        n = width // BLOCK
        parts = pooled.reshape(n_layers, n, BLOCK, n, BLOCK).transpose(0, 2, 4, 1, 3)
        bits = np.zeros((n_layers, BLOCK, BLOCK, 8, n, 2 * N_BLOCKS), bool)
        for number in range(8):
            bits[:, :, :, number, :, :n] = parts & (1 << number)
        bytes_of_rows = np.packbits(bits, axis=-1, bitorder="little")
        words = bytes_of_rows.view("<u8").astype(np.uint64).transpose(0, 3, 1, 2, 4, 5)
        return np.ascontiguousarray(words)

    @property
    def n_bytes(self) -> int:
        """Memory it holds once its bounds are made."""
        return 5 * self.facings.nbytes


@dataclass(frozen=True, slots=True)
class Region:
    """A square of REGION x REGION cells in which a scanner may stand.

    Parameters
    ----------
    first : tuple of 2 int
        (x, y) index of its first cell.
    margin : int
        Cells that the voxels reach beyond it on every side.
    voxels : Voxels
        The voxels of the region and its margin.
    is_allowed : array, shape (REGION, REGION), bool
        Whether a scanner may stand in cell (y, x).
    """

    first: tuple[int, int]
    margin: int
    voxels: Voxels
    is_allowed: NDArray[np.bool_]

    @property
    def rows(self) -> NDArray[np.uint64]:
        """Blocks in which a scanner may stand somewhere: bit X of word Y, shape (N_BLOCKS,)."""
        is_met = self.is_allowed.reshape(N_BLOCKS, BLOCK, N_BLOCKS, BLOCK).any(axis=(1, 3))
        return np.packbits(is_met, axis=-1, bitorder="little").view("<u8").astype(np.uint64).ravel()


def _pooled(facings: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Union of the facings of each voxel and of those `step` farther along x, y and both."""
    along = facings.copy()
    along[:, :, :-step] |= facings[:, :, step:]
    both = along.copy()
    both[:, :-step] |= along[:, step:]
    return both


class Regions:
    """The regions of a map, made when asked for; those used last are kept.

    Parameters
    ----------
    tiles : CoarseTiles
        Of the map.
    area : Area, optional
        Cells whose middle lies outside are left out.
    """

    def __init__(self, tiles: CoarseTiles, area: Area | None = None) -> None:
        self.tiles = tiles
        self.area = area
        self._kept: TileCache[Voxels] = TileCache(KEPT_BYTES)

    def within(self, area: Area | None) -> "Regions":
        """The same regions with another area, or none; what is kept of them is shared."""
        regions = Regions(self.tiles, area)
        regions._kept = self._kept
        return regions

    @property
    def margin(self) -> int:
        """Cells that the voxels of a region reach beyond it: the reach of a scan from RIM beyond; whole blocks."""
        return -(-(int(REACH / self.tiles.cell) + 1 + RIM) // BLOCK) * BLOCK

    @cached_property
    def n_allowed(self) -> dict[TileKey, int]:
        """Number of cells in which a scanner may stand, of each region that has any, by key in order."""
        edge = self.tiles.edge
        keys = {key for x, y in self.tiles.keys for key in _squares(x * edge, y * edge, edge, REGION)}
        counts = {key: int(self._allowed(key).sum()) for key in sorted(keys) if self._meets_area(key)}
        return {key: count for key, count in counts.items() if count}

    @property
    def keys(self) -> list[TileKey]:
        """Keys of the regions in which a scanner may stand, in order."""
        return list(self.n_allowed)

    def load(self, key: TileKey) -> Region:
        """Return a region by its key: (x, y) of its first cell, divided by REGION."""
        voxels = self._kept.load(key, lambda: self._made(key))
        is_allowed = voxels.is_allowed if self.area is None else voxels.is_allowed & self._is_inside(key)
        return Region((key[0] * REGION, key[1] * REGION), self.margin, voxels, is_allowed)

    def _made(self, key: TileKey) -> Voxels:
        margin, edge = self.margin, self.tiles.edge
        width = REGION + 2 * margin
        corner = np.array(key) * REGION - margin
        facings = np.zeros((self.tiles.n_layers, width, width), np.uint8)
        for tile_key in _squares(int(corner[0]), int(corner[1]), width, edge):
            if tile_key not in self.tiles.map.tile_keys:
                continue
            tile = self.tiles.load(tile_key)
            x, y = (tile.columns - corner).T
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < width)
            # Two voxels above each other may fall into one layer: it has the facings of both.
            np.bitwise_or.at(facings, (tile.layers[inside], y[inside], x[inside]), tile.facings[inside])
        return Voxels(facings, self._standable(key))

    def _allowed(self, key: TileKey) -> NDArray[np.bool_]:
        """Where a scanner may stand in a region, and in the area."""
        return self._standable(key) & self._is_inside(key)

    def _standable(self, key: TileKey) -> NDArray[np.bool_]:
        """Where a scanner may stand in a region, shape (REGION, REGION)."""
        edge, first = self.tiles.edge, np.array(key) * REGION
        is_allowed = np.zeros((REGION, REGION), bool)
        for x, y in _squares(int(first[0]), int(first[1]), REGION, edge):
            if (x, y) not in self.tiles.keys:
                continue
            left, low = x * edge - first[0], y * edge - first[1]
            rows = slice(max(low, 0), min(low + edge, REGION))
            columns = slice(max(left, 0), min(left + edge, REGION))
            mine = slice(rows.start - low, rows.stop - low), slice(columns.start - left, columns.stop - left)
            is_allowed[rows, columns] = self.tiles.load((x, y)).is_allowed[mine]
        return is_allowed

    def _is_inside(self, key: TileKey) -> NDArray[np.bool_]:
        """Which cells of a region lie in the area, shape (REGION, REGION)."""
        if self.area is None:
            return np.ones((REGION, REGION), bool)
        x, y = ((key[axis] * REGION + np.arange(REGION) + 0.5) * self.tiles.cell for axis in (0, 1))
        away = np.hypot(x[None, :] - self.area.x, y[:, None] - self.area.y)
        return np.asarray(away <= self.area.radius)

    def _meets_area(self, key: TileKey) -> bool:
        if self.area is None:
            return True
        half = 0.5 * REGION * self.tiles.cell
        away = [abs((2 * key[axis] + 1) * half - (self.area.x, self.area.y)[axis]) - half for axis in (0, 1)]
        return max(away) <= self.area.radius


def _squares(x: int, y: int, width: int, edge: int) -> list[TileKey]:
    """Keys of the squares of an edge that meet the square of `width` cells from (x, y) on."""
    return list(product(range(x // edge, (x + width - 1) // edge + 1), range(y // edge, (y + width - 1) // edge + 1)))
