"""Trajectory: what it accepts, the pose at any time, many positions at once."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from maxcon.errors import ArrayError, OptionError, TrajectoryError
from maxcon.geometry import Pose, rotation_matrices
from maxcon.geometry.pose import angles_from_quaternions, quaternions_from_angles
from maxcon.scan.trajectory import Trajectory

UTM = np.array([458888.4217, 5429081.5413, 115.0739])
ANGLE = st.floats(-math.pi, math.pi)
STEEP = st.floats(-math.pi / 2, math.pi / 2)
IDENTITY, KNOWN = (0.0, 0.0, 0.0, 1.0), np.eye(3)
OUTSIDE = r"within the trajectory, 0\.0+ to 1\.0+ s, got .* from the nearest pose\..*clock"
UNKNOWN = np.full((3, 3), np.nan)


def drive(times, positions=None):
    """Identity orientation; by default 10 m/s along x from a UTM position."""
    times = np.asarray(times, dtype=float)
    if positions is None:
        positions = UTM + np.outer(times - times[0], [10.0, 0.0, 0.0])
    return Trajectory(times, positions, np.tile(IDENTITY, (len(times), 1)))


def assert_same_pose(got, wanted, atol=1e-9):
    np.testing.assert_allclose(got.position, wanted.position, rtol=0, atol=atol)
    np.testing.assert_allclose(got.rotation, wanted.rotation, atol=1e-12)


@given(ANGLE, STEEP, ANGLE)
def test_quaternions_mean_the_same_rotation_as_the_angles(roll, pitch, heading):
    wanted = rotation_matrices(roll, pitch, heading)
    quaternion = quaternions_from_angles(roll, pitch, heading)
    np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), wanted, atol=1e-14)
    angles = angles_from_quaternions(quaternion)
    np.testing.assert_allclose(rotation_matrices(*angles), wanted, atol=1e-7 if abs(pitch) > 1.57 else 1e-12)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("heading", [-3.0, -1.0, 0.0, 2.0])
def test_a_sensor_that_looks_straight_up_or_down_keeps_its_rotation(pitch, heading):
    angles = angles_from_quaternions(quaternions_from_angles(0.4, pitch, heading))
    assert angles[0] == 0.0
    np.testing.assert_allclose(rotation_matrices(*angles), rotation_matrices(0.4, pitch, heading), atol=1e-8)


@pytest.mark.parametrize("heading", [-math.pi, -math.pi + 1e-9, 0.0, math.pi / 2, math.pi - 1e-9])
def test_poses_come_back_at_utm_coordinates(heading):
    poses = [Pose(*UTM, 0.01, -0.02, heading), Pose(*(UTM + 1.0), -0.03, 0.04, -heading)]
    trajectory = Trajectory.from_poses([1.0, 2.0], poses)
    assert len(trajectory) == 2
    for got, wanted in zip(trajectory.poses(), poses, strict=True):
        assert_same_pose(got, wanted, atol=0)
        assert abs(math.remainder(got.heading - wanted.heading, 2 * math.pi)) < 1e-12


def test_a_trajectory_does_not_change():
    times = np.array([0.0, 1.0])
    trajectory = drive(times)
    times[0] = 5.0
    assert trajectory.times[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.positions[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        trajectory.times = times
    assert {trajectory: 1, drive([0.0, 1.0]): 2}[trajectory] == 1  # each is itself: arrays are not compared


def test_nearly_unit_quaternions_are_normalized():
    trajectory = Trajectory([0.0], [UTM], [(0.0, 0.0, 0.71, 0.71)])
    assert np.linalg.norm(trajectory.quaternions_xyzw) == pytest.approx(1.0, abs=1e-15)
    assert trajectory.pose(0).heading == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("times", "quaternion", "covariance", "words"), [
    ([0.0, 1.0, 1.0], IDENTITY, KNOWN, r"Row 2 .*increase, got 1\.0+ s after 1\.0+ s.*Sort"),
    ([0.0, math.nan, 2.0], IDENTITY, KNOWN, "Row 1 .*finite"),
    ([0.0, 1.0, 2.0], (0.0, 0.0, 0.0, 0.0), KNOWN, "Row 1 .*unit quaternion.*length 0"),
    ([0.0, 1.0, 2.0], (0.0, 0.0, 0.0, 2.0), KNOWN, "Row 1 .*unit quaternion.*length 2.*order of the columns"),
    ([0.0, 1.0, 2.0], (0.0, 0.0, 0.0, math.nan), KNOWN, "Row 1 .*finite"),
    ([0.0, 1.0, 2.0], (0.0, 1e300, 1e300, 1.0), KNOWN, "Row 1 .*unit quaternion"),
    ([0.0, 1.0, 2.0], IDENTITY, np.diag([1.0, np.nan, 1.0]), "Row 1 .*finite, symmetric"),
    ([0.0, 1.0, 2.0], IDENTITY, np.ones((3, 3)) - np.diag([0.0, 0.0, 0.5]), "Row 1 .*positive semidefinite"),
])  # fmt: skip
def test_rows_that_cannot_be_used_are_named(times, quaternion, covariance, words):
    with pytest.raises(TrajectoryError, match=words):
        Trajectory(times, np.zeros((3, 3)), [IDENTITY, quaternion, IDENTITY], [KNOWN, covariance, KNOWN])


@pytest.mark.parametrize(("arguments", "words"), [
    (([[0.0]], [[0.0] * 3], [IDENTITY]), r"`times` to have shape \(n,\), got \(1, 1\)"),
    (([0.0, 1.0], [[0.0] * 3], [IDENTITY] * 2), r"`positions` to have shape \(2, 3\), got \(1, 3\)"),
    (([0.0], [[0.0] * 3], [[0.0] * 3]), r"`quaternions_xyzw` to have shape \(1, 4\)"),
    ((["a"], [[0.0] * 3], [IDENTITY]), "`times` to be numbers"),
    (([0.0], [[0.0] * 3], [IDENTITY], [np.eye(6)]), r"`covariances` to have shape \(1, 3, 3\), got \(1, 6, 6\)"),
])  # fmt: skip
def test_wrong_shapes_are_refused(arguments, words):
    with pytest.raises(ArrayError, match=words):
        Trajectory(*arguments)
    with pytest.raises(TrajectoryError, match="at least one pose"):
        Trajectory.from_poses([], [])


@pytest.mark.parametrize(("time", "max_gap", "error", "words"), [
    *((time, 10.0, TrajectoryError, OUTSIDE) for time in (-0.01, 1.01, 1.7e9)),
    (math.nan, 0.5, TrajectoryError, "finite time"),
    (0.5, -1.0, OptionError, "max_gap >= 0"),
    (0.5, math.nan, OptionError, "max_gap >= 0"),
])  # fmt: skip
def test_times_that_are_refused(time, max_gap, error, words):
    with pytest.raises(error, match=words):
        drive([0.0, 1.0]).at(time, max_gap=max_gap)
    if error is OptionError:
        with pytest.raises(error, match=words):
            drive([0.0, 1.0]).positions_at([time], max_gap=max_gap)


def test_at_a_pose_it_is_that_pose_whatever_the_gaps():
    trajectory = Trajectory.from_poses([0.0, 100.0], [Pose(*UTM, 0, 0, 1.0), Pose(*(UTM + 5), 0, 0, 2.0)])
    for time, i in ((0.0, 0), (-0.001, 0), (-0.0009, 0), (0.0009, 0), (99.9995, 1), (100.0, 1), (100.0009, 1)):
        assert_same_pose(trajectory.at(time), trajectory.pose(i), atol=0)


def test_a_gap_longer_than_allowed_is_refused_and_can_be_allowed():
    trajectory = drive([0.0, 1.0])
    words = r"at most 0\.5 s apart around 0\.2.*gap of 1\.0.*0\.2\d* s from the nearest.*max_gap"
    with pytest.raises(TrajectoryError, match=words):
        trajectory.at(0.2)
    assert trajectory.at(0.2, max_gap=1.0).x == pytest.approx(UTM[0] + 2.0)  # one that is just the largest
    np.testing.assert_allclose(trajectory.positions_at([0.2], max_gap=1.0)[:, 0], UTM[0] + 2.0)
    with pytest.raises(TrajectoryError, match=r"at most 0\.5 s apart"):
        known_drive([np.eye(3), np.eye(3)]).covariance_at(0.25)


def test_without_a_gap_only_poses_themselves_are_taken():
    trajectory = drive([0.0, 0.4])
    assert trajectory.at(0.4, max_gap=0.0).x == pytest.approx(UTM[0] + 4.0)
    with pytest.raises(TrajectoryError, match="at most 0 s apart"):
        trajectory.at(0.2, max_gap=0.0)
    found = trajectory.positions_at([0.0, 0.2, 0.4], max_gap=0.0)
    np.testing.assert_allclose(found[[0, 2], 0], UTM[0] + np.array([0.0, 4.0]))
    assert np.isnan(found[1]).all()


def test_close_to_a_pose_it_is_between_the_two_where_they_are_close():
    """The rounding of clocks is forgiven at ends and gaps only; elsewhere a millisecond is a centimetre."""
    trajectory = drive([1000.0, 1000.1, 1001.1])
    assert trajectory.at(1000.0005).x == pytest.approx(UTM[0] + 0.005, abs=1e-6)
    assert trajectory.at(1000.0995).x == pytest.approx(UTM[0] + 0.995, abs=1e-6)
    assert trajectory.at(1000.1005).x == pytest.approx(UTM[0] + 1.0, abs=1e-6)  # a gap begins


def test_positions_at_many_times_at_one_pose_and_at_none():
    trajectory = drive([0.0, 0.4, 2.0, 2.2])
    times = [0.0, 0.1, 0.4, 0.6, 0.7, 1.2, 1.8, 2.0, 2.1, 2.4, 2.5, -0.2, -0.3, math.nan, math.inf, -math.inf]
    along = [0.0, 1.0, 4.0, 4.0, None, None, 20.0, 20.0, 21.0, 22.0, None, 0.0, None, None, None, None]
    found = trajectory.positions_at(times)
    assert found.shape == (len(times), 3)
    wanted = [UTM + np.array([a, 0, 0]) if a is not None else [math.nan] * 3 for a in along]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8)
    trajectory = drive([5.0])
    np.testing.assert_array_equal(trajectory.positions_at([5.0, 5.2, 5.3])[:, 0], [UTM[0], UTM[0], math.nan])
    assert trajectory.positions_at([]).shape == (0, 3) and trajectory.at(5.0).x == UTM[0]
    with pytest.raises(ArrayError, match=r"`times` to have shape \(n,\)"):
        trajectory.positions_at([[5.0]])


def test_positions_at_agrees_with_at():
    rng = np.random.default_rng(3)
    trajectory = drive(np.cumsum(rng.uniform(0.05, 0.45, 50)), rng.normal(size=(50, 3)) + UTM)
    times = rng.uniform(trajectory.times[0], trajectory.times[-1], 200)
    times = times[np.abs(times[:, None] - trajectory.times).min(axis=1) > 1e-3]  # nearer `at` gives the pose itself
    wanted = [trajectory.at(t).position for t in times]
    np.testing.assert_allclose(trajectory.positions_at(times), wanted, rtol=0, atol=1e-8)


def known_drive(covariances):
    times = np.arange(len(covariances), dtype=float)
    return Trajectory(times, np.outer(times, [1.0, 0.0, 0.0]), np.tile(IDENTITY, (len(times), 1)), covariances)


def test_covariances_are_linear_between_poses_and_may_be_unknown():
    first, second = np.diag([1.0, 4.0, 0.01]), np.diag([3.0, 0.0, 0.03])
    assert drive([0.0, 0.1]).covariance_at(0.05) is None  # without covariances none is known
    trajectory = known_drive([first, second, UNKNOWN, first])
    np.testing.assert_allclose(trajectory.covariance_at(0.25, 2.0), 0.75 * first + 0.25 * second)
    np.testing.assert_array_equal(trajectory.covariance_at(1.0, 2.0), second)  # beside one that is unknown
    assert trajectory.covariance_at(1.5, 2.0) is None and trajectory.covariance_at(2.0, 2.0) is None
    np.testing.assert_array_equal(trajectory.covariance_at(3.0005), first)
    np.testing.assert_array_equal(trajectory.covariance_at(3.0, 2.0), first)  # just after one that is unknown
    with pytest.raises(TrajectoryError, match="within the trajectory"):
        trajectory.covariance_at(4.0)
    with pytest.raises(ValueError, match="read-only"):
        trajectory.covariances[0, 0, 0] = 1.0


@given(st.lists(st.floats(-2.0, 2.0), min_size=36, max_size=36), st.floats(0.0, 1.0))
def test_a_covariance_between_poses_is_never_too_small(factors, part):
    """However the errors of two poses are correlated: what it is larger by than that of their mean is semidefinite."""
    factors = np.reshape(factors, (6, 6))
    joint = factors @ factors.T
    weights = np.hstack([(1.0 - part) * np.eye(3), part * np.eye(3)])
    trajectory = known_drive([joint[:3, :3], joint[3:, 3:]])
    surplus = trajectory.covariance_at(part, 1.0) - weights @ joint @ weights.T
    assert np.linalg.eigvalsh(surplus).min() > -1e-9 * max(1.0, np.abs(joint).max())


@given(ANGLE, STEEP, ANGLE, ANGLE, STEEP, ANGLE, st.floats(0.01, 0.99))
def test_orientation_between_poses_turns_evenly(r1, p1, h1, r2, p2, h2, part):
    trajectory = Trajectory.from_poses([0.0, 1.0], [Pose(0, 0, 0, r1, p1, h1), Pose(0, 0, 0, r2, p2, h2)])
    first, last = Rotation.from_quat(trajectory.quaternions_xyzw)
    turn = (first.inv() * last).as_rotvec()
    assume(np.linalg.norm(turn) < math.pi - 1e-3)  # opposite orientations: both ways round are as short
    wanted = (first * Rotation.from_rotvec(part * turn)).as_matrix()
    np.testing.assert_allclose(trajectory.at(part, max_gap=1.0).rotation, wanted, atol=1e-6)
