# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps from files: the same voxels as in memory, however the files are cut, and normals of known surfaces."""

import errno
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from maxcon import PointMap, Pose, Trajectory
from maxcon.errors import ArrayError, CrsError, FileError, MapError, OptionError, TrajectoryError
from maxcon.io.clouds.base import CloudReader
from maxcon.mapping import MapOptions, build_map
from maxcon.point_map.manifest import read_manifest
from maxcon.point_map.writer import MapWriter

CELL = 0.06


def by_index(point_map):
    """The voxels of a map as a dictionary: index to (count, normal)."""
    indices, counts, normals = point_map.all_voxels()
    return {tuple(i): (int(c), n) for i, c, n in zip(indices.tolist(), counts, normals, strict=True)}


def assert_same_voxels(one, other, *, normals_too=True):
    one, other = by_index(one), by_index(other)
    assert {i: count for i, (count, _) in one.items()} == {i: count for i, (count, _) in other.items()}
    if normals_too:
        for index, (_, normal) in one.items():
            np.testing.assert_allclose(normal, other[index][1], atol=1e-5)


def left_over(folder):
    return sorted(path.name for path in folder.iterdir())


def axis_errors_deg(normals, true):
    return np.degrees(np.arccos(np.clip(np.abs((normals * true).sum(axis=1)), 0.0, 1.0)))


@pytest.fixture
def scene(surfaces):
    """Two walls across a tile's border, and a scatter of points."""
    one, _ = surfaces.wall(6000, (20, 25), (42, 36), noise=0.005)
    two, _ = surfaces.wall(3000, (30, 20), (31, 45), noise=0.005, seed=1)
    scatter = surfaces.origin + np.random.default_rng(2).uniform(0, 60, (300, 3)) * [1, 1, 0.1]
    return np.concatenate([one, two, scatter])


def trajectory_at(times, positions):
    return Trajectory.from_poses(times, [Pose(*position, 0.0, 0.0, 0.0) for position in positions])


# --- voxels -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["npz", "ply", "las", "laz"])
def test_voxels_are_those_of_the_same_points_in_memory(tmp_path, cloud_files, scene, kind):
    points = np.round(scene, 3) + 0.0003 if kind in ("npz", "ply") else np.round(scene, 3)
    writer = getattr(cloud_files, "las" if kind == "laz" else kind)
    path = writer(tmp_path / f"a.{kind}", points)
    manifest = build_map([path], tmp_path / "a.map")
    opened = PointMap.open(tmp_path / "a.map")
    np.testing.assert_allclose(
        np.array(opened.frame.origin) % (512 * CELL) % (512 * CELL - 1e-6), 0.0, atol=1e-5
    )
    if kind in ("las", "laz"):
        from maxcon.io.clouds import open_cloud

        with open_cloud(path) as reader:  # as they are read back: multiples of the scale, with rounding
            points = np.concatenate([chunk.points for chunk in reader.chunks()])
    local = points - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, np.zeros_like(local), CELL), normals_too=False)
    assert manifest == read_manifest(tmp_path / "a.map")
    assert manifest.n_points == len(points)
    assert left_over(tmp_path) == sorted(["a.map", path.name])
    assert left_over(tmp_path / "a.map") == ["manifest.json", "tiles"]


