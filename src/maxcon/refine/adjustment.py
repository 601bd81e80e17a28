"""Adjustment of a pose to the surfaces of the map: robust, point to plane, all six unknowns; and its covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.map import PointMap
from maxcon.map.voxel_table import VoxelTable
from maxcon.scan import Scan

__all__ = ["HEIGHT_SIGMA", "TILT_SIGMA", "Refined", "covariance", "map_covariance", "refine"]


class Pass(NamedTuple):
    """How partners (planes of the map) are looked for in one pass."""

    along: int  # voxels along the normal of a point, at most
    around: int  # voxels along the axes from a point without a normal
    gate: float  # distance from which on a partner does not count, m
    n_points: float  # about so many points are used


# From large cells, which are off by up to a metre and 1.6 degrees: few points, and distant partners at first.
FROM_LARGE_CELLS = (
    Pass(9, 5, gate=1.0, n_points=450),
    Pass(9, 5, gate=1.0, n_points=450),
    Pass(9, 5, gate=0.6, n_points=450),
    Pass(5, 3, gate=0.36, n_points=650),
    Pass(5, 3, gate=0.21, n_points=650),
)
LAST_PASSES = (Pass(4, 2, gate=0.21, n_points=1700), *[Pass(2, 1, gate=0.21, n_points=math.inf)] * 2)
# From small cells, which are off by an edge and half a heading step.
PASSES = (
    Pass(5, 3, gate=0.6, n_points=650),
    Pass(5, 3, gate=0.36, n_points=650),
    Pass(5, 3, gate=0.36, n_points=650),
    Pass(5, 3, gate=0.21, n_points=650),
    *LAST_PASSES,
)
STEPS_PER_PASS = 2
AT_REST = 1e-4  # a pass ends with a step that moves by less than this, m, and turns by less than a hundredth of it, rad
LEAST_COSINE = 0.8  # of the angle between the normals of a point and of its partner
REACH = 1.0
"""How far points may move while a pose is adjusted, m: map tiles within it of the scan are searched for partners."""
MATCH_SIGMA = 0.05  # standard deviation of one point-to-plane distance, m: the weight of the start is relative to it
POSITION_SIGMA, HEADING_SIGMA = 1.0, math.radians(5.0)
"""The start is an observation too, with these standard deviations, m and rad: weak, but it fixes any open direction."""
HEIGHT_SIGMA, TILT_SIGMA = 0.3, math.radians(1.0)
"""The same for height, roll and pitch, where nothing better is known of the start, m and rad."""

CLUSTER_EDGE = 3.0
"""Edge, m, of the cubes within which points of one orientation bin are off together; walls are this deep."""
N_BINS = 12  # orientation bins: sectors of azimuth, of a full turn, that normals are sorted into
STEEPEST = 0.7
"""Normals with a larger vertical part are up or down, which is one bin more; others are sorted by azimuth."""
SCATTER_FACTORS = np.array([1.2, 1.2, 1.35, 1.35, 1.35, 1.2])
"""True standard deviations of x, y, z, roll, pitch and heading over those that clusters predict, measured.

1.2 where walls hold the pose: of several planes a point takes the nearest, so residuals look smaller and the pose
better held than they are. 1.35 for height and tilts: the noise of walls' normals looks like knowledge of these, too.
"""
WALL_RATIO = 0.3
"""Standard deviation of one wall's position relative to the others, over the map's sigma: few passes saw both."""
TILT_LENGTH, TURN_LENGTH = 20.0, 50.0
"""The map tilts and turns a pose by its sigma over these lengths, m; the second as headings of real drives scatter."""


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A pose adjusted to the map, and the n points (sensor frame) and planes that determine it.

    Planes, (n, 4), local frame: unit normal and offset, zeros where a point has none; residuals are infinite there.
    The normal matrix is of x, y, z, roll, pitch and heading; `start_weights` is what the start adds to its diagonal.
    """

    pose: Pose  # T_map_sensor, local frame
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    planes: NDArray[np.float64]
    residuals: NDArray[np.float64]  # (n,), signed distances, m
    weights: NDArray[np.float64]  # (n,), 0 to 1
    normal_matrix: NDArray[np.float64]
    start_weights: NDArray[np.float64]
    moved: float  # from the start in x and y, m
    turned: float  # from the start in heading, rad

    @property
    def n_planes(self) -> int:
        """How many points lie on a plane of the map, so near that they have a weight."""
        return int(np.count_nonzero(self.weights))


def refine(
    scan: Scan,
    point_map: PointMap,
    start: Pose,
    *,
    height_sigma: float = HEIGHT_SIGMA,
    tilt_sigma: float = TILT_SIGMA,
    passes: Sequence[Pass] = PASSES,
    table: VoxelTable | None = None,
) -> Refined:
    """Adjust a pose to the map: minimize Tukey-weighted squares of point-to-plane distances n . r, in all six unknowns.

    Each point of the scan's sample has one partner at a time: along its normal the nearest plane that agrees, without a
    normal that of the nearest mean along the axes. The start is within 0.2 m and a degree; sigmas, m and rad, hold it.
    """
    sample = scan.sample
    if table is None:
        table = table_around(sample, point_map, [start])
    return refine_sample(sample, point_map, table, start, weights_of_start(height_sigma, tilt_sigma), passes)


