"""Points on their way into tiles, moments of their voxels, and point spacing, against plain loops."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from built_maps import CELL, assert_same_voxels, sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.map import TILE_VOXELS
from maxcon.mapping.build import MapOptions, build_map, tile_points
from maxcon.mapping.build.point_statistics import MARGIN, SQUARE, PointSpacing, nearest_distances, point_spacing

SEEDS = st.integers(0, 2**32)
EDGE = TILE_VOXELS * CELL


def moments_by_loop(points, sides, cell):
    voxels = {}
    for point, side in zip(points, sides, strict=True):
        index = tuple(np.floor(point / cell).astype(int).tolist())
        inside = point - np.array(index) * cell
        x, y, z = inside
        products = np.array([x * x, x * y, x * z, y * y, y * z, z * z])
        count, sums, outers, total = voxels.get(index, (0, np.zeros(3), np.zeros(6), np.zeros(3)))
        voxels[index] = (count + 1, sums + inside, outers + products, total + side)
    return voxels


def gathered(points, sides, cell, n_at_once):
    with tempfile.TemporaryDirectory() as folder:
        buckets = tile_points.TileBuckets(Path(folder), tile_points.POINT, "points")
        buckets.add(*tile_points.point_records(points, sides, cell))
        buckets.complete()
        assert buckets.keys == [(0, 0)]
        return tile_points.VoxelMoments.from_records(buckets.records((0, 0), n_at_once))


@given(SEEDS, st.integers(1, 150), st.sampled_from([1, 7, 1000]))
def test_moments_are_sums_whatever_the_parts(seed, n, n_at_once):
    cell = 0.06
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 5 * cell, (n, 3)) + [3.0, 5.0, -2 * cell]
    sides = rng.normal(size=(n, 3)).astype(np.float32)
    moments = gathered(points, sides, cell, n_at_once)
    wanted = moments_by_loop(points, sides, cell)
    assert [tuple(index) for index in moments.indices.tolist()] == sorted(wanted, key=lambda index: index[::-1])
    assert (np.diff(moments.keys) > 0).all()
    for row, index in enumerate(moments.indices.tolist()):
        count, sums, outers, total = wanted[tuple(index)]
        assert moments.counts[row] == count
        np.testing.assert_allclose(moments.sums[row], sums, atol=1e-6)
        np.testing.assert_allclose(moments.outers[row], outers, atol=1e-7)
        np.testing.assert_allclose(moments.sides[row], total, atol=1e-5)
    coarse, wanted = moments.coarser(cell), gathered(points, sides, 2 * cell, 1000)  # the sums of finer voxels
    np.testing.assert_array_equal(coarse.indices, wanted.indices)
    np.testing.assert_array_equal(coarse.counts, wanted.counts)
    np.testing.assert_allclose(coarse.sums, wanted.sums, atol=1e-6)
    np.testing.assert_allclose(coarse.outers, wanted.outers, atol=1e-6)


@given(SEEDS, st.integers(1, 200), st.integers(0, 3), st.sampled_from([1, 2, 4]))
def test_sums_around_are_those_of_the_blocks_near_enough(seed, n, reach, edge):
    rng = np.random.default_rng(seed)
    voxels = rng.integers([-4, -4, -30], [TILE_VOXELS + 4, 10, 30], (n, 3)).astype(np.int32)
    values = rng.integers(0, 5, (n, 2)).astype(float)
    blocks = voxels // edge
    is_near = (np.abs(blocks[:, None] - blocks) <= reach).all(axis=2)
    np.testing.assert_array_equal(tile_points.sums_around(voxels, values, reach, edge), is_near.astype(float) @ values)


@given(SEEDS, st.floats(0.0, np.pi), st.floats(-1.0, 1.0))
def test_the_normal_of_any_plane(seed, turn, tilt):
    """Also where the tile ends, and below zero."""
    cell = 0.06
    normal = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    across = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.cross(normal, across)
    u, v = np.random.default_rng(seed).uniform(-0.6, 0.6, (2, 4000))
    points = np.array([2.0, 28.0, 0.0]) + u[:, None] * across + v[:, None] * up
    moments = gathered(points, np.zeros((4000, 3), np.float32), cell, 10_000)
    normals = tile_points.plane_normals(moments, cell, np.ones(len(moments), bool))
    assert normals.any(axis=1).mean() > 0.99
    cosines = np.abs(normals @ normal)[normals.any(axis=1)]
    assert np.quantile(cosines, 0.01) > 0.999


def _moments(indices, cell=0.06):
    """Moments of voxels with one point each, in the middle; order and types as `VoxelMoments` has them."""
    records = np.zeros(len(indices), tile_points.POINT)
    records["column"], records["layer"], records["inside"] = indices[:, :2], indices[:, 2], 0.5 * cell
    return tile_points.VoxelMoments.from_records([records])


@pytest.mark.parametrize(("spacing", "has_normals"), [(9, True), (18, False)])
def test_coarsening_stops_at_voxels_of_four_times_the_edge(spacing, has_normals):
    """Within two voxels of four edges either way lie neighbours 9 voxels away, but none that are 18 away."""
    along, up = np.meshgrid(np.arange(0, 12 * spacing, spacing), np.arange(0, 12 * spacing, spacing))
    wall = _moments(np.column_stack([along.ravel(), np.full(along.size, 20), up.ravel()]))
    normals = tile_points.plane_normals(wall, 0.06, np.ones(len(wall), bool))
    inner = (wall.indices[:, [0, 2]] >= spacing).all(axis=1)
    assert inner.any()
    if has_normals:
        np.testing.assert_allclose(np.abs(normals[inner]), [[0.0, 1.0, 0.0]] * int(inner.sum()), atol=1e-9)
    else:
        assert not normals.any()


def test_the_halo_is_what_the_coarsest_neighbourhoods_reach():
    rng = np.random.default_rng(4)
    indices = np.unique(rng.integers([-tile_points.PADDING, 0, 0], [40, 60, 200], (2_000, 3)), axis=0)
    everything = _moments(indices)

    def normals(halo):
        near = everything.select(everything.indices[:, 0] >= -halo)
        is_own = near.indices[:, 0] >= 0
        return tile_points.plane_normals(near, 0.06, is_own)[is_own]

    np.testing.assert_array_equal(normals(tile_points.HALO_VOXELS), normals(tile_points.PADDING))
    assert (normals(tile_points.HALO_VOXELS - 1) != normals(tile_points.PADDING)).any()


def flat(x, y):
    return 0.0 * x


def buckets(folder, points, cell=CELL):
    sorted_points = tile_points.TileBuckets(folder, tile_points.POINT, "points")
    sorted_points.add(*tile_points.point_records(points, np.zeros(points.shape, np.float32), cell))
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
