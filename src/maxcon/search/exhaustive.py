# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The exhaustive search: the definition's accumulator, compiled (D5, D7)."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from maxcon.accumulator import Accumulator
from maxcon.errors import SearchSpaceError
from maxcon.geometry import Pose
from maxcon.options import Multiplicity, Weighting
from maxcon.point_map import PointMap
from maxcon.scan import Scan
from maxcon.search.matching import cells_of, check_one_height, check_threads
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.window import Window
from maxcon.search_space import SearchSpace

__all__ = ["exhaustive", "moments_of_window"]

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
        The cells to try, of one height; at most 2^26 of them (2 GiB of moments).
    multiplicity : {"occupied", "points"}
        Whether a match weighs one, or as many as the voxel's map points (D4).
    weighting : {"cosine", "published", "one"}
        Weight of a match in N, see `Weighting` (D5).
    n_threads : int
        Headings are shared out among that many threads; the result does not depend on it (D8).

    Returns
    -------
    Accumulator
        Moments, shape (headings, ny, nx, 4), float64.

    Raises
    ------
    SearchSpaceError
        If the cell edge is not the map's, or the space has several heights or too many cells.
    OptionError
        If the multiplicity or the weighting is unknown or there is no thread.
    ArrayError
        If the prior lies so far out that voxels have no index there (64,000 km at 6 cm).
    """
    space = cells_of(space, point_map)
    check_one_height(space)
    multiplicity, weighting = Multiplicity.parse(multiplicity), Weighting.parse(weighting)
    check_threads(n_threads)
    if space.n_cells > CELL_LIMIT:
        raise SearchSpaceError(
            f"Expected at most {CELL_LIMIT:,} cells in an exhaustive search, got {space.n_cells:,}."
            " Narrow the search space, or enlarge the cell or the heading step."
        )
    prepared = PreparedScan.prepare(scan, point_map, prior, space, multiplicity, weighting)
    moments = moments_of_window(prepared, np.arange(len(space.headings)), Window.of(space), n_threads)
    return Accumulator(moments, space, prior)


def moments_of_window(
    prepared: PreparedScan, headings: NDArray[np.int64], window: Window, n_threads: int
) -> NDArray[np.float64]:
    """Moments of all cells of a window at some headings, by number, shape (headings, ny, nx, 4)."""
    moments = np.empty((len(headings), *window.shape, 4))
    n_passes = _n_passes(len(headings), math.prod(window.shape), n_threads)

    def search(number: int) -> None:
        first, end = (part * len(headings) // n_passes for part in (number, number + 1))
        _search_headings(prepared, headings[first:end], window, moments[first:end])

    if n_threads == 1 or n_passes == 1:
        for number in range(n_passes):
            search(number)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(search, range(n_passes)))
    return moments


def _n_passes(n_headings: int, n_cells: int, n_threads: int) -> int:
    """How many parts the headings are searched in: as few as memory allows, and a multiple of the threads."""
    most = min(PASS_HEADINGS, max(1, PASS_CELLS // n_cells))
    n_rounds = -(-n_headings // (most * n_threads))
    return min(n_headings, n_rounds * n_threads)


def _search_headings(
    prepared: PreparedScan, headings: NDArray[np.int64], window: Window, moments: NDArray[np.float64]
) -> None:
    """Moments of a window of cells at some headings, by number, shape (headings, ny, nx, 4), out."""
    from maxcon.search import kernels, visit_kernels

    n_headings, ny, nx, _ = moments.shape
    columns, normals = prepared.turned(headings)
    planned = prepared.planned(columns)
    rim = visit_kernels.RIM
    width = nx + 2 * rim
    width += (2 - width) % 4  # an odd number of cache lines: cells above each other do not share a cache set
    sums = _aligned_zeros((n_headings, ny + 2 * rim, width, 4))
    for met, voxels in prepared.visited(planned, window):
        kernels.accumulate_tile(
            tuple(met), tuple(planned), tuple(voxels), columns, normals, tuple(window), width,
            prepared.without_normal, prepared.is_signed, sums.reshape(n_headings, -1),
        )  # fmt: skip
    moments[...] = sums[:, rim : rim + ny, rim : rim + nx]


def _aligned_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin with a cache line, of which a cell of four takes one half then, and never two."""
    size = math.prod(shape)
    zeros = np.zeros(size + 7)
    skipped = -zeros.ctypes.data % 64 // 8
    return zeros[skipped : skipped + size].reshape(shape)
