# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single voxels are found as in a dictionary of them, and none is overlooked near a place; tiles around places as by
the rectangles around them.
"""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon.map import TILE_VOXELS, PointMap
from maxcon.map.lookup_kernels import find_in_patch, find_patch, is_near_voxels
from maxcon.map.tile import VoxelLookup


def map_of(rng, n, spread):
    points = rng.normal(0.0, spread, (n, 3)) * [1.0, 1.0, 0.2]
    return PointMap.from_points(points, np.zeros((n, 3)), 0.06)


@given(st.integers(0, 2**32), st.sampled_from([0, 1, 500]), st.sampled_from([0.3, 30.0]))
@settings(max_examples=30)
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
@settings(max_examples=30)
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


@given(st.integers(0, 2**32), st.integers(0, 40), st.floats(0.0, 15.0))
@settings(max_examples=40)
def test_tiles_around_places_are_those_that_squares_meet(seed, n, margin):
    rng = np.random.default_rng(seed)
    point_map = map_of(rng, 300, 60.0)
    places = rng.normal(0.0, 100.0, (n, 2))
    got = [tile.key for tile in point_map.tiles_around(places, margin)]
    assert got == [tile.key for tile in point_map.tiles_met(places - margin, places + margin)]
    assert PointMap.from_points(np.empty((0, 3)), np.empty((0, 3))).tiles_around(places, margin) == []
