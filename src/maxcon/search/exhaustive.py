# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The exhaustive search: the definition's accumulator, compiled (D5, D7)."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.accumulator import Accumulator
from maxcon.errors import OptionError, SearchSpaceError
from maxcon.geometry import Pose, voxel_indices
from maxcon.point_map import TILE_VOXELS, PointMap, TileKey, VoxelTile
from maxcon.scan import Scan
from maxcon.search.matching import Multiplicity, Weighting, check_cell_edge, level
from maxcon.search_space import SearchSpace

__all__ = ["exhaustive"]

# An accumulator takes 32 bytes a cell; 2^26 cells are 2 GiB.
CELL_LIMIT = 2**26

# Headings searched in one pass over the map share what is read of it; their sums take 32 MiB at most, unless
# one heading alone takes more.
PASS_HEADINGS, PASS_CELLS = 16, 2**20


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
    moments = np.empty((*space.shape, 4))
    n_passes = _n_passes(space, n_threads)

    def search(number: int) -> None:
        first, end = (part * space.shape[0] // n_passes for part in (number, number + 1))
        _search_headings(field, prior, space, first, moments[first:end])

    if n_threads == 1 or n_passes == 1:
        for number in range(n_passes):
            search(number)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(search, range(n_passes)))
    return Accumulator(moments, space, prior)


