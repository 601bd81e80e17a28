# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Normals of a map from files: fitted to known surfaces, turned to the sensor, or taken from the sources."""

import numpy as np
from built_maps import CELL, assert_same_voxels, axis_errors_deg, sorted_voxels, trajectory_at

from maxcon import PointMap
from maxcon.mapping.build import MapOptions, build_map


def test_there_is_no_seam_at_a_tiles_border(tmp_path, cloud_files):
    """The same points with the border elsewhere: the same normals, to rounding."""
    cell = 0.0625  # tiles of 32 m; coordinates are multiples of 2^-10, so that a move by 16 m is exact
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(30, 34, 3000), rng.uniform(30, 34, 3000), rng.uniform(1, 3, 3000)])
    points[:1500, 1] = 0.5 * points[:1500, 0] + 16.0 + rng.normal(0, 0.01, 1500)
    points[1500:2500, 0] = 32.02 + rng.normal(0, 0.01, 1000)
    points = np.round(points * 1024) / 1024
    maps = []
    for name, shift in (("border", 0), ("middle", 16.0)):
        path = cloud_files.npz(tmp_path / f"{name}.npz", points + [shift, shift, 0.0])
        build_map([path], tmp_path / f"{name}.map", MapOptions(cell=cell))
        maps.append(PointMap.open(tmp_path / f"{name}.map"))
    assert [len(one.tile_keys) for one in maps] == [4, 1]
    (indices, counts, normals), (others, other_counts, other_normals) = map(sorted_voxels, maps)
    np.testing.assert_array_equal(indices + [256, 256, 0], others)
    np.testing.assert_array_equal(counts, other_counts)
    np.testing.assert_allclose(normals, other_normals, atol=1e-6)
    assert normals.any(axis=1).mean() > 0.5


def test_both_sides_of_a_thin_wall_are_turned_to_who_saw_them(tmp_path, cloud_files, surfaces):
    """A wall of 20 cm, seen from the south at first and from the north later."""
    south, _ = surfaces.wall(8000, (10, 20.0), (20, 20.0), noise=0.003)
    north, _ = surfaces.wall(8000, (10, 20.2), (20, 20.2), noise=0.003, seed=1)
    times = np.r_[np.random.default_rng(0).uniform(0, 10, 8000), np.random.default_rng(1).uniform(20, 30, 8000)]
    path = cloud_files.las(tmp_path / "a.laz", np.concatenate([south, north]), times=times)
    at = np.arange(0.0, 30.5, 0.25)
    y = np.where(at < 15, 15.0, 26.0)
    trajectory = trajectory_at(at, surfaces.origin + np.column_stack([10 + at % 10, y, np.full(len(at), 1.8)]))
    build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory))
    opened = PointMap.open(tmp_path / "a.map")
    assert opened.is_signed
    indices, _, normals = opened.all_voxels()
    y_of_voxel = (indices[:, 1] + 0.5) * CELL + opened.frame.origin[1] - surfaces.origin[1]
    for is_side, towards in ((y_of_voxel < 20.06, -1.0), (y_of_voxel > 20.14, 1.0)):
        has_normal = is_side & normals.any(axis=1)
        assert has_normal.sum() > 0.95 * is_side.sum()
        assert (normals[has_normal, 1] * towards > 0.0).mean() > 0.995
        assert np.median(normals[has_normal, 1] * towards) > 0.98


def test_isolated_points_and_lines_have_no_normal(tmp_path, cloud_files, surfaces):
    origin = surfaces.origin
    alone = origin + np.array([[5.0, 5.0, 1.0], [25.0, 5.0, 1.0], [5.0, 25.0, 1.0]])
    line = origin + np.column_stack([np.linspace(10, 20, 2000), np.full(2000, 15.03), np.full(2000, 2.03)])
    build_map([cloud_files.npz(tmp_path / "a.npz", np.concatenate([alone, line]))], tmp_path / "a.map")
    _, counts, normals = PointMap.open(tmp_path / "a.map").all_voxels()
    assert counts.sum() == 2003
    assert not normals.any()


def test_own_normals_with_sides_are_averaged_as_in_memory(tmp_path, cloud_files, scene):
    normals = np.random.default_rng(5).normal(size=scene.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    path = cloud_files.ply(tmp_path / "a.ply", scene, normals)
    manifest = build_map([path], tmp_path / "a.map", MapOptions(cell=CELL, normals_have_sides=True))
    opened = PointMap.open(tmp_path / "a.map")
    local = scene - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, normals, CELL))
    assert opened.is_signed
    assert manifest.build["normals"] == "of the sources"


def test_own_normals_whose_side_is_not_known_are_fitted_anew_or_turned_by_a_trajectory(tmp_path, cloud_files, surfaces):
    points, true = surfaces.wall(8000, (10, 20), (20, 20), noise=0.003)
    signs, times = np.random.default_rng(0).choice([-1.0, 1.0], (len(points), 1)), np.linspace(0, 9.9, len(points))
    path, at = cloud_files.npz(tmp_path / "a.npz", points, normals=true * signs, times=times), np.arange(0, 10.1, 0.2)
    trajectory = trajectory_at(at, surfaces.origin + np.column_stack([10 + at, 0 * at + 14, 0 * at + 1.8]))
    fitted = build_map([path], tmp_path / "a.map")
    turned = build_map([path], tmp_path / "b.map", MapOptions(trajectory=trajectory))
    assert (fitted.is_signed, turned.is_signed) == (False, True)
    assert (fitted.build["normals"], turned.build["normals"]) == ("from neighbourhoods", "of the sources")
    normals = PointMap.open(tmp_path / "a.map").all_voxels()[2]
    assert np.median(axis_errors_deg(normals, true[0])[normals.any(axis=1)]) < 3.0
    normals = PointMap.open(tmp_path / "b.map").all_voxels()[2]
    np.testing.assert_allclose(normals, np.tile([0.0, -1.0, 0.0], (len(normals), 1)), atol=1e-6)