def refine_sample(
    sample: Scan, point_map: PointMap, table: VoxelTable, start: Pose, start_weights: NDArray[np.float64],
    passes: Sequence[Pass],
) -> Refined:  # fmt: skip
    """Adjust a pose to the map by all points of a scan; see `refine` and `weights_of_start`."""
    from maxcon.refine import kernels

    points = sample.points
    unknowns, planes = adjusted(sample, point_map, table, start, start_weights, passes)
    normal_matrix, residuals, weights = np.empty((6, 6)), np.empty(len(points)), np.empty(len(points))
    kernels.weigh(points, planes, unknowns, passes[-1].gate, normal_matrix, residuals, weights)
    moved, turned = math.hypot(unknowns[0] - start.x, unknowns[1] - start.y), abs(unknowns[5] - start.heading)
    return Refined(
        Pose(*unknowns.tolist()), points, sample.normals, planes, residuals, weights, normal_matrix, start_weights,
        moved, turned,
    )  # fmt: skip


def weights_of_start(height_sigma: float, tilt_sigma: float) -> NDArray[np.float64]:
    """What the start, being an observation too, adds to the diagonal of the normal matrix, shape (6,)."""
    sigmas = [POSITION_SIGMA, POSITION_SIGMA, height_sigma, tilt_sigma, tilt_sigma, HEADING_SIGMA]
    return (MATCH_SIGMA / np.array(sigmas)) ** 2


def adjusted(
    sample: Scan, point_map: PointMap, table: VoxelTable, start: Pose, start_weights: NDArray[np.float64],
    passes: Sequence[Pass],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Unknowns, (6,), of a pose adjusted in some passes, and the planes, (n, 4), of the points of the last one."""
    from maxcon.refine import partner_kernels

    unknowns, n = start.values, len(sample)
    ways = np.array([(along, around, gate, max(1, round(n / used))) for along, around, gate, used in passes])
    planes = partner_kernels.adjust_in_passes(
        sample.points, sample.normals, unknowns, start_weights, ways, point_map.cell, LEAST_COSINE,
        point_map.is_signed, STEPS_PER_PASS, AT_REST, table,
    )  # fmt: skip
    return unknowns, planes


def planes_near(
    points: NDArray[np.float64], normals: NDArray[np.float64], pose: Pose, gate: float, point_map: PointMap,
    table: VoxelTable, *, with_all: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Planes, (n, 4), along the normals of points at a pose, and distances from them, m, infinite from a gate on.

    points, normals: (n, 3), sensor frame; with_all: also for points without a normal, along the axes.
    """
    from maxcon.refine import partner_kernels

    along = max(2, math.ceil(gate / point_map.cell))
    reaches = along, along * with_all
    planes = partner_kernels.find_partners(
        points, normals, pose.values, point_map.cell, reaches, LEAST_COSINE, point_map.is_signed, table
    )
    distances = planes[:, 3] - np.einsum("ij,ij->i", planes[:, :3], pose.apply(points))
    is_near = planes[:, :3].any(axis=1) & (np.abs(distances) < gate)
    return planes, np.where(is_near, distances, np.inf)


def table_around(sample: Scan, point_map: PointMap, poses: Sequence[Pose]) -> VoxelTable:
    """The voxels among which the points of a scan can have partners, near some poses."""
    return point_map.table_of(point_map.keys_around(sample.points, REACH, poses))


def covariance(refined: Refined, map_sigma: float) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch and heading, shape (6, 6), map axes, m^2, m rad and rad^2.

    A cluster-robust sandwich, as points of one surface are off together; plus a part of `map_sigma` (m) for each whole
    wall; plus `map_sigma` for the map as a whole.
    """
    from maxcon.refine import kernels

    def outer_sums(n_groups: int, groups: NDArray[np.int64], factors: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.zeros((n_groups, 6))
        kernels.sum_gradients(refined.points, refined.planes, groups, refined.pose.values, factors, sums)
        return sums.T @ sums

    clusters, walls = (np.empty(len(refined.points), np.int64) for _ in range(2))
    n_clusters, n_walls = kernels.number_groups(
        refined.points, refined.planes, refined.weights, refined.pose.position, CLUSTER_EDGE, N_BINS, STEEPEST,
        clusters, walls,
    )  # fmt: skip
    A_inv = np.linalg.inv(refined.normal_matrix + np.diag(refined.start_weights))
    weighted = np.zeros(len(refined.points))
    np.multiply(refined.weights, refined.residuals, out=weighted, where=refined.weights > 0.0)
    scatter = outer_sums(n_clusters, clusters, weighted) + np.diag(refined.start_weights) * MATCH_SIGMA**2
    of_scatter = SCATTER_FACTORS[:, None] * (A_inv @ scatter @ A_inv) * SCATTER_FACTORS
    of_walls = (WALL_RATIO * map_sigma) ** 2 * A_inv @ outer_sums(n_walls, walls, refined.weights) @ A_inv
    return np.asarray(of_scatter + of_walls + map_covariance(map_sigma), dtype=np.float64)


def map_covariance(map_sigma: float) -> NDArray[np.float64]:
    """Covariance, shape (6, 6), that a map's own error, `map_sigma` (m) along any axis, adds to that of a pose."""
    tilt, turn = map_sigma / TILT_LENGTH, map_sigma / TURN_LENGTH
    return np.diag(np.array([map_sigma, map_sigma, map_sigma, tilt, tilt, turn]) ** 2)
