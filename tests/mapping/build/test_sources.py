# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Sources that do not fit each other, their CRS or the trajectory of the mapping sensor."""

import numpy as np
import pytest
from built_maps import CELL, left_over, trajectory_at

from maxcon import PointMap
from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.mapping.build import MapOptions, build_map


def test_the_crs_of_the_sources_is_the_maps(tmp_path, cloud_files, some_points):
    files = [cloud_files.las(tmp_path / f"{k}.laz", some_points, crs="EPSG:25832") for k in "ab"]
    build_map(files, tmp_path / "a.map")
    assert "25832" in PointMap.open(tmp_path / "a.map").frame.crs
    build_map(
        [cloud_files.npz(tmp_path / "a.npz", some_points)], tmp_path / "b.map", MapOptions(crs="EPSG:25832")
    )
    opened = PointMap.open(tmp_path / "b.map")
    assert "UTM zone 32N" in opened.frame.crs
    build_map([tmp_path / "a.npz", files[0]], tmp_path / "c.map", MapOptions(crs="EPSG:25832"))
    build_map([tmp_path / "a.npz"], tmp_path / "d.map")
    assert PointMap.open(tmp_path / "d.map").frame.crs is None


def test_sources_of_different_crs_are_refused(tmp_path, cloud_files, some_points):
    a = cloud_files.las(tmp_path / "a.laz", some_points, crs="EPSG:25832")
    b = cloud_files.las(tmp_path / "b.laz", some_points, crs="EPSG:25833")
    none = cloud_files.npz(tmp_path / "none.npz", some_points)
    degrees = cloud_files.las(tmp_path / "degrees.laz", some_points, crs="EPSG:4326")
    for sources, crs, words in (
        ([a, b], None, r"in one CRS, but .*a\.laz and .*b\.laz name different ones\. Reproject"),
        (
            [a, none],
            None,
            r"to name their CRS as .*a\.laz does, but .*none\.npz names none\. Say it with --crs",
        ),
        ([a], "EPSG:25833", r"a\.laz to be in the CRS given, EPSG:25833, but it names another"),
        ([degrees], None, r"projected CRS in metres, got WGS 84 in degree.*Reproject"),
        ([none], "EPSG:4326", "projected CRS in metres, got WGS 84"),
        ([none], "EPSG:2263", "projected CRS in metres, got .* in US survey foot"),
        ([none], "somewhere", "reference system such as EPSG:25832, or WKT, got 'somewhere'"),
    ):
        with pytest.raises(CrsError, match=words):
            build_map(sources, tmp_path / "x.map", MapOptions(crs=crs))
    assert not (tmp_path / "x.map").exists()


def test_a_trajectory_of_another_time_is_refused(tmp_path, cloud_files, some_points):
    path = cloud_files.las(tmp_path / "a.laz", some_points, times=np.linspace(1000, 1010, len(some_points)))
    trajectory = trajectory_at([0.0, 10.0], some_points[:2])
    with pytest.raises(TrajectoryError, match=r"0\.000 to 10\.000 s, but no point has a pose within 0\.5 s"):
        build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory))
    timeless = cloud_files.npz(tmp_path / "b.npz", some_points)
    with pytest.raises(OptionError, match=r"times in .*b\.npz to match with the trajectory, but it has none"):
        build_map([timeless], tmp_path / "a.map", MapOptions(trajectory=trajectory))
    assert left_over(tmp_path) == ["a.laz", "b.npz"]


@pytest.mark.parametrize("is_swapped", [True, False])
def test_a_trajectory_far_from_the_points_is_refused(tmp_path, cloud_files, some_points, is_swapped):
    path = cloud_files.las(tmp_path / "a.laz", some_points, times=np.linspace(0.0, 10.0, len(some_points)))
    elsewhere = some_points[:2][:, [1, 0, 2]] if is_swapped else some_points[:2] + [440_000.0, 0.0, 0.0]
    with pytest.raises(TrajectoryError, match=r"got x .* in the CRS of the map, and x and y in their places"):
        build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory_at([0.0, 10.0], elsewhere)))
    assert not (tmp_path / "a.map").exists()


def test_points_outside_the_trajectory_are_kept_without_a_side(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(4000, (10, 20), (20, 20), noise=0.003)
    times = np.where(points[:, 0] < surfaces.origin[0] + 15, 1.0, 100.0)
    path = cloud_files.las(tmp_path / "a.laz", points, times=times)
    trajectory = trajectory_at([0.9, 1.1], surfaces.origin + np.array([[15, 14, 1.8], [15, 14, 1.8]]))
    manifest = build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory))
    assert manifest.build["sources"][0]["n_without_side"] == np.count_nonzero(times == 100.0)
    opened = PointMap.open(tmp_path / "a.map")
    indices, _, normals = opened.all_voxels()
    x = (indices[:, 0] + 0.5) * CELL + opened.frame.origin[0] - surfaces.origin[0]
    assert not normals[x > 15.1].any()
    assert (normals[x < 14.9, 1] < -0.9).mean() > 0.95
