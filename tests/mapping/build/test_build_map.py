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
