# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Sources that do not fit each other or the trajectory, and points that are left out of a map: each is counted."""

import laspy
import numpy as np
import pytest
from built_maps import CELL, left_over, trajectory_at

from maxcon import PointMap
from maxcon.errors import CrsError, FileError, MapError, OptionError, TrajectoryError
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.options import class_name, parse_classes

ALL_CLASSES = {1, 2, 3, 4, 5, 6, 7, 18, 22, 64}


def test_the_crs_of_the_sources_is_the_maps(tmp_path, cloud_files, some_points):
    laz = cloud_files.las(tmp_path / "a.laz", some_points, crs="EPSG:25832")
    npz = cloud_files.npz(tmp_path / "a.npz", some_points)
    for number, (sources, crs, wanted) in enumerate(
        [([laz], None, "25832"), ([npz], "EPSG:25832", "UTM zone 32N"), ([npz, laz], "EPSG:25832", "UTM zone 32N")]
    ):
        build_map(sources, tmp_path / f"{number}.map", MapOptions(crs=crs))
        assert wanted in PointMap.open(tmp_path / f"{number}.map").frame.crs
    build_map([npz], tmp_path / "d.map")
    assert PointMap.open(tmp_path / "d.map").frame.crs is None


def test_sources_of_different_crs_are_refused(tmp_path, cloud_files, some_points):
    a = cloud_files.las(tmp_path / "a.laz", some_points, crs="EPSG:25832")
    b = cloud_files.las(tmp_path / "b.laz", some_points, crs="EPSG:25833")
    none = cloud_files.npz(tmp_path / "none.npz", some_points)
    degrees = cloud_files.las(tmp_path / "degrees.laz", some_points, crs="EPSG:4326")
    for sources, crs, words in (
        ([a, b], None, r"in one CRS, but .*a\.laz and .*b\.laz name different ones\. Reproject"),
        ([a, none], None, r"PROJ knows in .*none\.npz, as in .*a\.laz, got none\. Say which it is with --crs"),
        ([a], "EPSG:25833", r"in one CRS, but --crs EPSG:25833 and .*a\.laz name different ones"),
        ([degrees], None, r"projected CRS in metres, got WGS 84 in degree.*Reproject"),
        ([none], "EPSG:4326", "projected CRS in metres, got WGS 84"),
        ([none], "EPSG:2263", "projected CRS in metres, got .* in US survey foot"),
        ([none], "somewhere", "reference system such as EPSG:25832, or WKT, got 'somewhere'"),
    ):
        with pytest.raises(CrsError, match=words):
            build_map(sources, tmp_path / "x.map", MapOptions(crs=crs))
    assert not (tmp_path / "x.map").exists()


def test_a_folder_stands_for_its_clouds_but_not_for_texts(tmp_path, cloud_files, some_points):
    (tmp_path / "clouds").mkdir()
    for name, part in (("b.ply", some_points[::2]), ("a.npz", some_points[1::2])):
        getattr(cloud_files, name[2:])(tmp_path / "clouds" / name, part)
    (tmp_path / "clouds" / "trajectory.txt").write_text("0 1 2 3 0 0 0 1")
    manifest = build_map([tmp_path / "clouds"], tmp_path / "a.map")
    assert [source["name"] for source in manifest.build["sources"]] == ["a.npz", "b.ply"]
    assert manifest.n_points == len(some_points)
    with pytest.raises(FileError, match=r"each point cloud once, got .*b\.ply"):
        build_map([tmp_path / "clouds", tmp_path / "clouds" / "b.ply"], tmp_path / "b.map")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, match=r"Expected point clouds in .*empty \(\.las, .*\.pcd.*\), got none"):
        build_map([tmp_path / "empty"], tmp_path / "b.map")


def test_a_trajectory_that_does_not_fit_is_refused(tmp_path, cloud_files, some_points):
    def timed(name, start):
        times = np.linspace(start, start + 10.0, len(some_points))
        return cloud_files.las(tmp_path / name, some_points, times=times)

    here, timeless = some_points[:2], cloud_files.npz(tmp_path / "b.npz", some_points)
    far, elsewhere = r"got x .* in the CRS of the map, .*and x and y in their places", timed("c.las", 0.0)
    for path, positions, kind, words in (
        (timed("a.laz", 1000.0), here, TrajectoryError, r"0\.000 to 10\.000 s, but no point has a pose within 0\.5 s"),
        (timeless, here, OptionError, r"times in .*b\.npz to match with the trajectory, but it has none"),
        (elsewhere, here[:, [1, 0, 2]], TrajectoryError, far),
        (elsewhere, here + [440_000.0, 0.0, 0.0], TrajectoryError, far),
    ):
        with pytest.raises(kind, match=words):
            build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory_at([0.0, 10.0], positions)))
    assert left_over(tmp_path) == ["a.laz", "b.npz", "c.las"]


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


