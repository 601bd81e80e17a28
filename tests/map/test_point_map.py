# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PointMap against a dictionary of voxels, and its tiles against brute force."""

import itertools
import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import LocalFrame, PointMap
from maxcon.errors import ArrayError
from maxcon.map import PATCH_VOXELS, TILE_VOXELS

SEEDS = st.integers(0, 2**32)
CELLS = st.sampled_from([0.03, 0.06, 0.25, 1.0])


def random_cloud(seed, n, cell, corner=(0, 0), *, towards=None):
    """Points in few voxels around a tile's corner, with unit normals (near a direction, if given) or zeros."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3, 3, (n, 3)) * cell
    points[:, :2] += np.array(corner) * TILE_VOXELS * cell
    normals = rng.normal(size=(n, 3)) * (0.2 if towards is not None else 1.0)
    normals += 0.0 if towards is None else towards
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[rng.random(n) < 0.2] = 0.0
    return points, normals


def dictionary_of_voxels(points, normals, cell):
    """(point, normal) of all points, by the voxel they lie in."""
    voxels = defaultdict(list)
    for point, normal in zip(points, normals, strict=True):
        voxels[tuple(math.floor(value / cell) for value in point.tolist())].append((point, normal))
    return voxels


@given(SEEDS, st.integers(0, 300), CELLS, st.tuples(st.integers(-40, 40), st.integers(-40, 40)))
def test_voxels_hold_counts_mean_unit_normals_and_mean_points(seed, n, cell, corner):
    points, normals = random_cloud(seed, n, cell, corner)
    wanted = dictionary_of_voxels(points, normals, cell)
    point_map = PointMap.from_points(points, normals, cell)
    indices, counts, means = point_map.all_voxels()
    got = [tuple(index) for index in indices.tolist()]
    assert len(set(got)) == len(got) and set(got) == set(wanted)
    places = [tile.mean_points(cell) for tile in point_map.tiles_within(*point_map.bounds[0], 1e6)]
    places = np.concatenate(places or [np.empty((0, 3))])
    for index, count, mean, place in zip(got, counts, means, places, strict=True):
        inside, normals_inside = zip(*wanted[index], strict=True)
        assert count == len(inside)
        np.testing.assert_allclose(place, np.mean(inside, axis=0), rtol=0.0, atol=cell / 512 + 1e-9)
        total = np.sum(normals_inside, axis=0)
        length = np.linalg.norm(total)
        if length > 0.01 * count:
            np.testing.assert_allclose(mean, total / length, atol=1e-5)
        assert np.linalg.norm(mean) == pytest.approx(1.0, abs=1e-6) or not mean.any()
    assert (indices.dtype, counts.dtype, means.dtype) == (np.int32, np.int32, np.float32)
    order = np.random.default_rng(seed).permutation(n)
    again = PointMap.from_points(points[order], normals[order], cell).all_voxels()
    np.testing.assert_array_equal(indices, again[0])
    np.testing.assert_array_equal(counts, again[1])
    np.testing.assert_allclose(means, again[2], atol=1e-4)


@given(SEEDS, st.integers(1, 200))
def test_without_sides_turned_normals_do_not_cancel(seed, n):
    """Normals of one surface, each turned either way: the mean is that of the surface, up to its sign."""
    points, normals = random_cloud(seed, n, 0.06, towards=[0.6, 0.0, 0.8])
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (n, 1))
    _, _, wanted = PointMap.from_points(points, normals).all_voxels()
    turned = PointMap.from_points(points, normals * signs, is_signed=False)
    _, _, means = turned.all_voxels()
    assert not turned.is_signed
    np.testing.assert_array_equal(means.any(axis=1), wanted.any(axis=1))
    cosines = np.abs((means * wanted).sum(axis=1))
    np.testing.assert_allclose(cosines[wanted.any(axis=1)], 1.0, atol=1e-5)


@pytest.mark.parametrize(
    ("normals", "is_signed", "mean"),
    [
        ([[1, 0, 0], [-1, 0, 0]], True, [0, 0, 0]),  # both faces of a thin wall
        ([[1, 0, 0], [-1, 0, 0], [0, 1, 0]], True, [0, 1, 0]),
        ([[1, 0, 0], [0, 0, 0]], True, [1, 0, 0]),
        ([[0, 0, 0], [0, 0, 0]], True, [0, 0, 0]),
        ([[1, 0, 0], [0, 1, 0]], True, [math.sqrt(0.5), math.sqrt(0.5), 0]),
        ([[1, 0, 0], [-1, 0, 0]], False, [1, 0, 0]),
        ([[0, 0, 0], [1, 0, 0], [-1, 0, 0]], False, [1, 0, 0]),
    ],
)
def test_mean_normals_by_hand(normals, is_signed, mean):
    point_map = PointMap.from_points(np.full((len(normals), 3), 0.03), normals, is_signed=is_signed)
    _, counts, means = point_map.all_voxels()
    np.testing.assert_array_equal(counts, [len(normals)])
    np.testing.assert_allclose(means, [mean], atol=1e-7)


@given(SEEDS, st.integers(1, 300), st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_tiles_are_in_the_order_the_search_reads(seed, n, corner):
    points, normals = random_cloud(seed, n, 1.0, corner)
    points[:, :2] += np.random.default_rng(seed).integers(-300, 300, (n, 2))
    point_map = PointMap.from_points(points, normals, 1.0)
    for key in point_map.tile_keys:
        (tile,) = point_map.tiles_within(*((np.array(key) + 0.5) * TILE_VOXELS), 1.0)
        assert tile.key == key
        assert tile.is_in_order
        assert ((tile.voxels[:, :2] // TILE_VOXELS) == key).all()
        x, y = tile.columns.T.astype(int)
        order = list(zip(tile.layers, y // PATCH_VOXELS, x // PATCH_VOXELS, y, x, strict=True))
        assert order == sorted(order)


@given(SEEDS, st.integers(0, 12), st.floats(-300, 300), st.floats(-300, 300), st.floats(0, 200))
def test_tiles_within_against_all_tiles(seed, n, x, y, reach):
    cell = 0.06
    edge = TILE_VOXELS * cell
    keys = np.unique(np.random.default_rng(seed).integers(-6, 6, (n, 2)), axis=0)
    points = np.column_stack([(keys + 0.5) * edge, np.zeros(len(keys))])
    point_map = PointMap.from_points(points, np.zeros((len(keys), 3)), cell)
    wanted = [
        (kx, ky)
        for kx, ky in keys.tolist()
        if kx * edge < x + reach and (kx + 1) * edge > x - reach
        and ky * edge < y + reach and (ky + 1) * edge > y - reach
    ]  # fmt: skip
    got = [tile.key for tile in point_map.tiles_within(x, y, reach)]
    assert set(got) >= set(wanted)
    assert len(got) - len(wanted) <= 0 or _touches(set(got) - set(wanted), x, y, reach, edge)
    assert got == sorted(got)
    assert point_map.covers(x, y, reach) == bool(got)
    assert point_map.tile_keys == {tuple(key) for key in keys.tolist()}


@given(SEEDS, st.integers(0, 40), st.integers(0, 12), st.floats(0.0, 0.5))
def test_tiles_around_positions_against_all_tiles(seed, n, n_positions, margin):
    rng = np.random.default_rng(seed)
    edge = TILE_VOXELS * 0.06
    keys = np.unique(rng.integers(-4, 4, (n, 2)), axis=0)
    points = np.column_stack([(keys + 0.5) * edge, np.zeros(len(keys))])
    point_map = PointMap.from_points(points, np.zeros((len(keys), 3)), 0.06)
    positions = rng.uniform(-6.0, 6.0, (n_positions, 2))
    positions = np.where(rng.random((n_positions, 1)) < 0.3, np.round(positions), positions) * edge  # some on edges
    first, last = np.floor((positions - margin * edge) / edge), np.floor((positions + margin * edge) / edge)
    wanted = [key for key in map(tuple, keys.tolist()) if ((first <= key) & (last >= key)).all(axis=1).any()]
    assert [tile.key for tile in point_map.tiles_around(positions, margin * edge)] == wanted


def _touches(keys, x, y, reach, edge):
    """Whether the square only touches these tiles, to rounding."""
    return all(
        min(abs(a - b) for a, b in itertools.product((kx * edge, (kx + 1) * edge), (x - reach, x + reach))) < 1e-6
        or min(abs(a - b) for a, b in itertools.product((ky * edge, (ky + 1) * edge), (y - reach, y + reach))) < 1e-6
        for kx, ky in keys
    )


def test_bounds_are_those_of_the_tiles():
    nothing = np.empty((0, 3))
    empty = PointMap.from_points(nothing, nothing)
    assert empty.bounds == ((0.0, 0.0), (0.0, 0.0))
    assert not empty.covers(0.0, 0.0, 1e6)
    assert [len(part) for part in empty.all_voxels()] == [0, 0, 0]
    point_map = PointMap.from_points([[1.0, -1.0, 0.0], [70.0, 5.0, 0.0]], np.zeros((2, 3)))
    low, high = point_map.bounds
    np.testing.assert_allclose(low, (0.0, -30.72))
    np.testing.assert_allclose(high, (3 * 30.72, 30.72))


def test_a_map_keeps_what_it_is_given():
    frame = LocalFrame((1.0, 2.0, 3.0), "EPSG:25832")
    point_map = PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], 0.5, frame=frame, is_signed=False)
    assert (point_map.frame, point_map.cell, point_map.is_signed) == (frame, 0.5, False)
    assert PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]).frame == LocalFrame()


@pytest.mark.parametrize("cell", [0.0, -0.06, math.nan, math.inf])
def test_a_voxel_edge_is_positive(cell):
    with pytest.raises(ArrayError, match=f"positive voxel edge `cell` in m, got {cell}"):
        PointMap.from_points(np.zeros((1, 3)), np.zeros((1, 3)), cell)


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        (np.zeros((3, 9)), np.zeros((9, 3)), r"`points` to have shape \(n, 3\), got \(3, 9\)\. Transpose it\?"),
        (np.zeros((2, 3)), np.zeros((3, 3)), "`normals` to have one row per point, 2, got 3"),
        (np.zeros((1, 3)), [[0.5, 0.0, 0.0]], "length 0.5 in row 0. Divide each row by its length"),
        (np.full((1, 3), np.nan), np.zeros((1, 3)), "finite coordinates in `points`"),
        ([[5.4e9, 0.0, 0.0]], np.zeros((1, 3)), "Express them in a local frame"),
    ],
)
def test_what_is_refused(points, normals, words):
    with pytest.raises(ArrayError, match=words):
        PointMap.from_points(points, normals)
