# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The voxels of several tiles are found in their table as in a dictionary."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.map import TILE_VOXELS, PointMap
from maxcon.map.lookup_kernels import find_in_patch, find_patch, is_near_voxels, n_bits, plane_of_voxel
from maxcon.map.voxel_table import TileTable, voxel_table

SEEDS = st.integers(0, 2**32)


def tiles_of(rng, n, spread):
    points = rng.normal(0.0, spread, (n, 3)) * [1.0, 1.0, 0.2]
    return PointMap.from_points(points, np.zeros((n, 3)), 0.06).tiles_within(0.0, 0.0, 1e3)


@given(SEEDS, st.sampled_from([0, 1, 500]), st.sampled_from([0.3, 30.0]))
def test_voxels_are_found_as_in_a_dictionary(seed, n, spread):
    rng = np.random.default_rng(seed)
    tiles = tiles_of(rng, n, spread)
    voxels = np.concatenate([np.empty((0, 3), int), *(tile.voxels for tile in tiles)])
    there = {tuple(voxel): k for k, voxel in enumerate(voxels.tolist())}
    table = voxel_table(tiles)
    near = [tuple(np.add(voxel, rng.integers(-1, 2, 3)).tolist()) for voxel in there]
    far = rng.integers(-3 * TILE_VOXELS, 3 * TILE_VOXELS, (50, 3)).tolist()
    means = np.concatenate([np.empty((0, 3)), *(tile.mean_points(0.06) for tile in tiles)])
    for x, y, z in [*there, *near, *map(tuple, far)]:
        patch = find_patch(x, y, z, table)
        number = find_in_patch(x, y, patch, table) if patch >= 0 else -1
        assert number == there.get((x, y, z), -1)
        if number >= 0:
            np.testing.assert_allclose(plane_of_voxel(number, x, y, z, 0.06, table)[3:], means[number])


@given(SEEDS, st.sampled_from([0, 2**29]))
def test_tables_that_were_given_out_stay_as_they_are_while_more_tiles_come(seed, most_bytes):
    rng = np.random.default_rng(seed)
    tiles = {tile.key: tile for tile in tiles_of(rng, 200, 1.0)}
    load, table, given_out = (lambda keys: [tiles[key] for key in keys]), TileTable(), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("maxcon.map.voxel_table.MOST_BYTES", most_bytes)
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


@given(st.integers(0, 2**64 - 1))
def test_bits_are_counted(word):
    assert n_bits(np.uint64(word)) == word.bit_count()


@given(SEEDS, st.sampled_from([1, 500]), st.sampled_from([0.3, 30.0]))
def test_no_voxel_within_the_reaches_of_a_place_is_overlooked(seed, n, spread):
    rng = np.random.default_rng(seed)
    tiles = tiles_of(rng, n, spread)
    table, voxels = voxel_table(tiles), np.concatenate([tile.voxels for tile in tiles])
    for _ in range(50):
        reaches = rng.uniform(0.0, 6.0, 3)
        place = voxels[rng.integers(len(voxels))] + 0.5 + rng.uniform(-12.0, 12.0, 3)
        low, high = np.floor(place - reaches), np.floor(place + reaches)
        if ((voxels >= low) & (voxels <= high)).all(axis=1).any():
            assert is_near_voxels(tuple(place.tolist()), tuple(reaches.tolist()), table)
    far = voxels.max(axis=0) + 3.0 * TILE_VOXELS
    assert not is_near_voxels(tuple(far.tolist()), (5.0, 5.0, 5.0), table)
