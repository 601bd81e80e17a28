# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Candidates for new surfaces: voxels that drives have hit where the map has none."""

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.ground import GroundPatch
from maxcon.map.tile import VoxelLookup
from maxcon.mapping.build.bucketing import TileBuckets, point_records
from maxcon.mapping.build.tiles import voxel_tile
from maxcon.mapping.build.voxel_moments import LAYER, ROW, VoxelMoments, plane_normals, turn_to_side
from maxcon.mapping.update.options import UpdateOptions

NEAR_VOXELS = 2
"""A point up to so many voxels from one of the map, along each axis, may be of its surface: 12 cm at 6 cm."""
GROUND_CLEARANCE = 0.25
"""Above the ground, m: what lies lower is ground, whether the map has it or left it out."""
GROUND_FILL = 5.0
"""Where objects hid the ground, its height is that of the nearest known ground, up to so far away, m."""
BEHIND = (0.5, 15.0)
"""Range behind a new surface, m, in which the extension of the ray must meet a surface that the map has."""


def sort_unknown_points(
    ends: NDArray[np.float64], pose: Pose, point_map: PointMap, options: UpdateOptions, buckets: TileBuckets
) -> None:
    """Keep the ends of rays that lie near no surface of the map, above the ground, and in front of a known surface.

    The last condition tells a new object from surroundings that the map does not cover, such as the end of a side
    street or a house seen through a gap: only behind the new object does the map go on.

    `ends` (n, 3): local frame, m; `pose`: where the sensor was, local frame; `buckets`: takes the points with the
    directions to the sensor (`POINT`).
    """
    from maxcon.mapping.update.ray_kernels import are_far_from_voxels, hide_known_surfaces

    to_sensor = pose.position - ends
    distances = np.linalg.norm(to_sensor, axis=1)
    is_in_reach = (distances <= options.reach) & (distances > 0.0)
    ends, to_sensor, distances = ends[is_in_reach], to_sensor[is_in_reach], distances[is_in_reach]
    lookup = VoxelLookup.of(point_map.tiles_within(pose.x, pose.y, options.reach + BEHIND[1]))
    table = lookup.rows, lookup.grid, np.array(lookup.corner)
    is_far = np.empty(len(ends), bool)
    are_far_from_voxels(ends, NEAR_VOXELS, point_map.cell, *table, is_far)
    rows = np.flatnonzero(is_far)
    patch = point_map.ground_around(pose.x, pose.y, options.reach + BEHIND[1])
    rows = rows[~_are_on_ground(ends[rows], patch)]
    is_hiding = np.empty(len(rows), bool)
    hide_known_surfaces(
        pose.position, ends[rows], *BEHIND, point_map.cell, *table, patch.heights, np.array(patch.first), patch.edge,
        is_hiding,
    )  # fmt: skip
    rows = rows[is_hiding]
    directions = (to_sensor[rows] / distances[rows, None]).astype(np.float32)
    buckets.add(*point_records(ends[rows], directions, point_map.cell))


def _are_on_ground(points: NDArray[np.float64], patch: GroundPatch) -> NDArray[np.bool_]:
    """Whether each point lies on the ground, or below; none does where the map does not know the ground."""
    from scipy.ndimage import distance_transform_edt

    is_known = np.isfinite(patch.heights).any(axis=0)
    if not (is_known.any() and len(points)):
        return np.zeros(len(points), bool)
    far, (rows, columns) = distance_transform_edt(~is_known, return_indices=True)
    filled = patch.heights[:, rows, columns]
    filled[:, far * patch.edge > GROUND_FILL] = np.nan
    cells = np.floor(points[:, :2] / patch.edge).astype(np.int64) - patch.first
    # Height above each level of the ground; comparisons with NaN are false.
    above = points[:, 2] - filled[:, cells[:, 1], cells[:, 0]]
    is_near = (np.abs(above) <= GROUND_CLEARANCE).any(axis=0)
    return np.asarray(is_near | (above[0] < 0.0))


def candidates_of_tile(
    buckets: TileBuckets, key: TileKey, cell: float, options: UpdateOptions, *, is_signed: bool
) -> VoxelTile:
    """Return the voxels of a tile that have at least `least_looks` unknown points in and around them."""
    moments = VoxelMoments.from_records(buckets.records(key))
    moments = moments.select(_n_points_around(moments) >= options.least_looks)
    fitted = plane_normals(moments, cell, np.ones(len(moments), bool))
    normals = turn_to_side(fitted, moments.sides) if is_signed else fitted
    return voxel_tile(key, moments, normals.astype(np.float32), cell)


def _n_points_around(moments: VoxelMoments) -> NDArray[np.float64]:
    """How many points lie in each voxel and the 26 around it."""
    keys, before = moments.keys, np.concatenate([[0.0], np.cumsum(moments.counts)])
    total = np.zeros(len(keys))
    for dz in (-1, 0, 1):
        for dy in (-1, 0, 1):
            middle = keys + dz * LAYER + dy * ROW
            total += before[np.searchsorted(keys, middle + 1, "right")] - before[np.searchsorted(keys, middle - 1)]
    return total
