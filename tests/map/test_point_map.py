"""PointMap against a dictionary of voxels, its tiles against brute force, and its levels against merging by hand."""

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import LocalFrame, PointMap
from maxcon.errors import ArrayError, OptionError
from maxcon.io.crs import metric_crs
from maxcon.map import PATCH_VOXELS, TILE_VOXELS
from maxcon.map.layout import MEAN_STEPS
from maxcon.map.voxelize import CANCELLED_LENGTH

SEEDS = st.integers(0, 2**32)
CORNERS = st.tuples(st.integers(-40, 40), st.integers(-40, 40))
NOTHING = np.empty((0, 3))


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


@given(SEEDS, st.integers(0, 300), st.sampled_from([0.03, 0.06, 0.25, 1.0]), CORNERS)
def test_voxels_hold_counts_mean_unit_normals_and_mean_points(seed, n, cell, corner):
    points, normals = random_cloud(seed, n, cell, corner)
    wanted = defaultdict(list)
    for point, normal in zip(points, normals, strict=True):
        wanted[tuple(math.floor(value / cell) for value in point.tolist())].append((point, normal))
    point_map = PointMap.from_points(points, normals, cell)
    indices, counts, means = point_map.all_voxels()
    got = [tuple(index) for index in indices.tolist()]
    assert len(set(got)) == len(got) and set(got) == set(wanted)
    places = [tile.mean_points(cell) for tile in point_map.tiles_within(*point_map.bounds[0], 1e6)]
    for index, count, mean, place in zip(got, counts, means, np.concatenate(places or [NOTHING]), strict=True):
        inside, normals_inside = zip(*wanted[index], strict=True)
        assert count == len(inside)
        assert np.abs(place - np.mean(inside, axis=0)).max() <= cell / 512 + 1e-9
        total = np.sum(normals_inside, axis=0)
        length = np.linalg.norm(total)
        assert length <= 0.01 * count or np.abs(mean - total / length).max() < 1e-5
        assert np.linalg.norm(mean) == pytest.approx(1.0, abs=1e-6) or not mean.any()
    assert (indices.dtype, counts.dtype, means.dtype) == (np.int32, np.int32, np.float32)
    for key in point_map.tile_keys:
        tile = point_map.tile(key)
        assert tile.key == key and tile.is_in_order
        assert ((tile.voxels[:, :2] // TILE_VOXELS) == key).all()
        x, y = tile.columns.T.astype(int)
        order = list(zip(tile.layers, y // PATCH_VOXELS, x // PATCH_VOXELS, y, x, strict=True))
        assert order == sorted(order)
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
    wanted = PointMap.from_points(points, normals).all_voxels()[2]
    turned = PointMap.from_points(points, normals * signs, is_signed=False)
    means = turned.all_voxels()[2]
    assert not turned.is_signed
    np.testing.assert_array_equal(means.any(axis=1), wanted.any(axis=1))
    np.testing.assert_allclose(np.abs((means * wanted).sum(axis=1))[wanted.any(axis=1)], 1.0, atol=1e-5)


@pytest.mark.parametrize(("normals", "is_signed", "mean"), [
    ([[1, 0, 0], [-1, 0, 0]], True, [0, 0, 0]),  # both faces of a thin wall
    ([[1, 0, 0], [-1, 0, 0], [0, 1, 0]], True, [0, 1, 0]),
    ([[0, 0, 0], [1, 0, 0], [-1, 0, 0]], False, [1, 0, 0]),
])  # fmt: skip
def test_mean_normals_by_hand(normals, is_signed, mean):
    point_map = PointMap.from_points(np.full((len(normals), 3), 0.03), normals, is_signed=is_signed)
    _, counts, means = point_map.all_voxels()
    np.testing.assert_array_equal(counts, [len(normals)])
    np.testing.assert_allclose(means, [mean], atol=1e-7)


def map_of_tiles(keys, cell):
    """A map with a voxel in the middle of each of some tiles."""
    points = np.column_stack([(keys + 0.5) * TILE_VOXELS * cell, np.zeros(len(keys))])
    return PointMap.from_points(points, np.zeros((len(keys), 3)), cell)


@given(SEEDS, st.integers(0, 12), st.integers(-3000, 3000), st.integers(-3000, 3000), st.integers(0, 2000))
def test_tiles_within_against_all_tiles(seed, n, x, y, reach):
    """At multiples of 1/8 m in tiles of 32 m: sums are exact, and squares that end at the edge of a tile occur."""
    keys = np.unique(np.random.default_rng(seed).integers(-6, 6, (n, 2)), axis=0)
    point_map = map_of_tiles(keys, 0.0625)
    first, last = [(x - reach) // 256, (y - reach) // 256], [(x + reach) // 256, (y + reach) // 256]
    wanted = [tuple(key) for key in keys.tolist() if (first <= np.array(key)).all() and (key <= np.array(last)).all()]
    place = np.array([x, y, reach]) / 8
    assert [tile.key for tile in point_map.tiles_within(*place)] == wanted == point_map.keys_within(*place)
    assert point_map.covers(*place) == bool(wanted)
    assert point_map.tile_keys == set(map(tuple, keys.tolist()))


@given(SEEDS, st.integers(0, 40), st.integers(0, 12), st.floats(0.0, 0.5))
def test_tiles_around_positions_against_all_tiles(seed, n, n_positions, margin):
    rng = np.random.default_rng(seed)
    edge = TILE_VOXELS * 0.06
    keys = np.unique(rng.integers(-4, 4, (n, 2)), axis=0)
    positions = rng.uniform(-6.0, 6.0, (n_positions, 2))
    positions = np.where(rng.random((n_positions, 1)) < 0.3, np.round(positions), positions) * edge  # some on edges
    first, last = np.floor((positions - margin * edge) / edge), np.floor((positions + margin * edge) / edge)
    wanted = [key for key in map(tuple, keys.tolist()) if ((first <= key) & (last >= key)).all(axis=1).any()]
    assert map_of_tiles(keys, 0.06).keys_around(np.insert(positions, 2, 0.0, axis=1), margin * edge) == wanted


def test_a_map_has_the_bounds_of_its_tiles_keeps_what_it_is_given_and_has_a_short_repr():
    empty = PointMap.from_points(NOTHING, NOTHING)
    assert empty.bounds == ((0.0, 0.0), (0.0, 0.0)) and empty.frame == LocalFrame()
    assert not empty.covers(0.0, 0.0, 1e6)
    assert [len(part) for part in empty.all_voxels()] == [0, 0, 0]
    frame = LocalFrame((1.0, 2.0, 3.0), "EPSG:25832")
    point_map = PointMap.from_points([[1, -1, 0], [70, 5, 0.0]], np.zeros((2, 3)), frame=frame, is_signed=False)
    np.testing.assert_allclose(point_map.bounds, ((0.0, -30.72), (3 * 30.72, 30.72)))
    assert (point_map.frame, point_map.cell, point_map.is_signed) == (frame, 0.06, False)
    points, normals = [[0.0, 0.0, 0.0], [40.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]] * 2
    assert repr(PointMap.from_points(points, normals)) == "PointMap(2 tiles, 61 x 31 m, no CRS)"
    frame = LocalFrame((0.0, 0.0, 0.0), crs=metric_crs("EPSG:25832"))
    assert repr(PointMap.from_points(points, normals, frame=frame)).endswith("m, EPSG:25832)")
    assert repr(frame) == "LocalFrame(0, 0, 0, EPSG:25832)"


@pytest.mark.parametrize(("points", "normals", "cell", "words"), [
    (np.zeros((2, 3)), np.zeros((3, 3)), 0.06, "`normals` to have one row per point, 2, got 3"),
    (np.zeros((1, 3)), [[0.5, 0.0, 0.0]], 0.06, "length 0.5 in row 0. Divide each row by its length"),
    (np.full((1, 3), np.nan), np.zeros((1, 3)), 0.06, "finite coordinates in `points`"),
    *((NOTHING, NOTHING, cell, f"edge `cell` in m, got {cell}") for cell in (0.0, math.nan, math.inf)),
])  # fmt: skip
def test_points_that_make_no_map_are_refused(points, normals, cell, words):
    with pytest.raises(ArrayError, match=words):
        PointMap.from_points(points, normals, cell)


# --- levels ---
def clumps(seed, *, is_signed):
    """A map of points in clumps over a few tiles, some without a normal."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-40.0, 40.0, (12, 3)) * [1.0, 1.0, 0.05]
    points = middles[rng.integers(0, 12, 200)] + rng.normal(0.0, 0.15, (200, 3))
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(200) < 0.2] = 0.0
    return PointMap.from_points(points, normals, is_signed=is_signed)


def merged_one_by_one(point_map, factor):
    """The definition: voxel by voxel of the map, in the order of its tiles."""
    n_points, sums, totals = (defaultdict(int), defaultdict(lambda: np.zeros(3)), defaultdict(lambda: np.zeros(3)))
    for key in sorted(point_map.tile_keys):
        tile = point_map.tile(key)
        for voxel, count, normal, mean in zip(tile.voxels, tile.counts, tile.normals, tile.means, strict=True):
            larger, normal = tuple((voxel // factor).tolist()), normal.astype(np.float64)
            if not point_map.is_signed and sums[larger] @ normal < 0.0:
                normal = -normal
            n_points[larger] += int(count)
            sums[larger] += count * normal
            totals[larger] += count * (voxel % factor + (mean + 0.5) / MEAN_STEPS)
    found = {}
    for voxel, n in n_points.items():
        length = np.linalg.norm(sums[voxel])
        normal = sums[voxel] / length if length > CANCELLED_LENGTH * n else np.zeros(3)
        found[voxel] = (n, normal, totals[voxel] / (n * factor))
    return found


@given(seed=st.integers(0, 10_000), factor=st.sampled_from([2, 4, 8, 32]), is_signed=st.booleans())
def test_a_level_is_what_voxel_by_voxel_gives(seed, factor, is_signed):
    point_map = clumps(seed, is_signed=is_signed)
    level, expected = point_map.level(factor), merged_one_by_one(point_map, factor)
    for key in level.tile_keys:
        tile = level.tile(key)
        assert tile.is_in_order and tile.edge == TILE_VOXELS // factor
        counts, normals, means = zip(*[expected.pop(tuple(voxel)) for voxel in tile.voxels.tolist()], strict=True)
        np.testing.assert_array_equal(tile.counts, counts)
        np.testing.assert_allclose(tile.normals, normals, atol=1e-6)
        np.testing.assert_allclose((tile.means + 0.5) / MEAN_STEPS, means, atol=0.51 / MEAN_STEPS)
    assert not expected


def test_a_level_has_the_edges_of_its_voxels_and_the_tiles_of_its_map(monkeypatch):
    monkeypatch.setattr("maxcon.map.point_map.LEVEL_BYTES", 1)  # tiles are not kept, and merged again
    point_map = clumps(1, is_signed=True)
    level = point_map.level(8)
    assert level.cell == pytest.approx(0.48)
    assert level.tile_keys == point_map.tile_keys and len(level.tile_keys) > 1
    np.testing.assert_allclose(level.bounds, point_map.bounds)
    assert level is point_map.level(8) and point_map.level(1) is point_map
    for one, again in zip(level.all_voxels(), level.all_voxels(), strict=True):
        np.testing.assert_array_equal(one, again)
    for factor in (0, -2, 3, 64):
        with pytest.raises(OptionError, match=rf"2, 4, \.\.\. or 32 times as large as the map's, got {factor}\."):
            point_map.level(factor)
