# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Voxels that face along an axis are copied, in their order, and those of a wall across it are not."""

import math

import numpy as np
import pytest

from maxcon import PointMap
from maxcon.search.facing import LEAST_FACING, N_AXES, Axis, Facing


def tile(n_points=5000, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n_points, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[::7] = 0.0
    point_map = PointMap.from_points(rng.uniform(0.0, 1.0, (n_points, 3)) * [20.0, 20.0, 2.0], normals, 0.1)
    return point_map.tile((0, 0))


@pytest.mark.parametrize("is_once", [True, False])
@pytest.mark.parametrize("axis", [Axis(0), Axis(17), Axis(63), Axis.none()])
def test_the_voxels_are_those_that_add_something(axis, is_once):
    whole = tile()
    azimuth = axis.number * math.pi / N_AXES
    along = whole.normals[:, 0] * math.cos(azimuth) + whole.normals[:, 1] * math.sin(azimuth)
    adds = (np.ones(len(whole)) if axis.is_none else along**2) * (1 if is_once else whole.counts)
    faces = adds > LEAST_FACING
    facing = Facing.of(whole, axis, is_once=is_once)
    n = facing.patch_starts[-1]
    assert n == faces.sum()
    assert (facing.columns[:n] == whole.columns[faces]).all()
    np.testing.assert_allclose(facing.normal_steps[:n] / 32767, whole.normals[faces], atol=0.51 / 32767)
    np.testing.assert_allclose(facing.values[:n], adds[faces], rtol=1e-5, atol=1e-7)
    before = np.concatenate([[0], np.cumsum(faces)])
    assert (facing.patch_starts == before[whole.index.patch_starts]).all()


def test_they_are_made_once():
    whole = tile()
    made = Facing.of(whole, Axis(3), is_once=True)
    assert Facing.of(whole, Axis(3), is_once=True) is made
    assert Facing.of(whole, Axis(3), is_once=False) is not made
    assert Facing.of(whole, Axis(4), is_once=True) is not made


def test_the_nearest_axis_and_the_one_across():
    step = math.pi / N_AXES
    assert Axis.near(0.4 * step) == Axis.near(math.pi) == Axis.near(-math.pi) == Axis(0)
    assert Axis.near(-0.6 * step) == Axis(63)
    for azimuth in np.linspace(-7.0, 7.0, 100):
        axis = Axis.near(azimuth)
        off = (azimuth - axis.number * step + math.pi / 2) % math.pi - math.pi / 2
        assert abs(off) <= step / 2 + 1e-12
        assert np.dot(axis.vector, axis.across.vector) == pytest.approx(0.0, abs=1e-6)
        assert np.linalg.norm(axis.vector) == pytest.approx(1.0, abs=1e-6)
    assert Axis.none().vector == (0.0, 0.0)
