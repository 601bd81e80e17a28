# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LocalFrame, and coordinates to voxel indices and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import LocalFrame, Pose
from maxcon.errors import ArrayError
from maxcon.geometry import voxel_centers, voxel_indices
from maxcon.geometry.pose import INDEX_LIMIT

UTM = LocalFrame((458_800.0, 5_429_000.0, 100.0), "EPSG:25832")


@given(st.integers(0, 2**32))
def test_utm_coordinates_come_back(seed):
    points = np.array(UTM.origin) + np.random.default_rng(seed).uniform(-5000, 5000, (50, 3))
    local = UTM.to_local(points)
    assert np.abs(local).max() <= 5000.001
    np.testing.assert_allclose(UTM.to_global(local), points, rtol=0, atol=1e-8)
    pose = Pose(*points[0], 0.1, -0.2, 3.0)
    back = UTM.pose_to_global(UTM.pose_to_local(pose))
    np.testing.assert_allclose(back.position, pose.position, rtol=0, atol=1e-8)
    assert (back.roll, back.pitch, back.heading) == (pose.roll, pose.pitch, pose.heading)


@pytest.mark.parametrize("origin", [(0.0, 0.0), (0.0, 0.0, math.nan), (1.0, 2.0, math.inf), (1, 2, 3, 4)])
def test_an_origin_is_three_finite_numbers(origin):
    with pytest.raises(ArrayError, match="Expected three finite numbers as the origin of a LocalFrame, got"):
        LocalFrame(origin)


def test_indices_are_floors_also_below_zero():
    points = np.array([[0.0, -0.0, 0.0599], [-1e-9, 0.06, -0.06], [-0.0601, 0.1199, 12.3]])
    np.testing.assert_array_equal(voxel_indices(points, 0.06), [[0, 0, 0], [-1, 1, -1], [-2, 1, 205]])
    assert voxel_indices(points, 0.06).dtype == np.int32
    assert voxel_indices(np.empty((0, 3)), 0.06).shape == (0, 3)


@given(st.floats(0.01, 2.0), st.integers(0, 2**32))
def test_the_centre_of_a_voxel_lies_in_it_and_near_its_points(cell, seed):
    points = np.random.default_rng(seed).uniform(-1000, 1000, (100, 3))
    indices = voxel_indices(points, cell)
    centers = voxel_centers(indices, cell)
    np.testing.assert_array_equal(voxel_indices(centers, cell), indices)
    assert np.abs(centers - points).max() <= 0.5 * cell * (1 + 1e-6)


@given(st.integers(-1000, 1000), st.integers(-(2**20), 2**20))
def test_a_shift_by_a_cell_is_a_shift_by_a_voxel(at, cells):
    cell = 0.0625
    points = np.array([[at / 256, at / 1024, 0.3]])
    shifted = points + [[cells * cell, 0.0, 0.0]]
    np.testing.assert_array_equal(voxel_indices(shifted, cell) - voxel_indices(points, cell), [[cells, 0, 0]])


@pytest.mark.parametrize(("sign", "axis"), [(-1, 0), (1, 1), (-1, 2)])
def test_indices_end_where_int32_would_not_hold_a_window(sign, axis):
    points = np.zeros((2, 3))
    points[1, axis] = sign * (INDEX_LIMIT - 1) * 0.5
    assert abs(int(voxel_indices(points, 0.5)[1, axis])) == INDEX_LIMIT - 1
    points[1, axis] = sign * INDEX_LIMIT * 0.5
    with pytest.raises(ArrayError, match=r"within 5\.37e\+08 m of the local origin, got 5\.37e\+08 m\. Express them"):
        voxel_indices(points, 0.5)
    with np.errstate(over="ignore"), pytest.raises(ArrayError, match="of the local origin"):
        voxel_indices(np.array([[1e308, 0.0, 0.0]]), 0.06)
