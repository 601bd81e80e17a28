# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a map is known: from passes that saw the same walls, given, or assumed."""

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.errors import ArrayError
from maxcon.io.clouds.base import CloudReader
from maxcon.mapping.build import MapOptions, build_map
from maxcon.map.manifest import read_manifest

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
