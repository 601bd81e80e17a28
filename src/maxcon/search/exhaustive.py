# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The exhaustive search: the definition's accumulator, compiled (D5, D7)."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from maxcon.accumulator import Accumulator
from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose, voxel_indices
from maxcon.point_map import PATCH_VOXELS, TILE_VOXELS, PointMap, TileKey, VoxelTile
from maxcon.scan import Scan
from maxcon.search.matching import LevelledScan, Multiplicity, Weighting, check_cell_edge, level, tiles_met
from maxcon.search_space import SearchSpace

__all__ = ["exhaustive"]

# An accumulator takes 32 bytes a cell; 2^26 cells are 2 GiB.
CELL_LIMIT = 2**26

_Float = TypeVar("_Float", np.float32, np.float64)


def exhaustive(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
    n_threads: int = 1,
) -> Accumulator:
    """Moments of every cell of the search space; equal to `reference.voxels`, to the last bit.

    Parameters
    ----------
    scan : Scan
        Points with normals, sensor frame.
    point_map : PointMap
        Voxels of the space's cell edge. A scan or space that reaches past the map finds nothing there.
    prior : Pose
        T_map_sensor before localization, local frame of the map.
    space : SearchSpace
        The cells to try; at most 2^26 of them (2 GiB of moments).
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    weighting : {"cosine", "one"}
        Weight of a match in N: max(0, n_scan . n_map), or 1 (D5).
    n_threads : int
        Headings are shared out among that many threads; the result does not depend on it (D8).

    Returns
    -------
    Accumulator
        Moments, shape (headings, ny, nx, 4), float64.

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's or the space has too many cells.
    OptionError
        If the multiplicity or the weighting is unknown or there is no thread.
    ArrayError
        If the prior lies so far out that voxels have no index there (64,000 km at 6 cm).
    """
    check_cell_edge(space, point_map)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    if n_threads < 1:
        raise OptionError(f"Expected `n_threads` to be 1 or more, got {n_threads}. One is the default.")
    if space.n_cells > CELL_LIMIT:
        raise SearchSpaceError(
            f"Expected at most {CELL_LIMIT:,} cells in an exhaustive search, got {space.n_cells:,}."
            " Narrow the search space, or enlarge the cell or the heading step."
        )
    field = _Field.prepare(scan, point_map, prior, space, multiplicity, weighting)
    moments = np.zeros((*space.shape, 4))

    def search(heading: int) -> None:
        moments[heading] = _search_heading(field, prior, space, heading)

    if n_threads == 1 or space.shape[0] == 1:
        for heading in range(space.shape[0]):
            search(heading)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(search, range(space.shape[0])))
    return Accumulator(moments, space, prior)


@dataclass(frozen=True, slots=True)
class _Field:
    """What all headings share: the levelled scan and the tiles it can fall in.

    Parameters
    ----------
    levelled : LevelledScan
        n points, sorted so that neighbours follow each other: they read the same voxels. With weights of
        one, all normals point up.
    ranks : array, shape (n,)
        Number of each point's height layer among those of the scan.
    tiles : dict
        Tiles by their slot in the grid, with the layer each rank has in the tile (-1 for none), and the
        normals, shape (m, 3), that weights are cosines with: the voxels', or up with weights of one.
    corner, shape : tuple of 2 int
        Key (x, y) of the first tile of the grid that covers the tiles, and its size (ny, nx).
    cell : float
        Voxel edge of the map, m: that of the space may differ from it by rounding.
    is_once, is_signed : bool
        Whether a voxel counts once, and whether the map's normals have a side.
    """

    levelled: LevelledScan
    ranks: NDArray[np.int64]
    tiles: dict[int, tuple[VoxelTile, NDArray[np.int64], NDArray[np.float32]]]
    corner: TileKey
    shape: tuple[int, int]
    cell: float
    is_once: bool
    is_signed: bool

    @classmethod
    def prepare(
        cls,
        scan: Scan,
        point_map: PointMap,
        prior: Pose,
        space: SearchSpace,
        multiplicity: Multiplicity,
        weighting: Weighting,
    ) -> "_Field":
        levelled = level(scan, prior)
        cell = point_map.cell
        layers = voxel_indices(levelled.points, cell)[:, 2]
        order = _reading_order(levelled.points, layers, 64 * cell)
        levelled = LevelledScan(levelled.points[order], _directions(levelled.normals[order], weighting))
        scan_layers, ranks = np.unique(layers[order], return_inverse=True)
        reach = float(np.hypot(*levelled.points[:, :2].T).max(initial=0.0)) + space.reach + cell
        _check_indices(prior, reach, cell)
        tiles = tiles_met(levelled.points, point_map, prior, space)
        keys = np.array([tile.key for tile in tiles], dtype=np.int64).reshape(-1, 2)
        corner = keys.min(axis=0, initial=2**31)
        nx, ny = keys.max(axis=0, initial=-(2**31)) - corner + 1 if tiles else (0, 0)
        slots = (keys[:, 1] - corner[1]) * nx + keys[:, 0] - corner[0]
        return cls(
            levelled,
            ranks,
            {
                int(slot): (tile, _layers_in(tile, scan_layers), _directions(tile.normals, weighting))
                for slot, tile in zip(slots, tiles, strict=True)
            },
            (int(corner[0]), int(corner[1])),
            (int(ny), int(nx)),
            cell,
            multiplicity is Multiplicity.OCCUPIED,
            point_map.is_signed,
        )