def test_the_map_does_not_depend_on_chunks_files_their_order_or_threads(
    tmp_path, cloud_files, scene, monkeypatch
):
    whole = cloud_files.npz(tmp_path / "whole.npz", scene)
    build_map([whole], tmp_path / "whole.map", n_threads=1)
    wanted = PointMap.open(tmp_path / "whole.map")
    parts = np.array_split(np.random.default_rng(0).permutation(len(scene)), 3)
    files = [cloud_files.npz(tmp_path / f"{k}.npz", scene[part]) for k, part in enumerate(parts)]
    chunks = CloudReader.chunks
    monkeypatch.setattr(
        CloudReader, "chunks", lambda self, max_points=517, bounds=None: chunks(self, max_points)
    )
    monkeypatch.setattr("maxcon.mapping.spill.BUFFER_BYTES", 10_000)
    monkeypatch.setattr("maxcon.mapping.tile_job.MEMORY_BYTES", 10_000)
    for number, (sources, n_threads) in enumerate([([whole], 4), (files, 1), (files[::-1], 3)]):
        build_map(sources, tmp_path / f"{number}.map", n_threads=n_threads)
        opened = PointMap.open(tmp_path / f"{number}.map")
        assert opened.frame == wanted.frame
        assert_same_voxels(opened, wanted)


