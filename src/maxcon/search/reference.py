"""The definition: plain NumPy, to be read beside the paper (D4, D7).

Slow on purpose. Every faster search must give the same accumulator as `voxels`; `pairs` is equation (2) to the letter
and needs no voxels. `consensus_set` says which scan points are counted at one cell.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.geometry import Pose, voxel_centers, voxel_indices
from maxcon.geometry.arrays import as_points, as_unit_normals
from maxcon.map import PointMap
from maxcon.map.voxelize import mean_normals, turn_alike
from maxcon.scan import Scan
from maxcon.search.accumulator import (
    CONTRIBUTION_STEP,
    Accumulator,
    Multiplicity,
    Weighting,
    cells_of,
    check_one_height,
    turn,
    upright,
)
from maxcon.search.space import Cell, SearchSpace

__all__ = ["consensus_set", "pairs", "voxels"]


def pairs(
    scan: Scan,
    points_map: ArrayLike,
    normals_map: ArrayLike,
    prior: Pose,
    space: SearchSpace,
    *,
    threshold: float,
    multiplicity: str | Multiplicity = Multiplicity.POINTS,
    weighting: str | Weighting = Weighting.COSINE,
    is_signed: bool = True,
) -> Accumulator:
    """Moments of every cell from all pairs of a scan point and a map point, equation (2).

    Parameters
    ----------
    scan : Scan
        n points with normals, sensor frame.
    points_map, normals_map : array_like, shape (m, 3)
        Local frame, m; unit normals (zeros for none).
    prior : Pose
        T_map_sensor before localization, local frame.
    space : SearchSpace
        The cells to try, of one height.
    threshold : float
        A pair matches if its l-infinity distance is at most this, m. The paper takes the cell edge; with
        half of it each pair votes for one cell.
    multiplicity : {"points", "occupied"}
        Whether each pair of a scan point counts, or all of them count once, with their mean normal.
    weighting : {"cosine", "published", "one"}
        Weight of a match in N, see `Weighting` (D5).
    is_signed : bool
        Whether map normals are turned to the sensor's side; otherwise w = |n_scan . n_map| (D5).
    """
    check_one_height(space)
    points_map = as_points(points_map, "points_map")
    normals_map = as_unit_normals(normals_map, len(points_map), "normals_map")
    once = Multiplicity.parse(multiplicity) is Multiplicity.OCCUPIED
    weighting = Weighting.parse(weighting)
    scan_upright = upright(scan, prior)
    moments = np.zeros((*space.shape, 4))
    for h, heading in enumerate(prior.heading + space.headings):
        points_scan = turn(scan_upright.points, heading) + [prior.x, prior.y, 0.0]
        normals_scan = turn(scan_upright.normals, heading)
        for iy, offset_y in enumerate(space.offsets):
            for ix, offset_x in enumerate(space.offsets):
                shifted = points_scan + [offset_x, offset_y, 0.0]
                distances = np.abs(shifted[:, None, :] - points_map[None, :, :]).max(axis=2)
                i, j = np.nonzero(distances <= threshold)  # the indicator of equation (2)
                matched = normals_map[j]
                if once:
                    i, matched = _merge(i, matched, is_signed)
                weights = _weights(normals_scan[i], matched, is_signed, weighting)
                moments[h, iy, ix] = _moments(weights, matched, np.ones(len(i)))
    return Accumulator(moments, space, prior)


def voxels(
    scan: Scan,
    point_map: PointMap,
    prior: Pose,
    space: SearchSpace,
    *,
    multiplicity: str | Multiplicity = Multiplicity.OCCUPIED,
    weighting: str | Weighting = Weighting.COSINE,
) -> Accumulator:
    """Moments of every cell, a scan point matching the map voxel it falls in (D4).

    Parameters and errors as of `exhaustive`, which has the same result.
    """
    space = cells_of(space, point_map)
    check_one_height(space)
    once = Multiplicity.parse(multiplicity) is Multiplicity.OCCUPIED
    weighting = Weighting.parse(weighting)
    scan_upright = upright(scan, prior)
    indices, counts, normals_map = point_map.all_voxels()
    row_of = {tuple(index): row for row, index in enumerate(indices.tolist())}
    _, ny, nx = space.shape
    moments = np.zeros((*space.shape, 4))
    for h, heading in enumerate(prior.heading + space.headings):
        points_scan = turn(scan_upright.points, heading) + [prior.x, prior.y, 0.0]
        normals_scan = turn(scan_upright.normals, heading).astype(np.float32)
        base = voxel_indices(points_scan, point_map.cell)
        for iy in range(ny):
            for ix in range(nx):
                # A shift by one cell is a shift by one voxel.
                shifted = base + np.array([ix - nx // 2, iy - ny // 2, 0], dtype=np.int32)
                rows = np.array([row_of.get(tuple(index), -1) for index in shifted.tolist()], dtype=np.int64)
                i, j = np.flatnonzero(rows >= 0), rows[rows >= 0]
                times = np.ones(len(j)) if once else counts[j].astype(np.float64)
                weights = _weights(normals_scan[i], normals_map[j], point_map.is_signed, weighting)
                moments[h, iy, ix] = _moments(weights, normals_map[j], times)
    return Accumulator(moments, space, prior)


def consensus_set(scan: Scan, point_map: PointMap, prior: Pose, space: SearchSpace, cell: Cell) -> NDArray[np.bool_]:
    """Whether each of n scan points falls in a voxel of the map when the sensor is at `cell`, shape (n,).

    Parameters as of `voxels`; `cell` is the (heading, y, x) of one cell.
    """
    space = cells_of(space, point_map)
    heading, iy, ix = cell
    _, ny, nx = space.shape
    points = turn(upright(scan, prior).points, prior.heading + space.headings[heading]) + [prior.x, prior.y, 0.0]
    indices = voxel_indices(points, point_map.cell) + np.array([ix - nx // 2, iy - ny // 2, 0], dtype=np.int32)
    is_matched = np.zeros(len(indices), bool)
    if len(indices) == 0:
        return is_matched
    low, high = indices.min(axis=0), indices.max(axis=0)
    sizes = (high - low + 1).astype(np.int64)
    numbering = np.array([1, sizes[0], sizes[0] * sizes[1]])
    wanted = (indices - low).astype(np.int64) @ numbering
    centers = voxel_centers(indices, point_map.cell)
    for tile in map(point_map.tile, point_map.keys_around(centers, 0.0)):
        near = tile.voxels[((tile.voxels >= low) & (tile.voxels <= high)).all(axis=1)]
        is_matched |= np.isin(wanted, (near - low).astype(np.int64) @ numbering)
    return is_matched


def _weights(
    normals_scan: NDArray[np.floating], normals_map: NDArray[np.floating], is_signed: bool, weighting: Weighting
) -> NDArray[np.floating]:
    """Weights, the diagonal of P: max(0, n_scan . n_map), |n_scan . n_map| where the map has no side, or 1 (D5)."""
    if weighting is Weighting.ONE:
        return np.ones(len(normals_scan))
    cosines = (normals_scan * normals_map).sum(axis=1)
    weights: NDArray[np.floating] = np.maximum(0.0, cosines) if is_signed else np.abs(cosines)
    return np.where(normals_scan.any(axis=1), weights, weighting.without_normal)


def _moments(
    weights: NDArray[np.floating], normals: NDArray[np.floating], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Count and N = A^T P A, equation (4), of one cell's matches, each taken `times` times."""
    outer = normals[:, [0, 0, 1]] * normals[:, [0, 1, 1]]  # nx nx, nx ny, ny ny
    contributions = (times * weights.astype(np.float64))[:, None] * outer.astype(np.float64)
    contributions = np.rint(contributions / CONTRIBUTION_STEP) * CONTRIBUTION_STEP
    return np.array([times.sum(), *contributions.sum(axis=0)])


def _merge(
    i: NDArray[np.int64], normals: NDArray[np.float64], is_signed: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Let each scan point count once, with the mean unit normal of the map points it matches."""
    merged, group, counts = np.unique(i, return_inverse=True, return_counts=True)
    if not is_signed:
        normals = turn_alike(normals, group, len(merged))
    sums = np.array([normals[i == point].sum(axis=0) for point in merged]).reshape(-1, 3)
    return merged, mean_normals(sums, counts).astype(np.float64)
