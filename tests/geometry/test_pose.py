"""Pose and its rotation, LocalFrame, coordinates to voxel indices and back, what are points and what covariances."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np
from scipy.spatial.transform import Rotation

from maxcon import LocalFrame, Pose
from maxcon.errors import ArrayError
from maxcon.geometry import rotation_matrices, voxel_centers, voxel_indices, wrap_angle
from maxcon.geometry.arrays import as_points, first_covariance_fault
from maxcon.geometry.pose import INDEX_LIMIT

ANGLE = st.floats(-math.pi, math.pi)
UTM = LocalFrame((458_800.0, 5_429_000.0, 100.0), "EPSG:25832")
GOOD = np.diag([1.0, 0.0, 1e-6])


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


@pytest.mark.parametrize(("points", "words"), [
    (np.zeros((3, 7)), r"`points` to have shape \(n, 3\), got \(3, 7\)\. Transpose it\?"),
    ([1.0, 2.0, 3.0], r"to have shape \(n, 3\), got \(3,\)\.$"),
    ([[0.0, 0.0, 0.0], [0.0, math.nan, 0.0]], r"got 1 of 2 rows with NaN or infinity\. Drop those rows"),
    ([["a", "b", "c"]], "to be numbers"),
])  # fmt: skip
def test_what_are_no_points_is_refused(points, words):
    with pytest.raises(ArrayError, match=words):
        as_points(points, "points")


@given(
    st_np.arrays(np.float64, (4, 3, 3), elements=st.floats(-1.0, 1.0).map(lambda value: round(value, 9))),
    st.tuples(*[st.floats(1e-4, 1e4)] * 3),
)
def test_what_is_made_of_factors_is_a_covariance(factors, scales):
    factors = factors * np.array(scales)[:, None]
    assert first_covariance_fault(factors @ factors.transpose(0, 2, 1)) is None
    assert first_covariance_fault(factors[:0]) is None


@pytest.mark.parametrize("matrix", [
    np.diag([1.0, np.nan, 0.1]),
    np.diag([1.0, 1.0, -0.1]),
    [[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 0.1]],
    [[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 0.1]],
    [[1e-300, 1e300, 0.0], [1e300, 1e-300, 0.0], [0.0, 0.0, 0.1]],
])  # fmt: skip
def test_the_first_that_is_none_is_named(matrix):
    row, words = first_covariance_fault(np.array([GOOD, matrix, matrix]))
    assert row == 1 and f"positive semidefinite, got {np.array(matrix).tolist()}" in words
