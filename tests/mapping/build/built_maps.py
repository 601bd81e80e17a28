# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps built of files: their voxels side by side, and what lies beside them."""

import numpy as np

from maxcon import Pose, Trajectory

CELL = 0.06


def assert_same_voxels(one, other, *, normals_too=True):
    (indices, counts, normals), (others, other_counts, other_normals) = (sorted_voxels(each) for each in (one, other))
    np.testing.assert_array_equal(indices, others)
    np.testing.assert_array_equal(counts, other_counts)
    if normals_too:
        np.testing.assert_allclose(normals, other_normals, atol=1e-5)


def sorted_voxels(point_map):
    """Indices, counts and normals of the voxels, in order of the indices."""
    indices, counts, normals = point_map.all_voxels()
    order = np.lexsort(indices.T)
    return indices[order], counts[order], normals[order]


def files_of(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def left_over(folder):
    return sorted(path.name for path in folder.iterdir())


def axis_errors_deg(normals, true):
    return np.degrees(np.arccos(np.clip(np.abs((normals * true).sum(axis=1)), 0.0, 1.0)))


def trajectory_at(times, positions):
    return Trajectory.from_poses(times, [Pose(*position, 0.0, 0.0, 0.0) for position in positions])
