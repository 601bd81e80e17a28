"""Maps built of files: their voxels side by side, and what lies beside them."""

import numpy as np

from maxcon import PointMap, Pose, Trajectory

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


def sheet(x, y, height, spacing=0.04, seed=0):
    """Points on a surface of height(x, y) over ranges x and y, with 5 mm of noise."""
    at_x, at_y = (at.ravel() for at in np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)))
    noise = np.random.default_rng(seed).normal(0.0, 0.005, at_x.size)
    return np.column_stack([at_x, at_y, height(at_x, at_y) + noise])


def wall(x, y, bottom, top, spacing=0.04):
    """Points on an upright wall at `y` from bottom(x, y) on, `top` m high."""
    at_x, above = (at.ravel() for at in np.meshgrid(np.arange(*x, spacing), np.arange(0.0, top, spacing)))
    at_y = np.full(at_x.size, y)
    return np.column_stack([at_x, at_y, bottom(at_x, at_y) + above])


def height_of_ground(path, place):
    """Heights of the levels of the ground of a map at a place (3,), global, m, above that; NaN for none."""
    point_map = PointMap.open(path)
    x, y, z = point_map.frame.to_local([place])[0]
    return point_map.ground_around(x, y, 0.0).heights[:, 0, 0] - z
