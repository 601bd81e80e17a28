# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points on their way into tiles, and the moments of their voxels, against plain loops."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.map import TILE_VOXELS
from maxcon.mapping.build.tile_points import (
    HALO_VOXELS,
    PADDING,
    POINT,
    TileArrays,
    TileBuckets,
    VoxelMoments,
    plane_normals,
    point_records,
    sums_around,
    turn_to_side,
)

SEEDS = st.integers(0, 2**32)


@given(
    SEEDS, st.lists(st.integers(0, 80), max_size=4), st.sampled_from([0.03, 0.06, 0.5]), st.floats(0.001, 40),
    st.booleans(),
)  # fmt: skip
def test_every_point_comes_back_from_its_tile(seed, sizes, cell, tiles, has_little_memory):
    rng, n = np.random.default_rng(seed), sum(sizes)
    points = rng.uniform(-1, 1, (n, 3)) * [tiles * TILE_VOXELS * cell, tiles * TILE_VOXELS * cell, 20 * cell]
    sides = rng.normal(size=(n, 3)).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        buckets = TileBuckets(Path(folder), POINT, "points")
        for number, part in enumerate(np.split(np.arange(len(points)), np.cumsum(sizes))):
            buckets.add(*point_records(points[part], sides[part], cell))
            if has_little_memory and number % 2:
                buckets._flush()
        buckets.complete()
        assert has_little_memory or not list(Path(folder).iterdir())
        indices = np.floor(points / cell).astype(int)
        wanted = {tuple(key) for key in (indices[:, :2] // TILE_VOXELS).tolist()}
        assert buckets.keys == sorted(wanted)
        n_back = 0
        for key in buckets.keys:
            records = np.concatenate(list(buckets.records(key, n_at_once=7)))
            is_here = (indices[:, :2] // TILE_VOXELS == key).all(axis=1)
            here = np.flatnonzero(is_here)
            n_back += len(here)
            corner = np.array([*key, 0]) * TILE_VOXELS
            got = np.column_stack([records["column"], records["layer"]]) + corner
            np.testing.assert_array_equal(got, indices[here])  # in the order they came
            np.testing.assert_allclose((got * cell) + records["inside"], points[here], atol=1e-6 * max(1, tiles))
            np.testing.assert_array_equal(records["side"], sides[here])
            buckets.remove(key)
        assert n_back == len(points)
        assert not list(Path(folder).iterdir())


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
        buckets = TileBuckets(Path(folder), POINT, "points")
        buckets.add(*point_records(points, sides, cell))
        buckets.complete()
        assert buckets.keys == [(0, 0)]
        return VoxelMoments.from_records(buckets.records((0, 0), n_at_once))


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
    np.testing.assert_array_equal(sums_around(voxels, values, reach, edge), is_near.astype(float) @ values)


@pytest.mark.parametrize("memory_bytes", [0, 3000, 10**9])
def test_arrays_of_tiles_come_back_from_memory_and_disk(tmp_path, memory_bytes):
    arrays, kept = TileArrays(tmp_path, memory_bytes), np.random.default_rng(0).normal(size=(5, 100, 3))
    for number, values in enumerate(kept):
        arrays.put((number, -1), "values", values=values, counts=np.array([number]))
    assert len(list(tmp_path.iterdir())) == {0: 5, 3000: 4, 10**9: 0}[memory_bytes]
    for number, values in enumerate(kept):
        assert arrays.has((number, -1), "values")
        assert not arrays.has((number, -1), "others")
        again = arrays.get((number, -1), "values")
        np.testing.assert_array_equal(again["values"], values)
        assert again["counts"] == [number]


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
    normals = plane_normals(moments, cell, np.ones(len(moments), bool))
    assert normals.any(axis=1).mean() > 0.99
    cosines = np.abs(normals @ normal)[normals.any(axis=1)]
    assert np.quantile(cosines, 0.01) > 0.999


def _moments(indices, cell=0.06):
    """Moments of voxels with one point each, in the middle; order and types as `VoxelMoments` has them."""
    records = np.zeros(len(indices), POINT)
    records["column"], records["layer"], records["inside"] = indices[:, :2], indices[:, 2], 0.5 * cell
    return VoxelMoments.from_records([records])


@pytest.mark.parametrize(("spacing", "has_normals"), [(9, True), (18, False)])
def test_coarsening_stops_at_voxels_of_four_times_the_edge(spacing, has_normals):
    """Within two voxels of four edges either way lie neighbours 9 voxels away, but none that are 18 away."""
    along, up = np.meshgrid(np.arange(0, 12 * spacing, spacing), np.arange(0, 12 * spacing, spacing))
    wall = _moments(np.column_stack([along.ravel(), np.full(along.size, 20), up.ravel()]))
    normals = plane_normals(wall, 0.06, np.ones(len(wall), bool))
    inner = (wall.indices[:, [0, 2]] >= spacing).all(axis=1)
    assert inner.any()
    if has_normals:
        np.testing.assert_allclose(np.abs(normals[inner]), [[0.0, 1.0, 0.0]] * int(inner.sum()), atol=1e-9)
    else:
        assert not normals.any()


def test_the_halo_is_what_the_coarsest_neighbourhoods_reach():
    rng = np.random.default_rng(4)
    indices = np.unique(rng.integers([-PADDING, 0, 0], [40, 60, 200], (2_000, 3)), axis=0)
    everything = _moments(indices)

    def normals(halo):
        near = everything.select(everything.indices[:, 0] >= -halo)
        is_own = near.indices[:, 0] >= 0
        return plane_normals(near, 0.06, is_own)[is_own]

    np.testing.assert_array_equal(normals(HALO_VOXELS), normals(PADDING))
    assert (normals(HALO_VOXELS - 1) != normals(PADDING)).any()


def test_normals_are_turned_to_the_side_or_left_out():
    normals = np.array([[1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    sides = np.array([[5.0, 1, 0], [-0.1, 9, 0], [0, 1.0, 0], [1.0, 0, 0], [0, 0, 0]])
    turned = turn_to_side(normals, sides)
    np.testing.assert_array_equal(turned, [[1, 0, 0], [-1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
