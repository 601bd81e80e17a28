# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Point spacing: the distances that a plain search finds, and the voxel edge that follows from it."""

import numpy as np
import pytest
from built_maps import CELL, assert_same_voxels, sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.map import TILE_VOXELS
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.point_statistics import MARGIN, SQUARE, PointSpacing, nearest_distances, point_spacing
from maxcon.mapping.build.tile_points import POINT, TileBuckets, point_records

EDGE = TILE_VOXELS * CELL


def flat(x, y):
    return 0.0 * x


def buckets(folder, points, cell=CELL):
    sorted_points = TileBuckets(folder, POINT, "points")
    sorted_points.add(*point_records(points, np.zeros(points.shape, np.float32), cell))
    return sorted_points


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(0, 60))
def test_distances_are_those_of_a_plain_search(seed, n):
    """Each point that is far enough inside of its square, to the nearest of all points, wherever that lies."""
    points = np.random.default_rng(seed).uniform(0.0, [3.0 * SQUARE, SQUARE, 0.5], (n, 3))
    apart = np.linalg.norm(points[:, None] - points[None], axis=2) + 9.0 * np.eye(n)
    inside = points[:, :2] % SQUARE
    is_inner = ((inside >= MARGIN) & (inside < SQUARE - MARGIN)).all(axis=1)
    wanted = np.minimum(apart[is_inner].min(axis=1, initial=MARGIN), MARGIN)
    np.testing.assert_allclose(nearest_distances(points, EDGE), wanted, rtol=1e-12)


@pytest.mark.parametrize("cell", [CELL, 0.25])
def test_a_grid_of_points_has_its_spacing_however_many_squares_are_looked_at(tmp_path, cell, monkeypatch):
    points = sheet((-30, 40), (0, 30), flat, spacing=0.2)
    points[:, 2] = 0.0
    for most in (10**6, 20_000, 3000):
        monkeypatch.setattr("maxcon.mapping.build.point_statistics.MOST_SAMPLED", most)
        found = point_spacing(buckets(tmp_path, points, cell), cell)
        assert (found.median, found.at_90) == pytest.approx((0.2, 0.2), abs=1e-6)
        assert found.cell == 0.24


def test_squares_that_are_left_out_are_stood_for_by_others(tmp_path, monkeypatch):
    """A tile ten times as dense has nine tenths of the points, and is thinned out: its spacing is the median."""
    monkeypatch.setattr("maxcon.mapping.build.point_statistics.MOST_SAMPLED", 20_000)
    dense, thin = (sheet((a, a + 30), (0, 30), flat, spacing) for a, spacing in ((0, 0.1), (EDGE, 0.4)))
    found = point_spacing(buckets(tmp_path, np.concatenate([dense, thin])), CELL)
    assert (found.median, found.at_90) == pytest.approx((0.1, 0.1), abs=0.01)


@pytest.mark.parametrize(
    ("at_90", "cell"), [(0.0, 0.06), (0.054, 0.06), (0.099, 0.06), (0.101, 0.12), (0.22, 0.24), (0.5, 0.6)]
)
def test_the_voxel_edge_is_a_whole_multiple(at_90, cell):
    assert PointSpacing(0.5 * at_90, at_90, 100).cell == cell


def test_points_alone_have_no_spacing(tmp_path):
    assert point_spacing(buckets(tmp_path, np.zeros((1, 3))), CELL) is None


@pytest.mark.parametrize(("spacing", "cell"), [(0.04, 0.06), (0.21, 0.24)])
def test_a_map_without_a_cell_is_the_map_of_the_cell_that_suits(tmp_path, cloud_files, spacing, cell):
    points = sheet((458_800, 458_830), (5_429_000, 5_429_020), lambda x, y: 100.0 + 0.1 * (x - x.min()), spacing)
    path = cloud_files.npz(tmp_path / "a.npz", points)
    found = build_map([path], tmp_path / "found.map")
    given = build_map([path], tmp_path / "given.map", MapOptions(cell=cell))
    assert (found.cell, found.origin) == (cell, given.origin)
    assert found.build["sources"] == given.build["sources"]
    assert_same_voxels(PointMap.open(tmp_path / "found.map"), PointMap.open(tmp_path / "given.map"))
    assert found.build["spacing"]["suits_cell"] == cell
    held = build_map([path], tmp_path / "held.map", MapOptions(cell=CELL))
    assert (held.cell, held.build["spacing"]) == (CELL, found.build["spacing"])
