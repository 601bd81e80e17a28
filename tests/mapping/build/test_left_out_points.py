# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points that do not get into a map: of classes that are dropped, withheld, not finite; each is counted."""

import numpy as np
import pytest
from built_maps import left_over

from maxcon.errors import MapError, OptionError
from maxcon.mapping.build import MapOptions, build_map


@pytest.fixture
def classified(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(1000, (10, 20), (20, 20))
    classes = np.repeat(np.array([1, 2, 3, 4, 5, 6, 7, 18, 22, 64], np.uint8), 100)
    return cloud_files.las(tmp_path / "classified.laz", points, classes=classes)


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        ({}, {1, 6, 64}),
        ({"vehicle_classes": (64,)}, {1, 6}),
        ({"drop": ["ground"]}, {1, 3, 4, 5, 6, 7, 18, 22, 64}),
        ({"drop": ["Vegetation", "6"]}, {1, 2, 7, 18, 22, 64}),
        ({"drop": ["high_vegetation", "NOISE"]}, {1, 2, 3, 4, 6, 22, 64}),
        ({"drop": ["vehicles"], "vehicle_classes": iter([64, 22])}, {1, 2, 3, 4, 5, 6, 7, 18}),
        ({"drop": []}, {1, 2, 3, 4, 5, 6, 7, 18, 22, 64}),
    ],
)
def test_classes_are_dropped_by_name_and_number(tmp_path, classified, options, kept):
    manifest = build_map([classified], tmp_path / "a.map", MapOptions(**options))
    (source,) = manifest.build["sources"]
    assert manifest.n_points == 100 * len(kept) == source["n_kept"]
    all_classes = {1, 2, 3, 4, 5, 6, 7, 18, 22, 64}
    assert source["n_dropped"] == {str(number): 100 for number in sorted(all_classes - kept)}
    assert source["is_classified"]


def test_the_default_drops_nothing_where_there_are_no_classes(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(500, (10, 20), (20, 20))
    files = [cloud_files.npz(tmp_path / "a.npz", points), cloud_files.las(tmp_path / "b.las", points)]
    manifest = build_map(files, tmp_path / "a.map")
    assert [source["is_classified"] for source in manifest.build["sources"]] == [False, False]
    assert [source["n_kept"] for source in manifest.build["sources"]] == [500, 500]
    assert manifest.build["drop"]["2"] == "ground"


def test_points_that_are_no_numbers_are_dropped_and_counted(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(500, (10, 20), (20, 20))
    points[::10, 1] = np.nan
    points[5::50, 0] = np.inf
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    (source,) = manifest.build["sources"]
    assert (source["n_points"], source["n_invalid"], source["n_kept"]) == (500, 60, 440)
    assert manifest.n_points == 440


def test_an_unknown_class_lists_the_names(tmp_path, classified):
    with pytest.raises(
        OptionError, match=r"one of unclassified, ground, .*vegetation, got 'cars'.*--vehicle-class 64"
    ):
        build_map([classified], tmp_path / "a.map", MapOptions(drop=["cars"]))
    for number in ("256", "9999999999999999999999"):
        with pytest.raises(OptionError, match=f"class number from 0 to 255.*{number}"):
            build_map([classified], tmp_path / "a.map", MapOptions(drop=[number]))
    assert not (tmp_path / "a.map").exists()


def test_dropping_from_a_cloud_without_classes_is_refused(tmp_path, cloud_files, surfaces):
    path = cloud_files.npz(tmp_path / "a.npz", surfaces.wall(50, (0, 0), (1, 0))[0])
    with pytest.raises(
        OptionError, match=r"classes in .*a\.npz to drop ground, 6, but it has none\. Leave out --drop"
    ):
        build_map([path], tmp_path / "a.map", MapOptions(drop=["ground", "6"]))


def test_nothing_left_is_no_map(tmp_path, classified, cloud_files):
    nan = cloud_files.npz(tmp_path / "nan.npz", np.full((30, 3), np.nan))
    with pytest.raises(MapError, match=r"none of the 30 points in nan\.npz is left"):
        build_map([nan], tmp_path / "a.map")
    with pytest.raises(MapError, match=r"none of the 1,000 points in classified\.laz is left"):
        build_map([classified], tmp_path / "a.map", MapOptions(drop=[str(number) for number in range(256)]))
    assert left_over(tmp_path) == ["classified.laz", "nan.npz"]


def test_classes_of_another_scheme_are_not_dropped_by_default(tmp_path, cloud_files, some_points):
    """A PLY's "class" 2 may be anything: buildings, in a well-known data set."""
    classes = np.full(len(some_points), 2, np.uint8)
    path = cloud_files.npz(tmp_path / "a.npz", some_points, classes=classes)
    manifest = build_map([path], tmp_path / "a.map")
    assert manifest.n_points == len(some_points)
    assert not manifest.build["sources"][0]["is_classified"]
    with pytest.raises(MapError, match="none of the"):
        build_map([path], tmp_path / "b.map", MapOptions(drop=["ground"]))


def test_withheld_points_of_a_las_are_left_out_and_counted(tmp_path, cloud_files, some_points):
    import laspy

    path = cloud_files.las(tmp_path / "a.las", some_points)
    las = laspy.read(path)
    las.withheld[: len(some_points) // 2] = 1
    las.write(path)
    manifest = build_map([path], tmp_path / "a.map")
    assert manifest.build["sources"][0]["n_withheld"] == len(some_points) // 2
    assert manifest.n_points == len(some_points) - len(some_points) // 2
