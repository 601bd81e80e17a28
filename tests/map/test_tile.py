"""The voxels of a tile, and of several in a table, are found as in a dictionary; tiles are kept by use."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS, VoxelTile
from maxcon.map.lookup_kernels import find_in_patch, find_patch, is_near_voxels, plane_of_voxel
from maxcon.map.tile import TileCache, search_order
from maxcon.map.voxel_table import TileTable, voxel_table

SEEDS = st.integers(0, 2**32)


def tile_of(voxels):
    """Tile that holds these (x, y, z)."""
    voxels = np.unique(np.asarray(voxels, np.int64).reshape(-1, 3), axis=0)
    columns, layers = voxels[:, :2].astype(np.int16), voxels[:, 2].astype(np.int32)
    order = search_order(columns, layers)
    n = len(order)
    counts, normals, means = np.ones(n, np.int32), np.zeros((n, 3), np.float32), np.zeros((n, 3), np.uint8)
    return VoxelTile((3, -4), columns[order], layers[order], counts, normals, means)


@given(
    SEEDS, st.sampled_from([1, 2, 30, 2000]), st.sampled_from([3, 40, TILE_VOXELS]),
    st.sampled_from([1, 5, 63, 64, 65, 200]),
)  # fmt: skip
def test_occupancy_and_index_hold_each_voxel_once(seed, n, width, height):
    rng = np.random.default_rng(seed)
    low = rng.integers(0, TILE_VOXELS - width + 1, 2)
    tile = tile_of(rng.integers([*low, -100], [*(low + width), height - 100], (n, 3)))
    assert tile.is_in_order
    x, y = tile.columns.T.astype(np.int64) // PATCH_VOXELS
    patches = (np.searchsorted(tile.index.layers, tile.layers) * TILE_PATCHES + y) * TILE_PATCHES + x
    starts = np.searchsorted(patches, np.arange(len(tile.index.layers) * TILE_PATCHES**2 + 1))
    assert (tile.index.patch_starts == starts).all()
    occupancy = tile.occupancy
    assert np.bitwise_count(occupancy.words).sum() == len(tile)
    assert np.bitwise_count(occupancy.held).sum() == len(occupancy.words)


def test_full_patches_and_none():
    x, y = np.meshgrid(np.arange(480, 512), np.arange(0, 32))
    tile = tile_of(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 7)]))
    assert (tile.occupancy.words == np.uint64(2**64 - 1)).all() and all_found([tile]) == 1024
    nothing = tile_of([]).occupancy
    assert not nothing.held.any() and nothing.words.shape == (0, 4)


@pytest.mark.parametrize(("n", "height"), [(0, 1), (1, 63), (500, 64), (500, 130)])
def test_the_size_is_known_before_anything_is_made(n, height):
    tile = tile_of(np.random.default_rng(n).integers(0, [400, 300, height], (n, 3)))
    told = tile.n_bytes
    assert "occupancy" not in vars(tile)
    index, occupancy = tile.index, tile.occupancy
    arrays = [tile.columns, tile.layers, tile.counts, tile.normals, tile.means]
    arrays += [index.layers, index.patch_starts, tile.layer_numbers]
    arrays += [occupancy.held, occupancy.numbers, occupancy.words, occupancy.firsts]
    assert told == sum(array.nbytes for array in arrays)


@given(SEEDS, st.sampled_from([1, 2, 3, 40]), st.sampled_from([2, 20, TILE_VOXELS]))
def test_other_orders_are_noticed(seed, n, width):
    rng = np.random.default_rng(seed)
    tile = tile_of(rng.integers([0, 0, 0], [width, width, 3], (n, 3)))
    order = rng.permutation(len(tile))
    if len(tile) > 2:  # mostly two neighbours only
        k = rng.integers(len(tile) - 1)
        order = np.arange(len(tile))
        order[[k, k + 1]] = order[[k + 1, k]]
    assert tile.rows(order).is_in_order == (order == np.arange(len(tile))).all()
    for bad in (-1, TILE_VOXELS):
        columns = tile.columns.copy()
        columns[rng.integers(len(tile)), rng.integers(2)] = bad
        assert not replace(tile, columns=columns).is_in_order
    assert not tile.rows(np.repeat(np.arange(len(tile)), 2)).is_in_order


# --- the cache ---
def loaded(cache, numbers):
    """Load tiles by their numbers; return those that had to be made, and the numbers of all that are kept."""
    made, make = [], cache._make
    cache._make = lambda key: made.append(key[0]) or make(key)
    for number in numbers:
        cache.load((number, 0))
    cache._make = make
    return made, [number for number in range(10) if (number, 0) in cache._tiles]


def test_those_used_longest_ago_go_first_and_no_more_than_must():
    cache = TileCache(lambda key: SimpleNamespace(n_bytes={5: 25, 6: 5, 7: 99}.get(key[0], 10)), 30)
    assert loaded(cache, [1, 2, 1, 3, 3, 2]) == ([1, 2, 3], [1, 2, 3])  # as many as fit
    assert loaded(cache, [1, 4]) == ([4], [1, 2, 4])  # in the place of 3
    assert loaded(cache, [5]) == ([5], [5])  # in the place of all
    assert loaded(cache, [6]) == ([6], [5, 6])
    assert loaded(cache, [7, 7]) == ([7], [7])  # the last one, whatever its size


def test_threads_make_different_tiles_at_once():
    """Each waits until the others are at it, too: under one lock none would ever be done."""
    together = threading.Barrier(4, timeout=60)

    def make(_):
        together.wait()
        return SimpleNamespace(n_bytes=1)

    cache = TileCache(make, 1000)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda number: cache.load((number, 0)), range(4)))
    assert loaded(cache, []) == ([], [0, 1, 2, 3])


@pytest.mark.parametrize("error", [None, OSError("gone")])
def test_a_tile_that_several_threads_ask_for_is_made_once(error):
    made, may_end = [], threading.Event()

    def make(_):
        made.append(1)
        assert may_end.wait(60)
        if error is not None:
            raise error
        return SimpleNamespace(n_bytes=1)

    cache = TileCache(make, 1000)
    with ThreadPoolExecutor(4) as pool:
        first = pool.submit(cache.load, (1, 0))
        while not made:
            pass
        others = [pool.submit(cache.load, (1, 0)) for _ in range(3)]
        while sum(future.running() for future in others) < 3:
            pass
        threading.Timer(0.05, may_end.set).start()
    assert all(future.exception() is error for future in (first, *others))
    assert made == [1] or error is not None  # who asks after an error tries again
    error = None
    assert loaded(cache, [1])[0] == ([] if len(made) == 1 and first.exception() is None else [1])


def test_of_tiles_that_are_made_ahead_each_is_made_once_and_who_asks_is_served_first():
    made, may_answer = [], threading.Event()

    def make(key):
        assert not threading.current_thread().name.startswith("prefetch") or may_answer.wait(60)
        made.append(key[0])
        if key[0] == 13:
            raise OSError("unlucky")
        return SimpleNamespace(n_bytes=1)

    cache = TileCache(make, 1000, [(number, 0) for number in range(40)])
    for _ in range(3):
        cache.prefetch([(number, 0) for number in [*range(12), 99]])  # there is no tile 99
    cache.load((11, 0))  # while all threads still wait
    assert made == [11]
    may_answer.set()
    assert loaded(cache, range(13))[1] == list(range(10)) and sorted(made) == list(range(13))
    cache.prefetch([(number, 0) for number in range(13, 40)])
    for _ in range(2):  # asked again, it is tried again
        with pytest.raises(OSError, match="unlucky"):
            cache.load((13, 0))
    cache.load((39, 0))


def tiles_of(rng, n, spread):
    points = rng.normal(0.0, spread, (n, 3)) * [1.0, 1.0, 0.2]
    return PointMap.from_points(points, np.zeros((n, 3)), 0.06).tiles_within(0.0, 0.0, 1e3)


def all_found(tiles, others=()):
    """Check that voxels of tiles, and no others, are found in their table, with their means; return their number."""
    voxels = np.concatenate([np.empty((0, 3), int), *(tile.voxels for tile in tiles)])
    there = {tuple(voxel): k for k, voxel in enumerate(voxels.tolist())}
    table = voxel_table(tiles)
    means = np.concatenate([np.empty((0, 3)), *(tile.mean_points(0.06) for tile in tiles)])
    for x, y, z in [*there, *others]:
        patch = find_patch(x, y, z, table)
        number = find_in_patch(x, y, patch, table) if patch >= 0 else -1
        assert number == there.get((x, y, z), -1)
        if number >= 0:
            np.testing.assert_allclose(plane_of_voxel(number, x, y, z, 0.06, table)[3:], means[number])
    return len(there)


@given(SEEDS, st.sampled_from([0, 1, 200]), st.sampled_from([0.3, 30.0]))
def test_voxels_are_found_as_in_a_dictionary(seed, n, spread):
    rng = np.random.default_rng(seed)
    tiles = tiles_of(rng, n, spread)
    near = [np.add(voxel, rng.integers(-1, 2, 3)).tolist() for tile in tiles for voxel in tile.voxels.tolist()]
    all_found(tiles, [*near, *rng.integers(-3 * TILE_VOXELS, 3 * TILE_VOXELS, (50, 3)).tolist()])


@given(SEEDS, st.sampled_from([(0, 2**25), (2**29, 2**25), (2**24, 0)]))
def test_tables_that_were_given_out_stay_as_they_are_while_more_tiles_come(seed, limits):
    rng = np.random.default_rng(seed)
    tiles = {tile.key: tile for tile in tiles_of(rng, 200, 1.0)}
    load, table, given_out = (lambda keys: [tiles[key] for key in keys]), TileTable(), []
    with pytest.MonkeyPatch.context() as patch:
        for name, limit in zip(("MOST_BYTES", "LARGE"), limits, strict=True):
            patch.setattr(f"maxcon.map.voxel_table.{name}", limit)
        for _ in range(4):
            keys = [key for key in tiles if rng.random() < 0.5]
            given_out.append((keys, table.of(keys, load)))
    for keys, found in given_out:
        plain = voxel_table([tiles[key] for key in keys])
        for key in tiles:
            for voxel in tiles[key].voxels[:20].tolist():
                patch = find_patch(*voxel, found)
                number = find_in_patch(*voxel[:2], patch, found) if patch >= 0 else -1
                assert (number >= 0) == (key in keys)
                if number >= 0:
                    wanted = find_in_patch(*voxel[:2], find_patch(*voxel, plain), plain)
                    assert plane_of_voxel(number, *voxel, 0.06, found) == plane_of_voxel(wanted, *voxel, 0.06, plain)


@given(SEEDS)
def test_a_large_table_has_room_for_all_that_come(seed):
    tiles = {tile.key: tile for tile in tiles_of(np.random.default_rng(seed), 200, 30.0)}
    load, table = (lambda keys: [tiles[key] for key in keys]), TileTable()
    with pytest.MonkeyPatch.context() as patch:
        for name, limit in (("MOST_BYTES", 2**24), ("LARGE", 0)):
            patch.setattr(f"maxcon.map.voxel_table.{name}", limit)
        table.of([max(tiles, key=lambda key: len(tiles[key]))], load)
        arrays = table._arrays.copy()
        table.of(tiles, load)
    assert len(tiles) > 1 and all(now is before for now, before in zip(table._arrays, arrays, strict=True))


@given(SEEDS, st.sampled_from([1, 500]), st.sampled_from([0.3, 30.0]))
def test_no_voxel_within_the_reaches_of_a_place_is_overlooked(seed, n, spread):
    rng = np.random.default_rng(seed)
    tiles = tiles_of(rng, n, spread)
    table, voxels = voxel_table(tiles), np.concatenate([tile.voxels for tile in tiles])
    for _ in range(20):
        reaches = rng.uniform(0.0, 6.0, 3)
        place = voxels[rng.integers(len(voxels))] + 0.5 + rng.uniform(-12.0, 12.0, 3)
        low, high = np.floor(place - reaches), np.floor(place + reaches)
        if ((voxels >= low) & (voxels <= high)).all(axis=1).any():
            assert is_near_voxels(tuple(place.tolist()), tuple(reaches.tolist()), table)
    far = voxels.max(axis=0) + 3.0 * TILE_VOXELS
    assert not is_near_voxels(tuple(far.tolist()), (5.0, 5.0, 5.0), table)


@pytest.fixture(scope="module")
def point_map():
    rng = np.random.default_rng(0)
    points, directions = rng.uniform([-40.0, -40.0, 0.0], [40.0, 40.0, 8.0], (20_000, 3)), rng.normal(size=(20_000, 3))
    normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    normals[::5] = 0.0
    return PointMap.from_points(points, normals, 0.5)


def test_every_voxel_has_its_normal_and_no_product_is_larger_than_its_bound(point_map):
    grid = point_map.normals_around(3.0, -5.0, 20.0, (1.0, 7.0))
    voxels, _, normals = point_map.all_voxels()
    places = voxels - grid.low
    size = np.array(grid.shape[::-1])
    is_in = ((places >= 0) & (places < size)).all(axis=1)
    x, y, z = places[is_in].T
    flat = (z * size[1] + y) * size[0] + x
    assert np.abs(grid.normals[flat] / 127.0 - normals[is_in, :2]).max() <= 0.5 / 127.0 + 1e-6
    others = np.ones(len(grid.normals), bool)
    others[flat] = False
    assert not (grid.normals[others].any() or grid.along[others].any() or grid.across[others].any())
    squares = (grid.normals[flat].astype(float) / 127.0) ** 2
    total = grid.along[flat].astype(float) + grid.across[flat]
    assert (total >= 64.0 * squares.sum(axis=1) - 1e-9).all() and (total <= 64.0 * squares.sum(axis=1) + 2.0).all()


def test_a_grid_that_reaches_into_another_tile_holds_its_voxels_too():
    points = np.random.default_rng(1).uniform([20.0, -9.0, 0.0], [80.0, 9.0, 3.0], (5000, 3))
    tiles = PointMap.from_points(points, np.tile([1.0, 0.0, 0.0], (5000, 1)), 0.12)  # of 61.44 m
    grid = tiles.normals_around(50.0, 0.0, 10.0, (0.0, 3.0))
    voxels = tiles.all_voxels()[0] - grid.low
    is_in = ((voxels >= 0) & (voxels < np.array(grid.shape[::-1]))).all(axis=1)
    assert np.count_nonzero(grid.normals[:, 0]) == is_in.sum() > 0
    assert ((voxels[is_in] + grid.low)[:, 0] * 0.12 > 61.44).any()


def test_the_grid_is_kept_while_it_covers_what_is_asked_for(point_map):
    grid = point_map.normals_around(3.0, -5.0, 20.0, (1.0, 7.0))
    assert point_map.normals_around(2.0, -4.0, 15.0, (2.0, 6.0)) is grid
    assert point_map.normals_around(3.0, -5.0, 20.0, (1.0, 30.0)) is not grid
