"""Maps from files: their voxels, normals and sources; what does not fit, what is left out, nothing half built."""

import errno
import os

import laspy
import numpy as np
import pytest
from built_maps import CELL, assert_same_voxels, axis_errors_deg, files_of, left_over, sorted_voxels, trajectory_at

from maxcon import PointMap
from maxcon.errors import ArrayError, CrsError, FileError, MapError, OptionError, TrajectoryError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.base import CloudReader
from maxcon.map.manifest import read_manifest
from maxcon.map.store import MapWriter
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.options import class_name, parse_classes

ALL_CLASSES = {1, 2, 3, 4, 5, 6, 7, 18, 22, 64}


@pytest.mark.parametrize("kind", ["npz", "ply", "las", "laz"])
def test_voxels_are_those_of_the_same_points_in_memory(tmp_path, cloud_files, scene, kind):
    points = np.round(scene, 3) + 0.0003 if kind in ("npz", "ply") else np.round(scene, 3)
    writer = getattr(cloud_files, "las" if kind == "laz" else kind)
    path = writer(tmp_path / f"a.{kind}", points)
    manifest = build_map([path], tmp_path / "a.map", MapOptions(cell=CELL))
    opened = PointMap.open(tmp_path / "a.map")
    np.testing.assert_allclose(np.array(opened.frame.origin) % (512 * CELL) % (512 * CELL - 1e-6), 0.0, atol=1e-5)
    if kind in ("las", "laz"):
        with open_cloud(path) as reader:  # as they are read back: multiples of the scale, with rounding
            points = np.concatenate([chunk.points for chunk in reader.chunks()])
    local = points - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, np.zeros_like(local), CELL), normals_too=False)
    read = read_manifest(tmp_path / "a.map")
    assert (manifest.build, manifest.n_points, manifest.origin) == (read.build, read.n_points, read.origin)
    assert manifest.n_points == len(points) and left_over(tmp_path) == sorted(["a.map", path.name])
    assert left_over(tmp_path / "a.map") == ["manifest.json", "tiles"]


def test_the_map_does_not_depend_on_chunks_files_their_order_or_threads(tmp_path, cloud_files, scene, monkeypatch):
    whole = cloud_files.npz(tmp_path / "whole.npz", scene)
    build_map([whole], tmp_path / "whole.map", n_threads=1)
    wanted = PointMap.open(tmp_path / "whole.map")
    parts = np.array_split(np.random.default_rng(0).permutation(len(scene)), 3)
    files = [cloud_files.npz(tmp_path / f"{k}.npz", scene[part]) for k, part in enumerate(parts)]
    chunks = CloudReader.chunks
    monkeypatch.setattr(CloudReader, "chunks", lambda self, max_points=517, bounds=None: chunks(self, max_points))
    monkeypatch.setattr("maxcon.mapping.build.tile_points.BUFFER_BYTES", 10_000)
    monkeypatch.setattr("maxcon.mapping.build.tiles.MEMORY_BYTES", 10_000)
    for number, (sources, n_threads) in enumerate([([whole], 4), (files, 1), (files[::-1], 3)]):
        build_map(sources, tmp_path / f"{number}.map", n_threads=n_threads)
        opened = PointMap.open(tmp_path / f"{number}.map")
        assert opened.frame == wanted.frame
        assert_same_voxels(opened, wanted)
    assert files_of(tmp_path / "0.map") == files_of(tmp_path / "whole.map")  # of the same source, the same bytes