@pytest.fixture
def classified(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(1000, (10, 20), (20, 20))
    return cloud_files.las(tmp_path / "classified.laz", points, classes=np.repeat(sorted(ALL_CLASSES), 100))


@pytest.mark.parametrize(
    ("options", "dropped"),
    [
        ({}, {2, 3, 4, 5, 7, 18, 22}), ({"vehicle_classes": (64,)}, {2, 3, 4, 5, 7, 18, 22, 64}),
        ({"drop": ["Vegetation", "6"]}, {3, 4, 5, 6}), ({"drop": ["high_vegetation", "NOISE"]}, {5, 7, 18}),
        ({"drop": ["vehicles"], "vehicle_classes": iter([64, 22])}, {22, 64}), ({"drop": []}, set()),
    ],
)  # fmt: skip
def test_classes_are_dropped_by_name_and_number(tmp_path, classified, options, dropped):
    manifest = build_map([classified], tmp_path / "a.map", MapOptions(**options))
    (source,) = manifest.build["sources"]
    assert manifest.n_points == 100 * len(ALL_CLASSES - dropped) == source["n_kept"]
    assert source["n_dropped"] == {str(number): 100 for number in sorted(dropped)}
    assert source["is_classified"]


def test_the_default_drops_nothing_where_classes_are_not_the_asprs_s(tmp_path, cloud_files, some_points):
    """A PLY's "class" 2 may be anything: buildings, in a well-known data set."""
    twos = np.full(len(some_points), 2, np.uint8)
    files = [cloud_files.npz(tmp_path / "a.npz", some_points), cloud_files.las(tmp_path / "b.las", some_points)]
    files += [cloud_files.npz(tmp_path / "c.npz", some_points, classes=twos)]
    manifest = build_map(files, tmp_path / "a.map")
    assert [source["is_classified"] for source in manifest.build["sources"]] == [False, False, False]
    assert [source["n_kept"] for source in manifest.build["sources"]] == [200, 200, 200]
    assert manifest.build["drop"]["2"] == "ground"
    with pytest.raises(MapError, match="none of the"):
        build_map(files[2:], tmp_path / "b.map", MapOptions(drop=["ground"]))


def test_points_that_are_not_finite_or_withheld_are_dropped_and_counted(tmp_path, cloud_files, some_points):
    path = cloud_files.las(tmp_path / "a.las", some_points)
    las = laspy.read(path)
    las.withheld[:100] = 1
    las.write(path)
    points = some_points.copy()
    points[::10, 1], points[5::50, 0] = np.nan, np.inf
    manifest = build_map([path, cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    one, other = manifest.build["sources"]
    assert (one["n_points"], one["n_withheld"], one["n_kept"]) == (200, 100, 100)
    assert (other["n_points"], other["n_invalid"], other["n_kept"]) == (200, 24, 176)
    assert manifest.n_points == 276


def test_nothing_left_is_no_map(tmp_path, classified, cloud_files):
    nan = cloud_files.npz(tmp_path / "nan.npz", np.full((30, 3), np.nan))
    everything = [str(number) for number in range(256)]
    for path, drop, words in ((nan, None, r"30 points in nan\.npz"), (classified, everything, "1,000 points in cla")):
        with pytest.raises(MapError, match=f"none of the {words}"):
            build_map([path], tmp_path / "a.map", MapOptions(drop=drop))


def test_classes_by_name_and_number():
    assert parse_classes(["ground"]) == {2, 11, 20}
    assert parse_classes([" Vegetation ", "low_vegetation", "17"]) == {3, 4, 5, 17}
    assert parse_classes([]) == frozenset()
    assert parse_classes(["vehicle"], [64, 65]) == {64, 65}
    assert parse_classes(["0", "255"]) == {0, 255}
    names = ["unclassified", "ground", "high-vegetation", "class 64"]
    assert [class_name(number) for number in (0, 2, 5, 64)] == names
    too_large = "9999999999999999999999"
    for names, vehicles in (
        *((names, ()) for names in (["vehicle"], ["-1"], ["1.5"], [""], ["²"], ["256"], [too_large])), ([], [256]),
    ):  # fmt: skip
        with pytest.raises(OptionError, match="Expected a class number from 0 to 255"):
            parse_classes(names, vehicles)
    with pytest.raises(OptionError, match=r"one of unclassified, ground, .*vegetation, got 'cars'.*--vehicle-class 64"):
        parse_classes(["cars"])
