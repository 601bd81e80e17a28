# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The dense grid holds every voxel's normal, bounds its products from above, and is kept for as long as it suffices."""

import numpy as np
import pytest

from maxcon import PointMap


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
