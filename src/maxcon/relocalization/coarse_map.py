"""The map in large voxels with heights above ground and orientation bins, and cells where a scanner may stand."""

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.map import PointMap, TileKey
from maxcon.map.tile import TileCache
from maxcon.relocalization.kernels import BLOCK, N_BLOCKS, REGION

HIGHEST = 30.0  # m above the ground: voxels, and points, higher up do not take part
BESIDE_GROUND = 2.0  # m; a scanner may stand up to so far from known ground: a parked truck hides some
# Ground up to so far outside a tile is read, m: where there is none, the height of the nearest cell is taken.
GROUND_MARGIN = 16.0
N_BINS = 7  # orientation bins, sectors of azimuth: a bit of a byte each
BIN_WIDTH = 2.0 * np.pi / N_BINS
ANY_BIN = N_BINS  # number of the eighth bit, which every voxel with points has
LEAST_COSINE = 0.5  # a voxel is in every bin whose middle is within 60 degrees of its normal, flattened
REACH = 84.0  # m, horizontally: points of a scan that are farther away do not take part
BORDER = 3  # cells up to so many beyond a region can be counted with its voxels, too, as `recount` does
TILE_BYTES, REGION_BYTES = 2**27, 2**28  # of what is kept of tiles and of regions


class Circle(NamedTuple):
    """A circle in which a scanner is known to stand: its middle (x, y), local frame, and its radius, m."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class CoarseTile:
    """One tile of the map, with heights above the ground."""

    columns: NDArray[np.int32]  # (n, 2): (x, y) index of each voxel, local frame
    layers: NDArray[np.int16]  # (n,): its height above the ground in voxels
    bins: NDArray[np.uint8]  # (n,): bits of the orientation bins near its normal
    is_allowed: NDArray[np.bool_]  # (edge, edge): whether a scanner may stand at the middle of cell (y, x) of the tile

    @property
    def n_bytes(self) -> int:
        """Memory it holds."""
        return self.columns.nbytes + self.layers.nbytes + self.bins.nbytes + self.is_allowed.nbytes


@dataclass(frozen=True, eq=False)
class Region:
    """The voxels of a square of REGION x REGION cells and of a margin around it, and unions of them for bounds."""

    bins: NDArray[np.uint8]  # (n_layers, ny, nx): bits of orientation bins, 0 where there is no voxel

    @cached_property
    def pooled(self) -> NDArray[np.uint8]:
        """Union of the bins of 2 x 2 voxels from (y, x) on: for bounds of four cells."""
        return _pooled(self.bins, 1)

    @cached_property
    def blocks(self) -> NDArray[np.uint64]:
        """Union of the bins of 4 x 4 voxels, (n_layers, 8, 4, 4, n, 2): (layer, bin, py, px, Y, word).

        Bit X of both words is that of the block from voxel (4 Y + py, 4 X + px) on.
        """
        pooled = _pooled(self.pooled, 2)
        n_layers, width, _ = pooled.shape
        n = width // BLOCK
        parts = pooled.reshape(n_layers, n, BLOCK, n, BLOCK).transpose(0, 2, 4, 1, 3)
        bits = np.zeros((n_layers, BLOCK, BLOCK, 8, n, 2 * N_BLOCKS), bool)
        for number in range(8):
            bits[:, :, :, number, :, :n] = parts & (1 << number)
        return np.ascontiguousarray(_words(bits).transpose(0, 3, 1, 2, 4, 5))

    @property
    def n_bytes(self) -> int:
        """Memory it holds once its bounds are made."""
        return 5 * self.bins.nbytes


def _pooled(bins: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Union of the bins of each voxel and of those `step` farther along x, y and both."""
    along = bins.copy()
    along[:, :, :-step] |= bins[:, :, step:]
    both = along.copy()
    both[:, :-step] |= along[:, step:]
    return both