def test_a_thin_survey_of_thousands_of_tiles_makes_a_few_files(tmp_path, cloud_files):
    """Two points in a tile, as from an aeroplane: no tile costs a file, neither in the end nor on the way."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, 1500.0, (3000, 3)) * [1.0, 1.0, 0.01]
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    assert len(manifest.tiles) > 1500
    assert len([path for path in (tmp_path / "a.map").rglob("*") if path.is_file()]) <= 5
    assert PointMap.open(tmp_path / "a.map").all_voxels()[1].sum() == 3000


@pytest.mark.parametrize("keep_every", [2, 7])
def test_a_thinner_map_takes_every_nth_point(tmp_path, cloud_files, scene, keep_every, monkeypatch):
    whole = cloud_files.npz(tmp_path / "whole.npz", scene)
    part = cloud_files.npz(tmp_path / "part.npz", scene[::keep_every])
    chunks = CloudReader.chunks
    monkeypatch.setattr(
        CloudReader, "chunks", lambda self, max_points=517, bounds=None: chunks(self, max_points)
    )
    thin = build_map([whole], tmp_path / "thin.map", MapOptions(keep_every=keep_every))
    build_map([part], tmp_path / "part.map")
    assert_same_voxels(PointMap.open(tmp_path / "thin.map"), PointMap.open(tmp_path / "part.map"))
    (source,) = thin.build["sources"]
    assert source["n_kept"] == len(scene[::keep_every]) == thin.n_points
    assert source["n_thinned"] == len(scene) - len(scene[::keep_every])


def test_the_voxels_of_a_large_map_do_not_depend_on_the_order_of_files(tmp_path, cloud_files, surfaces):
    west, _ = surfaces.wall(500, (10, 20), (90, 20))
    east, _ = surfaces.wall(500, (110, 20), (190, 20), seed=1)
    files = [cloud_files.npz(tmp_path / "w.npz", west), cloud_files.npz(tmp_path / "e.npz", east)]
    build_map(files, tmp_path / "a.map")
    build_map(files[::-1], tmp_path / "b.map")
    one, other = PointMap.open(tmp_path / "a.map"), PointMap.open(tmp_path / "b.map")
    shift = (np.array(other.frame.origin) - one.frame.origin) / CELL
    np.testing.assert_allclose(shift, np.round(shift), atol=1e-6)
    moved = {tuple(index) for index in (other.all_voxels()[0] + np.round(shift).astype(int)).tolist()}
    assert moved == {tuple(index) for index in one.all_voxels()[0].tolist()}


def test_the_same_sources_make_the_same_bytes_whatever_the_threads(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    checksums = []
    for n_threads in (1, 2, 4, None):
        build_map([path], tmp_path / f"{n_threads}.map", n_threads=n_threads)
        folder = tmp_path / f"{n_threads}.map"
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        checksums.append([(path.relative_to(folder), path.read_bytes()) for path in files])
    assert all(checksum == checksums[0] for checksum in checksums)


def test_progress_counts_up_to_the_whole(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    said = []
    manifest = build_map([path], tmp_path / "a.map", progress=lambda *step: said.append(step))
    reading = [step for step in said if step[0] == "reading points"]
    making = [step for step in said if step[0] == "making tiles"]
    assert reading[-1][1:] == (len(scene), len(scene))
    assert [done for _, done, _ in making] == list(range(1, 2 * len(manifest.tiles) + 1))


# --- normals ------------------------------------------------------------------------------------------


def test_normals_of_walls_across_a_tiles_border(tmp_path, cloud_files, surfaces):
    points, true = surfaces.wall(20_000, (25, 28), (37, 33), noise=0.01)
    build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    opened = PointMap.open(tmp_path / "a.map")
    assert len(opened.tile_keys) >= 2
    assert not opened.is_signed
    indices, _, normals = opened.all_voxels()
    has_normal = normals.any(axis=1)
    assert has_normal.mean() > 0.99
    errors = axis_errors_deg(normals, true[0])
    assert np.median(errors[has_normal]) < 4.0
    x = (indices[:, 0] + 0.5) * CELL
    at_border = has_normal & (np.abs(x - 30.72) < 0.3)
    assert at_border.sum() > 50
    assert np.median(errors[at_border]) < 1.3 * np.median(errors[has_normal])


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
    shifted = {(x + 256, y + 256, z): value for (x, y, z), value in by_index(maps[0]).items()}
    other = by_index(maps[1])
    assert shifted.keys() == other.keys()
    n_with_normal = 0
    for index, (count, normal) in shifted.items():
        assert count == other[index][0]
        np.testing.assert_allclose(normal, other[index][1], atol=1e-6)
        n_with_normal += normal.any()
    assert n_with_normal > 0.5 * len(shifted)


def test_both_sides_of_a_thin_wall_are_turned_to_who_saw_them(tmp_path, cloud_files, surfaces):
    """A wall of 20 cm, seen from the south at first and from the north later."""
    south, _ = surfaces.wall(8000, (10, 20.0), (20, 20.0), noise=0.003)
    north, _ = surfaces.wall(8000, (10, 20.2), (20, 20.2), noise=0.003, seed=1)
    times = np.r_[
        np.random.default_rng(0).uniform(0, 10, 8000), np.random.default_rng(1).uniform(20, 30, 8000)
    ]
    path = cloud_files.las(tmp_path / "a.laz", np.concatenate([south, north]), times=times)
    at = np.arange(0.0, 30.5, 0.25)
    y = np.where(at < 15, 15.0, 26.0)
    trajectory = trajectory_at(
        at, surfaces.origin + np.column_stack([10 + at % 10, y, np.full(len(at), 1.8)])
    )
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


@pytest.mark.parametrize(("spacing", "share"), [(0.03, 0.99), (0.1, 0.95), (0.2, 0.9)])
def test_sparse_surfaces_get_normals_from_the_coarser_level(tmp_path, cloud_files, surfaces, spacing, share):
    """A wall at 31 degrees of one point every 20 cm: no 30 cm neighbourhood holds a plane of it."""
    turn = np.radians(31.0)
    u, v = np.meshgrid(np.arange(0, 8, spacing), np.arange(0.5, 4, spacing))
    u, v = u.ravel(), v.ravel()
    points = surfaces.origin + np.column_stack([10 + u * np.cos(turn), 10 + u * np.sin(turn), v])
    points += np.random.default_rng(0).normal(0, 0.005, points.shape)
    build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    _, _, normals = PointMap.open(tmp_path / "a.map").all_voxels()
    has_normal = normals.any(axis=1)
    assert has_normal.mean() >= share
    errors = axis_errors_deg(normals[has_normal], [-np.sin(turn), np.cos(turn), 0.0])
    assert np.median(errors) < 5.0


@pytest.mark.parametrize("kind", ["npz", "ply"])
def test_own_normals_with_sides_are_averaged_as_in_memory(tmp_path, cloud_files, scene, kind):
    normals = np.random.default_rng(5).normal(size=scene.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    path = getattr(cloud_files, kind)(tmp_path / f"a.{kind}", scene, normals=normals)
    manifest = build_map([path], tmp_path / "a.map", MapOptions(normals_have_sides=True))
    opened = PointMap.open(tmp_path / "a.map")
    local = scene - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, normals, CELL))
    assert opened.is_signed
    assert manifest.build["normals"] == "of the sources"


def test_own_normals_whose_side_is_not_known_are_fitted_anew(tmp_path, cloud_files, surfaces):
    points, true = surfaces.wall(8000, (10, 20), (20, 20), noise=0.003)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(points), 1))
    path = cloud_files.npz(tmp_path / "a.npz", points, normals=true * signs)
    manifest = build_map([path], tmp_path / "a.map")
    opened = PointMap.open(tmp_path / "a.map")
    assert not opened.is_signed
    assert manifest.build["normals"] == "from neighbourhoods"
    _, _, normals = opened.all_voxels()
    assert np.median(axis_errors_deg(normals, true[0])[normals.any(axis=1)]) < 3.0


def test_a_trajectory_turns_own_normals(tmp_path, cloud_files, surfaces):
    points, true = surfaces.wall(4000, (10, 20), (20, 20), noise=0.003)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(points), 1))
    times = np.linspace(0, 9.9, len(points))
    path = cloud_files.npz(tmp_path / "a.npz", points, normals=true * signs, times=times)
    at = np.arange(0, 10.1, 0.2)
    trajectory = trajectory_at(at, surfaces.origin + np.column_stack([10 + at, 0 * at + 14, 0 * at + 1.8]))
    build_map([path], tmp_path / "a.map", MapOptions(trajectory=trajectory))
    _, _, normals = PointMap.open(tmp_path / "a.map").all_voxels()
    np.testing.assert_allclose(normals, np.tile([0.0, -1.0, 0.0], (len(normals), 1)), atol=1e-6)


# --- what is left out ---------------------------------------------------------------------------------


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


# --- coordinate reference systems and times -----------------------------------------------------------


@pytest.fixture
def some_points(surfaces):
    return surfaces.wall(200, (10, 20), (20, 20))[0]


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


# --- nothing half written -----------------------------------------------------------------------------


def test_a_map_that_exists_is_replaced_only_if_asked(tmp_path, cloud_files, some_points, surfaces):
    one = cloud_files.npz(tmp_path / "one.npz", some_points)
    other = cloud_files.npz(tmp_path / "other.npz", surfaces.wall(70, (0, 0), (3, 0))[0])
    build_map([one], tmp_path / "a.map")
    with pytest.raises(FileError, match=r"a\.map not to exist yet, but it does"):
        build_map([other], tmp_path / "a.map")
    assert read_manifest(tmp_path / "a.map").n_points == 200
    build_map([other], tmp_path / "a.map", overwrite=True)
    assert read_manifest(tmp_path / "a.map").n_points == 70
    assert PointMap.open(tmp_path / "a.map").all_voxels()[1].sum() == 70
    assert left_over(tmp_path) == ["a.map", "one.npz", "other.npz"]


def test_overwriting_replaces_maps_only(tmp_path, cloud_files, some_points):
    path = cloud_files.npz(tmp_path / "a.npz", some_points)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "summer.jpg").write_text("dear")
    with pytest.raises(FileError, match=r"photos to be a map, to overwrite it, but it holds summer\.jpg"):
        build_map([path], tmp_path / "photos", overwrite=True)
    assert (tmp_path / "photos" / "summer.jpg").read_text() == "dear"


@pytest.mark.parametrize("where", ["put", "finish"])
def test_a_full_disk_leaves_nothing_behind(tmp_path, cloud_files, scene, monkeypatch, where):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    build_map([path], tmp_path / "old.map")
    before = read_manifest(tmp_path / "old.map")

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(MapWriter, where, full)
    for name, overwrite in (("new.map", False), ("old.map", True)):
        with pytest.raises(
            FileError, match=rf"able to write .*{name}, got: No space left on device\..*disk space"
        ):
            build_map([path], tmp_path / name, overwrite=overwrite)
    assert left_over(tmp_path) == ["a.npz", "old.map"]
    assert read_manifest(tmp_path / "old.map") == before
    PointMap.open(tmp_path / "old.map").all_voxels()


def test_a_broken_source_leaves_nothing_behind(tmp_path, cloud_files, scene):
    whole = cloud_files.npz(tmp_path / "whole.npz", scene)
    broken = cloud_files.las(tmp_path / "broken.las", scene)
    broken.write_bytes(broken.read_bytes()[:-1000])
    with pytest.raises(FileError, match=r"broken\.las"):
        build_map([whole, broken], tmp_path / "a.map")
    assert left_over(tmp_path) == ["broken.las", "whole.npz"]


KILLED = """
import sys, time
import maxcon.mapping.build as build
put = build.MapWriter.put
def slowly(writer, record):
    put(writer, record)
    sys.stdout.write("wrote a tile\\n")
    sys.stdout.flush()
    time.sleep(60)