def test_a_thin_survey_of_thousands_of_tiles_makes_a_few_files(tmp_path, cloud_files):
    """Two points in a tile, as from an aeroplane: no tile costs a file, neither in the end nor on the way."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, 1200.0, (2200, 3)) * [1.0, 1.0, 0.01]
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map", MapOptions(cell=CELL))
    assert len(manifest.tiles) > 1000
    assert len([path for path in (tmp_path / "a.map").rglob("*") if path.is_file()]) <= 5
    assert PointMap.open(tmp_path / "a.map").all_voxels()[1].sum() == 2200


def test_a_thinner_map_takes_every_nth_point(tmp_path, cloud_files, scene, monkeypatch):
    whole, part = (cloud_files.npz(tmp_path / f"{n}.npz", scene[::n]) for n in (1, 7))
    chunks = CloudReader.chunks
    monkeypatch.setattr(CloudReader, "chunks", lambda self, max_points=517, bounds=None: chunks(self, max_points))
    thin = build_map([whole], tmp_path / "thin.map", MapOptions(keep_every=7))
    build_map([part], tmp_path / "part.map")
    assert_same_voxels(PointMap.open(tmp_path / "thin.map"), PointMap.open(tmp_path / "part.map"))
    (source,) = thin.build["sources"]
    assert source["n_kept"] == len(scene[::7]) == thin.n_points == len(scene) - source["n_thinned"]


def test_progress_counts_up_to_the_whole(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    said = []
    manifest = build_map([path], tmp_path / "a.map", progress=lambda *step: said.append(step))
    reading = [step for step in said if step[0] == "reading points"]
    making = [step for step in said if step[0] == "making tiles"]
    assert reading[-1][1:] == (len(scene), len(scene))
    assert [done for _, done, _ in making] == list(range(1, 2 * len(manifest.tiles) + 1))


def test_what_is_refused(tmp_path, cloud_files, some_points):
    path, out = cloud_files.npz(tmp_path / "a.npz", some_points), tmp_path / "a.map"
    for sources, target, options, kind, words in (
        ([], out, {}, FileError, "at least one point cloud, got none"),
        ([path, tmp_path / "." / "a.npz"], out, {}, FileError, r"a\.npz more than once\. Name it once"),
        ([tmp_path / "b.npz"], out, {}, FileError, "no such file"),
        ([path], tmp_path / "no" / "such" / "folder" / "a.map", {}, FileError, "able to write"),
        ([path], out, {"normals_have_sides": True}, OptionError, r"normals in .*a\.npz, got none\. Leave out --signed"),
        ([path], out, {"classes_are_asprs": True}, OptionError, r"a\.npz, got none\. Leave out --asprs-classes"),
        ([path], out, {"drop": ["6"]}, OptionError, r"classes in .*a\.npz, got none\. Leave out --drop"),
        ([path], out, {"cell": float("nan")}, ArrayError, "positive voxel edge"),
        ([path], out, {"sigma": -0.001}, ArrayError, "Expected `sigma` of the map >= 0 m, got .*Leave it out"),
        ([path], out, {"cell": 0.5, "classify": "always"}, OptionError, "at most 0.25 m .* got 0.5 m"),
        ([path], out, {"classify": "yes"}, OptionError, "auto, always or off, got 1 and 'yes'"),
    ):
        with pytest.raises(kind, match=words):
            build_map(sources, target, MapOptions(**options))
    assert left_over(tmp_path) == ["a.npz"]


@pytest.mark.parametrize("where", ["put", "finish"])
def test_a_broken_source_and_a_full_disk_leave_nothing_behind(tmp_path, cloud_files, scene, monkeypatch, where):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    build_map([path], tmp_path / "old.map")
    before = read_manifest(tmp_path / "old.map").sha256

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    broken = cloud_files.las(tmp_path / "broken.las", scene)
    broken.write_bytes(broken.read_bytes()[:-1000])
    with pytest.raises(FileError, match=r"broken\.las"):
        build_map([path, broken], tmp_path / "new.map")
    monkeypatch.setattr(MapWriter, where, full)
    for name, overwrite in (("new.map", False), ("old.map", True)):
        with pytest.raises(FileError, match=rf"able to write .*{name}, got: No space left on device\..*disk space"):
            build_map([path], tmp_path / name, overwrite=overwrite)
    assert left_over(tmp_path) == ["a.npz", "broken.las", "old.map"]
    assert read_manifest(tmp_path / "old.map").sha256 == before
    PointMap.open(tmp_path / "old.map").all_voxels()


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
    assert counts.sum() == 2003 and not normals.any()


def test_own_normals_with_sides_are_averaged_as_in_memory(tmp_path, cloud_files, scene):
    normals = np.random.default_rng(5).normal(size=scene.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    path = cloud_files.ply(tmp_path / "a.ply", scene, normals)
    manifest = build_map([path], tmp_path / "a.map", MapOptions(cell=CELL, normals_have_sides=True))
    opened = PointMap.open(tmp_path / "a.map")
    local = scene - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, normals, CELL))
    assert opened.is_signed and manifest.build["normals"] == "of the sources"


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
    assert not normals[x > 15.1].any() and (normals[x < 14.9, 1] < -0.9).mean() > 0.95


@pytest.fixture
def classified(tmp_path, cloud_files, surfaces):
    points, _ = surfaces.wall(1000, (10, 20), (20, 20))
    return cloud_files.las(tmp_path / "classified.laz", points, classes=np.repeat(sorted(ALL_CLASSES), 100))


@pytest.mark.parametrize(("options", "dropped"), [
    ({}, {2, 3, 4, 5, 7, 18, 22}), ({"vehicle_classes": (64,)}, {2, 3, 4, 5, 7, 18, 22, 64}),
    ({"drop": ["Vegetation", "6"]}, {3, 4, 5, 6}), ({"drop": ["high_vegetation", "NOISE"]}, {5, 7, 18}),
    ({"drop": ["vehicles"], "vehicle_classes": iter([64, 22])}, {22, 64}), ({"drop": []}, set()),
])  # fmt: skip
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
    assert parse_classes([]) == frozenset() and parse_classes(["vehicle"], [64, 65]) == {64, 65}
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
