# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One point per cube: means by hand, normals that agree or not, and what is too far apart."""

import numpy as np
import pytest

from maxcon.errors import ArrayError
from maxcon.lab.baselines.map_targets import merge_planes, thin


def test_means_of_cubes_in_the_order_z_y_x():
    points = np.array([[0.9, 0.1, 0.0], [-0.1, 0.1, 0.0], [0.1, 0.3, 0.0], [0.1, 0.1, 1.5], [0.3, 0.1, 0.2]])
    np.testing.assert_allclose(
        thin(points, 1.0), [[-0.1, 0.1, 0.0], [(0.9 + 0.1 + 0.3) / 3, 0.5 / 3, 0.2 / 3], [0.1, 0.1, 1.5]]
    )


def test_no_edge_keeps_all_points_as_they_are():
    points = np.array([[0.9, 0.1, 0.0], [0.9, 0.1, 0.0]])
    assert thin(points, 0.0) is points


def test_nothing_stays_nothing():
    assert thin(np.empty((0, 3)), 0.5).shape == (0, 3)
    points, normals = merge_planes(np.empty((0, 3)), np.empty((0, 3)), 0.5, is_signed=False)
    assert points.shape == normals.shape == (0, 3)


@pytest.mark.parametrize("shift", [0.0, -7.0, 1e6])
def test_every_point_lies_in_the_cube_of_its_mean(shift):
    points = np.random.default_rng(0).uniform(-5.0, 5.0, (2000, 3)) + shift
    means = thin(points, 0.7)
    cubes = np.unique(np.floor(points / 0.7).astype(int), axis=0)
    assert len(means) == len(cubes)
    assert (np.unique(np.floor(means / 0.7).astype(int), axis=0) == cubes).all()


def test_points_too_far_apart_are_refused():
    far = np.array([[0.0, 0.0, 0.0], [0.0, 3e6, 0.0]])
    with pytest.raises(ArrayError, match=r"within 1\.05e\+06 m of each other, got 3e\+06 m"):
        thin(far, 0.5)
    assert len(thin(far, 2.0)) == 2


def test_normals_that_agree_are_averaged_and_those_of_an_edge_are_dropped():
    points = np.array([[0.1, 0, 0], [0.3, 0, 0], [1.1, 0, 0], [1.2, 0, 0], [2.1, 0, 0], [2.2, 0, 0.0]])
    tilted = [np.sin(0.2), np.cos(0.2), 0.0]
    normals = np.array([[0, 1, 0], tilted, [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.0]])
    merged, found = merge_planes(points, normals, 1.0, is_signed=True)
    np.testing.assert_allclose(merged[:, 0], [0.2, 1.15, 2.15])
    np.testing.assert_allclose(found, [[np.sin(0.1), np.cos(0.1), 0.0], [0, 0, 0], [0, 0, 0]], atol=1e-15)


def test_sides_matter_only_in_a_signed_map():
    points, normals = np.array([[0.1, 0, 0], [0.2, 0, 0]]), np.array([[0, 1, 0], [0, -1, 0.0]])
    assert not merge_planes(points, normals, 1.0, is_signed=True)[1].any()
    assert merge_planes(points, normals, 1.0, is_signed=False)[1].tolist() == [[0.0, 1.0, 0.0]]