build.MapWriter.put = slowly
build.build_map([sys.argv[1]], sys.argv[2], n_threads=2)
"""


def test_a_killed_build_leaves_no_map(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    out = tmp_path / "a.map"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path), str(out)], stdout=subprocess.PIPE, text=True
    ) as build:
        try:
            first_line = build.stdout.readline()
        finally:
            build.kill()
        build.wait(10)
    assert first_line.startswith("wrote a tile")
    assert not out.exists()
    with pytest.raises(MapError, match="no such folder"):
        PointMap.open(out)
    build_map([path], out)  # what the killed run left does not stand in the way
    assert PointMap.open(out).all_voxels()[1].sum() == len(scene)


# --- other refusals -----------------------------------------------------------------------------------


def test_what_is_refused(tmp_path, cloud_files, some_points):
    path = cloud_files.npz(tmp_path / "a.npz", some_points)
    with pytest.raises(FileError, match="at least one point cloud, got none"):
        build_map([], tmp_path / "a.map")
    with pytest.raises(FileError, match=r"a\.npz more than once\. Name it once"):
        build_map([path, tmp_path / "." / "a.npz"], tmp_path / "a.map")
    with pytest.raises(FileError, match=r"no such file"):
        build_map([tmp_path / "b.npz"], tmp_path / "a.map")
    with pytest.raises(FileError, match="able to write"):
        build_map([path], tmp_path / "no" / "such" / "folder" / "a.map")
    with pytest.raises(
        OptionError, match=r"normals in .*a\.npz, said to be turned to the sensor, but it has none"
    ):
        build_map([path], tmp_path / "a.map", MapOptions(normals_have_sides=True))
    for cell in (0.0, -1.0, float("nan")):
        with pytest.raises(ArrayError, match="positive voxel edge"):
            MapOptions(cell=cell)
    assert left_over(tmp_path) == ["a.npz"]


def test_building_takes_no_longer_than_it_should(tmp_path, cloud_files, surfaces):
    """A hundred thousand points take well under a second; ten are a hang."""
    points, _ = surfaces.wall(100_000, (0, 0), (90, 50), noise=0.01)
    path = cloud_files.npz(tmp_path / "a.npz", points)
    begin = time.perf_counter()
    build_map([path], tmp_path / "a.map")
    assert time.perf_counter() - begin < 100.0


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


# --- how well the map is known ------------------------------------------------------------------------


ASSUMED = {"from": "assumed", "reason": "no planes of points with times"}


def three_passes(surfaces, offsets=(0.0, 0.02, 0.04), n_walls=60):
    """Walls along a road, and times: passes 300 s apart, each off by its offset across the walls."""
    points, times = [], []
    for number, offset in enumerate(offsets):
        for wall in range(n_walls):
            x = 2.0 * wall
            across = offset if wall % 2 else -offset
            points.append(surfaces.wall(1500, (x, 10.15 + across), (x + 1.5, 10.15 + across), noise=0.005)[0])
            times.append(np.full(1500, 300.0 * number + 2.0 * wall))
    return np.concatenate(points), np.concatenate(times)


@pytest.mark.parametrize("kind", ["npz", "laz"])
def test_passes_say_how_well_a_map_is_known(tmp_path, cloud_files, surfaces, kind):
    points, times = three_passes(surfaces)
    writer = cloud_files.las if kind == "laz" else cloud_files.npz
    build_map([writer(tmp_path / f"a.{kind}", points, times=times)], tmp_path / "a.map")
    manifest = read_manifest(tmp_path / "a.map")
    known = manifest.build["sigma"]
    assert (known["from"], known["n_passes"]) == ("passes", 3)
    assert known["n_places"] >= 50
    assert known["sigma_of_pass"] == pytest.approx(np.std([0.0, 0.02, 0.04], ddof=1), rel=0.05)
    assert manifest.sigma == pytest.approx(known["sigma_of_pass"] / np.sqrt(3.0), rel=0.05)
    assert PointMap.open(tmp_path / "a.map").sigma == manifest.sigma


def test_how_well_a_map_is_known_depends_on_neither_files_nor_chunks(
    tmp_path, cloud_files, surfaces, monkeypatch
):
    points, times = three_passes(surfaces)
    build_map([cloud_files.npz(tmp_path / "whole.npz", points, times=times)], tmp_path / "whole.map")
    order = 1 + np.random.default_rng(0).permutation(len(points) - 1)
    files = []
    for number, part in enumerate(np.array_split(np.r_[0, order], 3)):  # the first point places the frame
        files.append(cloud_files.npz(tmp_path / f"{number}.npz", points[part], times=times[part]))
    chunks = CloudReader.chunks
    monkeypatch.setattr(
        CloudReader, "chunks", lambda self, max_points=51_700, bounds=None: chunks(self, max_points)
    )
    build_map(files[::-1], tmp_path / "parts.map")
    whole, parts = (read_manifest(tmp_path / f"{name}.map") for name in ("whole", "parts"))
    assert whole.build["sigma"] == parts.build["sigma"]
    assert whole.sigma == parts.sigma


def test_one_pass_leaves_it_assumed(tmp_path, cloud_files, surfaces):
    points, times = three_passes(surfaces, offsets=(0.0,))
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points, times=times)], tmp_path / "a.map")
    assert (manifest.sigma, manifest.build["sigma"]) == (0.02, {"from": "assumed", "reason": "one pass only"})


def test_points_without_times_leave_it_assumed(tmp_path, cloud_files, surfaces):
    points, _ = three_passes(surfaces)
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    assert (manifest.sigma, manifest.build["sigma"]) == (0.02, ASSUMED)


@pytest.mark.parametrize("sigma", [0.0, 0.007, 1])
def test_a_sigma_that_is_given_stands(tmp_path, cloud_files, surfaces, sigma):
    points, times = three_passes(surfaces, n_walls=10)
    path = cloud_files.npz(tmp_path / "a.npz", points, times=times)
    build_map([path], tmp_path / "a.map", MapOptions(sigma=sigma))
    manifest = read_manifest(tmp_path / "a.map")
    assert (manifest.sigma, manifest.build["sigma"]) == (float(sigma), {"from": "given"})


@pytest.mark.parametrize("sigma", [-0.001, float("nan"), float("inf")])
def test_a_sigma_that_is_none_is_refused(sigma):
    with pytest.raises(ArrayError, match=r"Expected `sigma` of the map >= 0 m, got .*Leave it out"):
        MapOptions(sigma=sigma)
    with pytest.raises(ArrayError, match="Expected `sigma` of the map >= 0 m"):
        PointMap.from_points(np.zeros((1, 3)), np.zeros((1, 3)), sigma=sigma)