def _n_passes(space: SearchSpace, n_threads: int) -> int:
    """How many parts the headings are searched in: as few as memory allows, and a multiple of the threads."""
    n_headings = space.shape[0]
    most = min(PASS_HEADINGS, max(1, PASS_CELLS * n_headings // space.n_cells))
    n_rounds = -(-n_headings // (most * n_threads))
    return min(n_headings, n_rounds * n_threads)


@dataclass(frozen=True, slots=True)
class _Field:
    """What all headings share: the levelled scan and the tiles it can fall in.

    Points of one height layer in one square of SQUARE_VOXELS voxels, at the prior's heading, are a group.
    Those with a normal come first in it, those in one voxel follow each other; neighbouring groups read the
    same voxels. With weights of one all points count as if they had a normal.

    Parameters
    ----------
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
    cell : float
        Voxel edge of the map, m: that of the space may differ from it by rounding.
    is_once, is_weighted, is_signed : bool
        Whether a voxel counts once, whether weights are cosines, and whether the map's normals have a side.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    starts: NDArray[np.int64]
    middles: NDArray[np.int64]
    ranks: NDArray[np.int64]
    tiles: dict[int, tuple[VoxelTile, NDArray[np.int64]]]
    corner: TileKey
    shape: tuple[int, int]
    cell: float
    is_once: bool
    is_weighted: bool
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
        is_weighted = weighting is Weighting.COSINE
        layers = voxel_indices(levelled.points, cell)[:, 2]
        radii = np.hypot(levelled.points[:, 0], levelled.points[:, 1])
        _check_indices(prior, float(radii.max(initial=0.0)) + space.reach + cell, cell)
        points, normals = (
            np.ascontiguousarray(levelled.points[:, :2].T),
            np.ascontiguousarray(levelled.normals.T),
        )
        columns, _ = _turned(points, normals, prior, [prior.heading], cell)
        is_plain = np.asarray(~normals.any(axis=0) & is_weighted, dtype=np.bool_)
        order, starts = _groups(columns[0], layers, is_plain)
        n_plain = np.concatenate([[0], np.cumsum(is_plain[order])])
        scan_layers, ranks = np.unique(layers[order[starts[:-1]]], return_inverse=True)
        tiles = _tiles_met(point_map, space, columns[0].take(order, axis=1), radii[order], starts)
        keys = np.array([tile.key for tile in tiles], dtype=np.int64).reshape(-1, 2)
        corner = keys.min(axis=0, initial=2**31)
        nx, ny = keys.max(axis=0, initial=-(2**31)) - corner + 1 if tiles else (0, 0)
        slots = (keys[:, 1] - corner[1]) * nx + keys[:, 0] - corner[0]
        return cls(
            points.take(order, axis=1),
            normals.take(order, axis=1),
            starts,
            starts[1:] - np.diff(n_plain[starts]),
            ranks,
            {
                int(slot): (tile, _layers_in(tile, scan_layers))
                for slot, tile in zip(slots, tiles, strict=True)
            },
            (int(corner[0]), int(corner[1])),
            (int(ny), int(nx)),
            cell,
            multiplicity is Multiplicity.OCCUPIED,
            is_weighted,
            point_map.is_signed,
        )


def _groups(
    columns: NDArray[np.int32], layers: NDArray[np.int32], is_plain: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of points by square, height layer, whether they lack a normal, y and x; first point of each group."""
    from maxcon.search.visit_kernels import SQUARE_VOXELS

    if columns.shape[1] == 0:
        return np.empty(0, np.int64), np.zeros(1, np.int64)
    (x, y), (square_x, square_y) = columns, columns // SQUARE_VOXELS
    places = (y - square_y * SQUARE_VOXELS) * SQUARE_VOXELS + x - square_x * SQUARE_VOXELS
    parts = [square_y, square_x, layers, is_plain, places]
    lows = [int(part.min()) for part in parts]
    sizes = [int(part.max()) - low + 1 for part, low in zip(parts, lows, strict=True)]
    if math.prod(sizes) < 2**63:  # one number for each point sorts faster
        number = np.zeros(len(x), np.int64)
        for part, low, size in zip(parts, lows, sizes, strict=True):
            number *= size
            number += part
            number -= low
        order = np.argsort(number)
    else:
        order = np.lexsort(parts[::-1])
    is_first = np.ones(len(x), bool)
    is_first[1:] = np.any([part[order[1:]] != part[order[:-1]] for part in parts[:3]], axis=0)
    return order, np.append(np.flatnonzero(is_first), len(x))


def _tiles_met(
    point_map: PointMap,
    space: SearchSpace,
    columns: NDArray[np.int32],
    radii: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> list[VoxelTile]:
    """Tiles that any group can fall in at any cell, from its voxels (2, n) and distances (n,), m, at the prior."""
    if columns.shape[1] == 0:
        return []
    largest_turn = float(np.abs(space.headings).max())
    reach = np.maximum.reduceat(radii, starts[:-1]) * largest_turn + space.reach + point_map.cell
    low = np.minimum.reduceat(columns, starts[:-1], axis=1) * point_map.cell - reach
    high = (np.maximum.reduceat(columns, starts[:-1], axis=1) + 1) * point_map.cell + reach
    return point_map.tiles_met(low.T, high.T)


def _turned(
    points: NDArray[np.float64], normals: NDArray[np.float64], prior: Pose, headings: ArrayLike, cell: float
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Voxel columns (h, 2, n) and normals (h, 3, n) of a levelled scan at h headings, in the map's axes."""
    from maxcon.search import visit_kernels

    headings = np.asarray(headings)
    columns = np.empty((len(headings), *points.shape), np.int32)
    turned = np.empty((len(headings), *normals.shape), np.float32)
    for i, heading in enumerate(headings):
        visit_kernels.turn_to_voxels(
            points, normals, np.cos(heading), np.sin(heading), prior.x, prior.y, cell, columns[i], turned[i]
        )
    return columns, turned


def _check_indices(prior: Pose, reach: float, cell: float) -> None:
    """Refuse a prior so far out that voxels within reach have no index."""
    voxel_indices(prior.position + [[-reach, -reach, 0.0], [reach, reach, 0.0]], cell)


def _layers_in(tile: VoxelTile, scan_layers: NDArray[np.int32]) -> NDArray[np.int64]:
    """Number of each layer of the scan among the tile's, -1 where the tile has none."""
    layers = tile.index.layers
    numbers = np.minimum(np.searchsorted(layers, scan_layers), len(layers) - 1)
    return np.where(layers[numbers] == scan_layers, numbers, -1)


def _search_headings(
    field: _Field, prior: Pose, space: SearchSpace, first_heading: int, moments: NDArray[np.float64]
) -> None:
    """Moments of some headings, shape (headings, ny, nx, 4), out."""
    from maxcon.search import kernels, visit_kernels

    n_headings, ny, nx, _ = moments.shape
    headings = prior.heading + space.headings[first_heading : first_heading + n_headings]
    columns, turned = _turned(field.points, field.normals, prior, headings, field.cell)
    first, last = -(nx // 2), nx - 1 - nx // 2
    visits = visit_kernels.plan_visits(field.starts, columns)
    starts, numbers = visit_kernels.visits_of_tiles(visits, first, last, field.corner, field.shape)
    rim = visit_kernels.RIM
    width = nx + 2 * rim
    width += (2 - width) % 4  # an odd number of cache lines: cells above each other do not share a cache set
    sums = _aligned_zeros((n_headings, ny + 2 * rim, width, 4))
    for slot, (tile, layers) in field.tiles.items():
        kernels.accumulate_tile(
            numbers[starts[slot] : starts[slot + 1]], visits, field.starts, field.middles, field.ranks, layers,
            columns, turned, (tile.key[0] * TILE_VOXELS, tile.key[1] * TILE_VOXELS), tile.index.patch_starts,
            tile.columns, tile.normals, tile.counts[:0] if field.is_once else tile.counts,
            (first, nx, width), field.is_weighted, field.is_signed, sums.reshape(n_headings, -1),
        )  # fmt: skip
    moments[...] = sums[:, rim : rim + ny, rim : rim + nx]


def _aligned_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin with a cache line, of which a cell of four takes one half then, and never two."""
    size = math.prod(shape)
    zeros = np.zeros(size + 7)
    skipped = -zeros.ctypes.data % 64 // 8
    return zeros[skipped : skipped + size].reshape(shape)
