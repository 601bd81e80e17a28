# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Maps from files: the same voxels as in memory, however the files are cut and whatever the threads."""

import numpy as np
import pytest
from built_maps import CELL, assert_same_voxels, files_of, left_over

from maxcon import PointMap
from maxcon.errors import ArrayError, FileError, OptionError
from maxcon.io.clouds import open_cloud
from maxcon.io.clouds.base import CloudReader
from maxcon.map.manifest import read_manifest
from maxcon.mapping.build import MapOptions, build_map


@pytest.mark.parametrize("kind", ["npz", "ply", "las", "laz"])
def test_voxels_are_those_of_the_same_points_in_memory(tmp_path, cloud_files, scene, kind):
    points = np.round(scene, 3) + 0.0003 if kind in ("npz", "ply") else np.round(scene, 3)
    writer = getattr(cloud_files, "las" if kind == "laz" else kind)
    path = writer(tmp_path / f"a.{kind}", points)
    manifest = build_map([path], tmp_path / "a.map")
    opened = PointMap.open(tmp_path / "a.map")
    np.testing.assert_allclose(np.array(opened.frame.origin) % (512 * CELL) % (512 * CELL - 1e-6), 0.0, atol=1e-5)
    if kind in ("las", "laz"):
        with open_cloud(path) as reader:  # as they are read back: multiples of the scale, with rounding
            points = np.concatenate([chunk.points for chunk in reader.chunks()])
    local = points - np.array(opened.frame.origin)
    assert_same_voxels(opened, PointMap.from_points(local, np.zeros_like(local), CELL), normals_too=False)
    read = read_manifest(tmp_path / "a.map")
    assert (manifest.build, manifest.n_points, manifest.origin) == (read.build, read.n_points, read.origin)
    assert manifest.n_points == len(points)
    assert left_over(tmp_path) == sorted(["a.map", path.name])
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
    manifest = build_map([cloud_files.npz(tmp_path / "a.npz", points)], tmp_path / "a.map")
    assert len(manifest.tiles) > 1000
    assert len([path for path in (tmp_path / "a.map").rglob("*") if path.is_file()]) <= 5
    assert PointMap.open(tmp_path / "a.map").all_voxels()[1].sum() == 2200


@pytest.mark.parametrize("keep_every", [2, 7])
def test_a_thinner_map_takes_every_nth_point(tmp_path, cloud_files, scene, keep_every, monkeypatch):
    whole = cloud_files.npz(tmp_path / "whole.npz", scene)
    part = cloud_files.npz(tmp_path / "part.npz", scene[::keep_every])
    chunks = CloudReader.chunks
    monkeypatch.setattr(CloudReader, "chunks", lambda self, max_points=517, bounds=None: chunks(self, max_points))
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


def test_progress_counts_up_to_the_whole(tmp_path, cloud_files, scene):
    path = cloud_files.npz(tmp_path / "a.npz", scene)
    said = []
    manifest = build_map([path], tmp_path / "a.map", progress=lambda *step: said.append(step))
    reading = [step for step in said if step[0] == "reading points"]
    making = [step for step in said if step[0] == "making tiles"]
    assert reading[-1][1:] == (len(scene), len(scene))
    assert [done for _, done, _ in making] == list(range(1, 2 * len(manifest.tiles) + 1))


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
    with pytest.raises(OptionError, match=r"normals in .*a\.npz, got none\. Leave out --signed-normals"):
        build_map([path], tmp_path / "a.map", MapOptions(normals_have_sides=True))
    for cell in (0.0, -1.0, float("nan")):
        with pytest.raises(ArrayError, match="positive voxel edge"):
            MapOptions(cell=cell)
    assert left_over(tmp_path) == ["a.npz"]
