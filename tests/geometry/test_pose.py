# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pose and its rotation."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from maxcon import Pose
from maxcon.errors import ArrayError
from maxcon.geometry import rotation_matrices, wrap_angle

ANGLE = st.floats(-math.pi, math.pi)


@given(st.floats(-1e6, 1e6))
@example(math.pi)
@example(-math.pi)
@example(3 * math.pi)
@example(math.nextafter(-math.pi, -4.0))
def test_wrapped_angles_lie_in_the_half_open_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-8)
    assert wrap_angle(math.pi - 1e-9) == pytest.approx(math.pi - 1e-9, abs=1e-12)


@given(ANGLE, ANGLE, ANGLE)
def test_the_rotation_is_rz_ry_rx(roll, pitch, heading):
    wanted = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    rotation = rotation_matrices(roll, pitch, heading)
    np.testing.assert_allclose(rotation, wanted, atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(Pose(0, 0, 0, roll, pitch, heading).rotation, wanted, atol=1e-13)


def test_each_angle_turns_as_its_axis_says():
    quarter = math.pi / 2
    x, y, z = np.eye(3)
    np.testing.assert_allclose(rotation_matrices(0, 0, quarter) @ x, y, atol=1e-15)  # counter-clockwise
    np.testing.assert_allclose(rotation_matrices(0, quarter, 0) @ x, -z, atol=1e-15)
    np.testing.assert_allclose(rotation_matrices(quarter, 0, 0) @ y, z, atol=1e-15)


def test_many_rotations_at_once_broadcast():
    headings = np.linspace(-3.0, 3.0, 5)
    many = rotation_matrices(0.1, np.zeros((2, 1)), headings)
    assert many.shape == (2, 5, 3, 3)
    np.testing.assert_array_equal(many[1, 3], rotation_matrices(0.1, 0.0, headings[3]))


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-100, 100), ANGLE, ANGLE, ANGLE)
def test_apply_maps_the_sensor_frame_to_the_map(x, y, z, roll, pitch, heading):
    pose = Pose(x, y, z, roll, pitch, heading)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]])
    applied = pose.apply(points)
    np.testing.assert_allclose(applied[0], [x, y, z])
    np.testing.assert_allclose((applied - pose.position) @ pose.rotation, points, atol=1e-10)


def test_a_pose_keeps_its_heading_wrapped_and_its_numbers_plain():
    pose = Pose(np.float32(1.5), np.int64(2), 3, 0.0, 0.0, 7.0)
    assert pose.heading == pytest.approx(7.0 - 2 * math.pi)
    assert all(type(value) is float for value in (pose.x, pose.y, pose.z, pose.heading))
    assert pose.translated([1.0, -1.0, 0.5]) == Pose(2.5, 1.0, 3.5, 0.0, 0.0, 7.0)
    with pytest.raises(AttributeError):
        pose.x = 2.0


@pytest.mark.parametrize(("name", "value"), [("x", math.nan), ("z", math.inf), ("heading", -math.inf)])
def test_numbers_that_are_not_finite_are_refused_by_name(name, value):
    with pytest.raises(ArrayError, match=f"finite number for `{name}` of a Pose, got {value}"):
        Pose(**{**dict.fromkeys(("x", "y", "z", "roll", "pitch", "heading"), 0.0), name: value})


@given(st.lists(ANGLE, min_size=6, max_size=6), st.floats(-1e3, 1e3))
def test_poses_are_put_together_as_matrices_are(angles, x):
    first = Pose(x, -2.0, 3.0, angles[0], 0.49 * angles[1], angles[2])
    second = Pose(1.0, x, -1.0, angles[3], 0.49 * angles[4], angles[5])
    both = first @ second
    np.testing.assert_allclose(both.rotation, first.rotation @ second.rotation, atol=1e-9)
    np.testing.assert_allclose(both.position, first.apply(second.position[None])[0], atol=1e-9)
    np.testing.assert_allclose((first @ first.inverse).rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose((first.inverse @ first).position, 0.0, atol=1e-9)