def _words(bits: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Words of 64 bits along the last axis, the lowest first."""
    return np.packbits(bits, axis=-1, bitorder="little").view("<u8").astype(np.uint64)


def blocks_of(is_allowed: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Blocks of a region in which a scanner may stand somewhere: bit X of word Y, shape (N_BLOCKS,)."""
    is_met = np.asarray(is_allowed.reshape(N_BLOCKS, BLOCK, N_BLOCKS, BLOCK).any(axis=(1, 3)))
    return _words(is_met).ravel()


class CoarseMap:
    """A level of a map with heights above the ground; tiles and regions used last are kept. MapError without ground."""

    def __init__(self, point_map: PointMap, cell: float) -> None:
        if not point_map.has_ground:
            raise MapError(
                "Expected a map that knows the height of the ground, to be searched without a prior, got one without."
                " Build it anew of clouds whose ground is classified, or localize with a prior."
            )
        self.map = point_map
        self.level = point_map.nearest_level(cell)
        self.cell = self.level.cell
        self.n_layers = int(np.ceil(HIGHEST / self.cell))
        # Cells that the voxels of a region reach beyond it: the reach of a scan from BORDER beyond; whole blocks.
        self.margin = -(-(int(REACH / self.cell) + 1 + BORDER) // BLOCK) * BLOCK
        self._tiles = TileCache(self._tile, TILE_BYTES)
        self._regions = TileCache(self._region, REGION_BYTES)

    def region(self, key: TileKey) -> Region:
        """Return a region by its key: (x, y) of its first cell, divided by REGION."""
        return self._regions.load(key)

    def allowed(self, area: Circle | None = None) -> dict[TileKey, NDArray[np.bool_]]:
        """Whether a scanner may stand in cell (y, x), shape (REGION, REGION), of each region where it may in any.

        The middle of the cell lies in the area, if one is given. Regions come by their keys in order.
        """
        edge = self.level.tile_voxels
        found: dict[TileKey, NDArray[np.bool_]] = defaultdict(lambda: np.zeros((REGION, REGION), bool))
        # Where there is nothing but ground the map has no tile: beside each tile, too.
        for key in sorted({(x + i, y + j) for x, y in self.map.tile_keys for i in (-1, 0, 1) for j in (-1, 0, 1)}):
            x, y = (np.arange(first * edge, (first + 1) * edge) for first in key)
            is_inside = np.ones((edge, edge), bool)
            if area is not None:
                middles_x, middles_y = ((cells + 0.5) * self.cell for cells in (x, y))
                is_inside = np.hypot(middles_x - area.x, (middles_y - area.y)[:, None]) <= area.radius
            if is_inside.any() and (is_allowed := self._tiles.load(key).is_allowed & is_inside).any():
                found[int(x[0]) // REGION, int(y[0]) // REGION][np.ix_(y % REGION, x % REGION)] = is_allowed
        return dict(sorted(found.items()))

    def _tile(self, key: TileKey) -> CoarseTile:
        edge, cell = self.level.tile_voxels, self.cell
        half = 0.5 * edge * cell
        patch = self.map.ground_around((2 * key[0] + 1) * half, (2 * key[1] + 1) * half, half + GROUND_MARGIN)
        (heights, *_), distances = patch.filled()
        cells = np.arange(edge) + 0.5
        x, y = (key[0] * edge + cells) * cell, (key[1] * edge + cells) * cell
        is_allowed = distances[patch.cells_at(x[None, :], y[:, None])] <= BESIDE_GROUND
        if key not in self.map.tile_keys:
            return CoarseTile(np.empty((0, 2), np.int32), np.empty(0, np.int16), np.empty(0, np.uint8), is_allowed)
        tile = self.level.tile(key)
        points = tile.mean_points(cell)
        layers = np.floor((points[:, 2] - heights[patch.cells_at(points[:, 0], points[:, 1])]) / cell)
        kept = (layers >= 0) & (layers < self.n_layers)
        bins = _bins_of_voxels(tile.normals, is_signed=self.map.is_signed)
        return CoarseTile(tile.voxels[kept, :2], layers[kept].astype(np.int16), bins[kept], is_allowed)

    def _region(self, key: TileKey) -> Region:
        edge, width, corner = self.level.tile_voxels, REGION + 2 * self.margin, np.array(key) * REGION - self.margin
        bins = np.zeros((self.n_layers, width, width), np.uint8)
        for near in product(*(range(first // edge, (first + width - 1) // edge + 1) for first in corner.tolist())):
            if near in self.map.tile_keys:
                tile = self._tiles.load(near)
                x, y = (tile.columns - corner).T
                inside = (x >= 0) & (x < width) & (y >= 0) & (y < width)
                # Two voxels above each other may fall into one layer: it has the bins of both.
                np.bitwise_or.at(bins, (tile.layers[inside], y[inside], x[inside]), tile.bins[inside])
        return Region(bins)


def _bins_of_voxels(normals: NDArray[np.float32], *, is_signed: bool) -> NDArray[np.uint8]:
    """Bits (n,) of all orientation bins near the normals (n, 3), map axes, of voxels; and bit `ANY_BIN`."""
    bits = np.full(len(normals), 1 << ANY_BIN, np.uint8)
    for number in range(N_BINS):
        along = normals[:, 0] * np.cos(number * BIN_WIDTH) + normals[:, 1] * np.sin(number * BIN_WIDTH)
        bits[(along if is_signed else np.abs(along)) > LEAST_COSINE] |= np.uint8(1 << number)
    return bits