def _reading_order(points: NDArray[np.float64], layers: NDArray[np.int32], edge: float) -> NDArray[np.int64]:
    """Order of points by height layer, then by squares of this edge (m) along y and x."""
    if len(points) == 0:
        return np.empty(0, np.int64)
    places = np.floor(points[:, :2] / edge)
    columns = [layers.astype(np.float64), places[:, 1], places[:, 0]]
    sizes = [float(column.max() - column.min() + 1.0) for column in columns]
    if math.prod(sizes) >= 2.0**53:  # too far apart for one number each, which sorts faster
        return np.lexsort(columns[::-1])
    number = np.zeros(len(points))
    for column, size in zip(columns, sizes, strict=True):
        number = number * size + (column - column.min())
    return np.argsort(number.astype(np.int64), kind="stable")


def _directions(normals: NDArray[_Float], weighting: Weighting) -> NDArray[_Float]:
    """Unit vectors, shape (n, 3), whose cosines are the weights: the normals, or up at both sides (D5).

    The cosine of up with up, at any heading, is 1 without rounding: the kernel needs no second way.
    """
    if weighting is Weighting.COSINE:
        return normals
    up = np.zeros_like(normals)
    up[:, 2] = 1.0
    up.flags.writeable = normals.flags.writeable  # the kernel is compiled once for each of the two
    return up


def _check_indices(prior: Pose, reach: float, cell: float) -> None:
    """Refuse a prior so far out that voxels within reach have no index."""
    voxel_indices(prior.position + [[-reach, -reach, 0.0], [reach, reach, 0.0]], cell)


def _layers_in(tile: VoxelTile, scan_layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Number of each layer of the scan among the tile's, -1 where the tile has none."""
    layers = tile.index.layers
    numbers = np.minimum(np.searchsorted(layers, scan_layers), len(layers) - 1)
    return np.where(layers[numbers] == scan_layers, numbers, -1)


def _search_heading(field: _Field, prior: Pose, space: SearchSpace, heading: int) -> NDArray[np.float64]:
    """Moments of one heading, shape (ny, nx, 4)."""
    from maxcon.search import kernels

    _, ny, nx = space.shape
    rim = PATCH_VOXELS - 1
    sums = np.zeros((ny + 2 * rim, nx + 2 * rim, 4))
    angle = prior.heading + space.headings[heading]
    points, normals = field.levelled.points, field.levelled.normals
    columns = np.empty((len(points), 2), np.int64)
    turned = np.empty((len(points), 3), np.float32)
    kernels.turn_to_voxels(
        points, normals, np.cos(angle), np.sin(angle), prior.x, prior.y, field.cell, columns, turned
    )
    first, last = -(nx // 2), nx - 1 - nx // 2
    starts, numbers = kernels.points_of_tiles(columns, first, last, field.corner, field.shape)
    for slot, (tile, layers, directions) in field.tiles.items():
        kernels.accumulate_tile(
            numbers[starts[slot] : starts[slot + 1]], columns, field.ranks, layers, turned,
            (tile.key[0] * TILE_VOXELS, tile.key[1] * TILE_VOXELS), tile.index.patch_starts,
            tile.columns, directions, tile.index.factors, tile.counts[:0] if field.is_once else tile.counts,
            (first, nx), field.is_signed, sums.reshape(-1),
        )  # fmt: skip
    return sums[rim : rim + ny, rim : rim + nx]
