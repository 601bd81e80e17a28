# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The voxels of a tile are found by its occupancy; tiles are kept by use."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS, VoxelTile
from maxcon.map.tile import TileCache, search_order

SEEDS = st.integers(0, 2**32)


def tile_of(voxels):
    """Tile that holds these (x, y, z)."""
    voxels = np.unique(np.asarray(voxels, np.int64).reshape(-1, 3), axis=0)
    columns, layers = voxels[:, :2].astype(np.int16), voxels[:, 2].astype(np.int32)
    order = search_order(columns, layers)
    n = len(order)
    counts, normals, means = np.ones(n, np.int32), np.zeros((n, 3), np.float32), np.zeros((n, 3), np.uint8)
    return VoxelTile((3, -4), columns[order], layers[order], counts, normals, means)


def number_of(tile, x, y, layer):
    """Number of a voxel by the tile's occupancy, None where there is none."""
    occupancy, patch = tile.occupancy, (y // PATCH_VOXELS, x // PATCH_VOXELS, layer // 64)
    held, bit = int(occupancy.held[patch]), layer % 64
    if not held >> bit & 1:
        return None
    number = occupancy.numbers[patch] + (held & ((1 << bit) - 1)).bit_count()
    word, bit = y % PATCH_VOXELS // 4, y % 4 * PATCH_VOXELS + x % PATCH_VOXELS
    bits = int(occupancy.words[number, word])
    if not bits >> bit & 1:
        return None
    return occupancy.firsts[number, word] + (bits & ((1 << bit) - 1)).bit_count()


@given(
    SEEDS, st.sampled_from([1, 2, 30, 2000]), st.sampled_from([3, 40, TILE_VOXELS]),
    st.sampled_from([1, 5, 63, 64, 65, 200]),
)  # fmt: skip
def test_each_voxel_is_found_and_no_other(seed, n, width, height):
    rng = np.random.default_rng(seed)
    low = rng.integers(0, TILE_VOXELS - width + 1, 2)
    tile = tile_of(rng.integers([*low, -100], [*(low + width), height - 100], (n, 3)))
    assert tile.is_in_order
    layers = np.searchsorted(tile.index.layers, tile.layers).tolist()
    there = {(x, y, layer): k for k, ((x, y), layer) in enumerate(zip(tile.columns.tolist(), layers, strict=True))}
    assert [number_of(tile, *place) for place in there] == list(there.values())
    for place in rng.integers([*low, 0], [*(low + width), len(tile.index.layers) + 1], (100, 3)).tolist():
        assert number_of(tile, *place) == there.get(tuple(place))
    x, y = tile.columns.T.astype(np.int64) // PATCH_VOXELS
    patches = (np.array(layers) * TILE_PATCHES + y) * TILE_PATCHES + x
    starts = np.searchsorted(patches, np.arange(len(tile.index.layers) * TILE_PATCHES**2 + 1))
    assert (tile.index.patch_starts == starts).all()
    occupancy = tile.occupancy
    assert np.bitwise_count(occupancy.words).sum() == len(tile)
    assert np.bitwise_count(occupancy.held).sum() == len(occupancy.words)


def test_full_patches_and_none():
    x, y = np.meshgrid(np.arange(480, 512), np.arange(0, 32))
    tile = tile_of(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 7)]))
    assert (tile.occupancy.words == np.uint64(2**64 - 1)).all()
    assert sorted(number_of(tile, x, y, 0) for x in range(480, 512) for y in range(32)) == list(range(1024))
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


# --- the cache ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sized:
    """What the cache asks of a tile."""

    n_bytes: int


def loaded(cache, numbers):
    """Load tiles by their numbers; return those that had to be made, and the numbers of all that are kept."""
    made, make = [], cache._make
    cache._make = lambda key: made.append(key[0]) or make(key)
    for number in numbers:
        cache.load((number, 0))
    cache._make = make
    return made, [number for number in range(10) if (number, 0) in cache._tiles]


def test_those_used_longest_ago_go_first_and_no_more_than_must():
    cache = TileCache(lambda key: Sized({5: 25, 6: 5, 7: 99}.get(key[0], 10)), 30)
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
        return Sized(1)

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
        return Sized(1)

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
        return Sized(1)

    cache = TileCache(make, 1000, [(number, 0) for number in range(40)])
    for _ in range(3):
        cache.prefetch([(number, 0) for number in [*range(12), 99]])  # there is no tile 99
    cache.load((11, 0))  # while all threads still wait
    assert made == [11]
    may_answer.set()
    assert loaded(cache, range(13))[1] == list(range(10))
    assert sorted(made) == list(range(13))
    cache.prefetch([(number, 0) for number in range(13, 40)])
    for _ in range(2):  # asked again, it is tried again
        with pytest.raises(OSError, match="unlucky"):
            cache.load((13, 0))
    cache.load((39, 0))
