# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What baselines keep of a map: no more than is reached, shared, bounded, and gone with the map."""

import gc
import pickle

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.geometry import LocalFrame
from maxcon.geometry.frame import voxel_centers
from maxcon.lab.baselines import Gicp, Icp, MapTargets
from maxcon.lab.baselines.map_targets import N_TARGETS, Place


@pytest.fixture(scope="module")
def plain():
    """Points strewn over 300 m x 300 m: 100 tiles."""
    points = np.random.default_rng(0).uniform(-150.0, 150.0, (20_000, 3)) * [1.0, 1.0, 0.02]
    return PointMap.from_points(points, np.tile([0.0, 0.6, 0.8], (len(points), 1)), 0.06)


class WatchedTiles:
    """The tiles of a map, and which of them were loaded."""

    def __init__(self, point_map):
        self.keys, self._of, self.loaded = point_map.tile_keys, point_map, []

    def load(self, key):
        self.loaded.append(key)
        return self._of.tile(key)


@pytest.fixture
def watched(plain):
    tiles = WatchedTiles(plain)
    return PointMap(LocalFrame(), plain.cell, True, tiles), tiles


@pytest.mark.parametrize("place", [Place(0, 0, 40.0), Place(-3, 2, 60.0)])
def test_voxels_too_far_apart_to_merge_come_as_they_are(plain, place):
    points, normals = MapTargets().planes(plain, place, 0.06)
    every = voxel_centers(plain.all_voxels()[0], plain.cell)
    wanted = every[place.reaches(every)]
    assert len(wanted) > 1000
    np.testing.assert_allclose(points[np.lexsort(points.T)], wanted[np.lexsort(wanted.T)], atol=1e-9)
    np.testing.assert_allclose(normals, np.tile([0.0, 0.6, 0.8], (len(points), 1)), atol=1e-6)


def test_a_coarser_edge_merges():
    grid = np.stack(np.meshgrid(*[np.arange(0.03, 1.0, 0.06)] * 2), axis=-1).reshape(-1, 2)
    wall = PointMap.from_points(np.insert(grid, 1, 0.03, axis=1), np.tile([0, -1.0, 0], (len(grid), 1)))
    points, normals = MapTargets().planes(wall, Place(0, 0, 20.0), 0.5)
    assert len(points) == 2 * 2  # 0 to 1.02 m, of which the last voxel's centre is at 0.99 m
    np.testing.assert_allclose(points[:, 1], 0.03)
    np.testing.assert_allclose(normals, np.tile([0, -1.0, 0], (4, 1)), atol=1e-7)


def test_no_tile_is_loaded_beyond_the_reach_and_none_twice(watched):
    point_map, tiles = watched
    targets = MapTargets()
    targets.planes(point_map, Place(0, 0, 20.0), 0.25)
    assert sorted(tiles.loaded) == [(kx, ky) for kx in (-1, 0, 1) for ky in (-1, 0, 1)]
    targets.planes(point_map, Place(1, 0, 20.0), 0.25)
    assert sorted(tiles.loaded[9:]) == []
    targets.planes(point_map, Place(0, 0, 20.0), 0.5)
    assert len(tiles.loaded) == 18


def test_a_place_outside_the_map_is_empty(plain):
    points, normals = MapTargets().planes(plain, Place(1000, 1000, 40.0), 0.25)
    assert points.shape == normals.shape == (0, 3)


class Maker:
    """Makes numbers, and counts."""

    n_made = 0

    def __call__(self):
        self.n_made += 1
        return self.n_made


def test_what_was_made_is_kept_for_each_map_and_key(plain):
    targets, make = MapTargets(), Maker()
    other = PointMap.from_points([[0, 0, 0.0]], [[0, 0, 1.0]])
    assert [targets.get(plain, key, make) for key in "abab"] == [1, 2, 1, 2]
    assert targets.get(other, "a", make) == 3
    assert targets.get(plain, "a", make) == 1


def test_what_was_used_longest_ago_goes_first(plain):
    targets, make = MapTargets(), Maker()
    for key in range(N_TARGETS):
        targets.get(plain, key, make)
    assert targets.get(plain, 0, make) == 1
    assert targets.get(plain, "new", make) == N_TARGETS + 1
    assert targets.get(plain, 0, make) == 1
    assert targets.get(plain, 1, make) == N_TARGETS + 2


def test_a_map_that_is_gone_takes_its_targets_along(street_scan, street):
    targets = MapTargets()
    point_map = PointMap.from_points([[0, 0, 0.0]], [[0, 0, 1.0]])
    Icp(targets=targets).localize(street_scan, point_map, street.sensor)
    assert len(targets._kept) == 1
    del point_map
    gc.collect()
    assert len(targets._kept) == 0


def test_a_pickled_one_is_empty_and_works(plain):
    targets, make = MapTargets(), Maker()
    targets.get(plain, "a", make)
    pickle.loads(pickle.dumps(targets)).get(plain, "a", make)
    assert make.n_made == 2


def test_methods_that_share_answer_as_if_they_did_not(same, street, street_map, street_scan):
    pytest.importorskip("small_gicp")
    targets, prior = MapTargets(), street.prior(0.4, 0.2)
    kinds = [
        lambda **shared: Icp("plane", 1.0, **shared),
        lambda **shared: Icp("point", 1.0, **shared),
        lambda **shared: Icp("plane", 3.0, **shared),
        lambda **shared: Icp("plane", target_edge=0.5, **shared),
        lambda **shared: Gicp(3.0, **shared),
        lambda **shared: Gicp(3.0, n_neighbours=20, **shared),
    ]
    for kind in kinds:
        alone = kind().localize(street_scan, street_map, prior)
        assert same(kind(targets=targets).localize(street_scan, street_map, prior), alone)
