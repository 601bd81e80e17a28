# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The voxels of a tile are found by its occupancy, and in several tiles as in a dictionary of them."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.map import PATCH_VOXELS, TILE_PATCHES, TILE_VOXELS, PointMap, VoxelTile
from maxcon.map.lookup_kernels import find_in_patch, find_patch, is_near_voxels
from maxcon.map.tile import VoxelLookup, search_order


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
    seed=st.integers(0, 2**32),
    n=st.sampled_from([1, 2, 30, 2000]),
    width=st.sampled_from([3, 40, TILE_VOXELS]),
    height=st.sampled_from([1, 5, 63, 64, 65, 200]),
)
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


def test_addresses_are_those_of_the_arrays_also_of_a_copy():
    tile = tile_of(np.random.default_rng(0).integers(0, 100, (500, 3)))
    before = tile.addresses
    for each in (tile, pickle.loads(pickle.dumps(tile)), copy.deepcopy(tile)):
        bits, addresses = each.occupancy, each.addresses
        arrays = [bits.held, bits.numbers, bits.words, bits.firsts, each.normals, each.counts, each.means]
        assert addresses.values.tolist() == [array.ctypes.data for array in addresses.kept]
        for array, kept in zip(arrays, addresses.kept, strict=True):
            np.testing.assert_array_equal(array, kept)
        assert (each is tile) == (addresses.values == before.values).all()


def test_arrays_in_pieces_are_copied():
    tile = tile_of(np.random.default_rng(0).integers(0, 100, (500, 3)))
    counts, normals = np.arange(1000, dtype=np.int32)[::2], np.asfortranarray(tile.normals + np.float32(0.5))
    addresses = VoxelTile(tile.key, tile.columns, tile.layers, counts, normals, tile.means).addresses
    for array, kept in zip((normals, counts, tile.means), addresses.kept[4:], strict=True):
        assert kept.flags.c_contiguous and (array == kept).all()


@pytest.mark.parametrize("n", [0, 1, 500])
@pytest.mark.parametrize("height", [1, 63, 64, 130])
def test_the_size_is_known_before_anything_is_made(n, height):
    tile = tile_of(np.random.default_rng(n).integers(0, [400, 300, height], (n, 3)))
    told = tile.n_bytes
    assert "occupancy" not in vars(tile)
    index, occupancy = tile.index, tile.occupancy
    arrays = [tile.columns, tile.layers, tile.counts, tile.normals, tile.means]
    arrays += [index.layers, index.patch_starts, tile.layer_numbers]
    arrays += [occupancy.held, occupancy.numbers, occupancy.words, occupancy.firsts]
    assert told == sum(array.nbytes for array in arrays)


def plain_patches(tile):
    """Number of each voxel's patch among those of all layers."""
    _, layer = np.unique(tile.layers, return_inverse=True)
    x, y = tile.columns.T.astype(np.int64) // PATCH_VOXELS
    return (layer * TILE_PATCHES + y) * TILE_PATCHES + x


@given(seed=st.integers(0, 2**32), n=st.sampled_from([0, 1, 2, 300]), width=st.sampled_from([20, TILE_VOXELS]))
def test_patches_begin_where_their_voxels_do(seed, n, width):
    rng = np.random.default_rng(seed)
    tile = tile_of(rng.integers([0, 0, -4], [width, width, 9], (n, 3)))
    assert (tile.index.layers == np.unique(tile.layers)).all()
    n_patches = len(tile.index.layers) * TILE_PATCHES**2
    wanted = np.searchsorted(plain_patches(tile), np.arange(n_patches + 1))
    assert (tile.index.patch_starts == wanted).all()


@given(seed=st.integers(0, 2**32), n=st.sampled_from([1, 2, 3, 40]), width=st.sampled_from([2, 20, TILE_VOXELS]))
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
    twice = np.repeat(np.arange(len(tile)), 2)
    assert not tile.rows(twice).is_in_order


# --- several tiles ------------------------------------------------------------------------------------


def map_of(rng, n, spread):
    points = rng.normal(0.0, spread, (n, 3)) * [1.0, 1.0, 0.2]
    return PointMap.from_points(points, np.zeros((n, 3)), 0.06)


@given(st.integers(0, 2**32), st.sampled_from([0, 1, 500]), st.sampled_from([0.3, 30.0]))
def test_voxels_are_found_as_in_a_dictionary(seed, n, spread):
    rng = np.random.default_rng(seed)
    point_map = map_of(rng, n, spread)
    tiles = point_map.tiles_within(0.0, 0.0, 1e3)
    there = {
        tuple(voxel): (row, k) for row, tile in enumerate(tiles, 1) for k, voxel in enumerate(tile.voxels.tolist())
    }
    lookup = VoxelLookup.of(tiles)
    near = [tuple(np.add(voxel, rng.integers(-1, 2, 3)).tolist()) for voxel in there]
    far = rng.integers(-3 * TILE_VOXELS, 3 * TILE_VOXELS, (50, 3)).tolist()
    for x, y, z in [*there, *near, *map(tuple, far)]:
        wanted = there.get((x, y, z), (0, 0))
        row, patch = find_patch(x, y, z, lookup.rows, lookup.grid, lookup.corner)
        is_held, number = find_in_patch(x, y, row, patch, lookup.rows) if row else (False, 0)
        assert ((row, number) if is_held else (0, 0)) == wanted


@given(st.integers(0, 2**32), st.sampled_from([1, 500]), st.sampled_from([0.3, 30.0]))
def test_no_voxel_within_the_reaches_of_a_place_is_overlooked(seed, n, spread):
    rng = np.random.default_rng(seed)
    tiles = map_of(rng, n, spread).tiles_within(0.0, 0.0, 1e3)
    lookup = VoxelLookup.of(tiles)
    voxels = np.concatenate([tile.voxels for tile in tiles])
    table = lookup.rows, lookup.grid, lookup.corner
    for _ in range(50):
        reaches = rng.uniform(0.0, 6.0, 3)
        place = voxels[rng.integers(len(voxels))] + 0.5 + rng.uniform(-12.0, 12.0, 3)
        low, high = np.floor(place - reaches), np.floor(place + reaches)
        if ((voxels >= low) & (voxels <= high)).all(axis=1).any():
            assert is_near_voxels(tuple(place.tolist()), tuple(reaches.tolist()), *table)
    far = voxels.max(axis=0) + 3.0 * TILE_VOXELS
    assert not is_near_voxels(tuple(far.tolist()), (5.0, 5.0, 5.0), *table)
