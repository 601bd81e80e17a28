# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses of receivers and others in the coordinates of a map: headings, covariances, heights, and what is refused."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxcon.drive.prior_heights import check_heights
from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import angles_from_quaternions, quaternions_from_angles
from maxcon.io.fixes import Fixes, Orientations, poses_of_fixes
from maxcon.io.geographic import GeographicFrame
from maxcon.io.recordings.poses import read_recorded_poses
from maxcon.io.recordings.writing import RecordingKind
from maxcon.lab.simulation.datasets.recorded_drive import record_drive
from maxcon.map import PointMap
from maxcon.scan.trajectory import Trajectory

pytest.importorskip("rosbags")

UTM = "EPSG:25832"
FRAME = GeographicFrame(UTM)


class NoScans:
    """A drive without scans."""

    times = np.empty(0)


def _way(n=40, turn=0.0):
    """Poses 1 m apart that bend by `turn` (rad) each."""
    headings = 0.8 + turn * np.arange(n)
    steps = np.column_stack([np.cos(headings), np.sin(headings)])
    places = np.array([550_123.0, 5_802_417.0]) + np.concatenate([[[0.0, 0.0]], np.cumsum(steps[:-1], axis=0)])
    times = 100.0 + 0.1 * np.arange(n)
    return Trajectory.from_poses(
        times, [Pose(x, y, 61.0, 0.01, -0.02, h) for (x, y), h in zip(places.tolist(), headings, strict=True)]
    )


def _fixes(way, sigma=math.nan):
    covariances = (
        np.tile(np.diag([sigma**2, (2 * sigma) ** 2]), (len(way), 1, 1))
        if sigma == sigma
        else np.full((len(way), 2, 2), math.nan)
    )
    return Fixes(way.times, FRAME.to_geographic(way.positions), covariances, 0)


def _imu(way, off=0.0, sigma=math.nan):
    """Orientations towards true north, wrong by `off` (rad), at other times than the fixes."""
    turned = FRAME.quaternions_to_enu(FRAME.to_geographic(way.positions), way.quaternions_xyzw)
    wrong = (Rotation.from_rotvec([0.0, 0.0, off]) * Rotation.from_quat(turned)).as_quat()
    times = np.append(way.times - 0.03, way.times[-1] + 0.07)
    turns = wrong[[*range(len(way)), len(way) - 1]]
    return Orientations("/imu", Trajectory(times, np.zeros((len(times), 3)), turns), np.full(len(times), sigma))


def test_geographic_coordinates_and_back():
    rng = np.random.default_rng(0)
    positions = rng.uniform([300_000, 5_300_000, -50], [700_000, 6_000_000, 3000], (50, 3))
    places = FRAME.to_geographic(positions)
    assert (places[:, 0] > 47).all() and (places[:, 0] < 55).all() and (places[:, 1] < 13).all()
    np.testing.assert_allclose(FRAME.to_map(places), positions, atol=1e-6)
    np.testing.assert_allclose(FRAME.to_map(places, geoid_height=46.5)[:, 2], positions[:, 2] - 46.5, atol=1e-9)


def test_north_is_turned_as_the_projection_says():
    import pyproj

    places = np.array([[52.0, 12.0, 0.0], [52.0, 9.0, 0.0], [48.0, 6.5, 0.0]])
    factors = pyproj.Proj(UTM).get_factors(places[:, 1], places[:, 0])
    np.testing.assert_allclose(FRAME.convergence(places), np.radians(factors.meridian_convergence), atol=1e-6)


def test_orientations_of_an_imu_are_those_of_the_way():
    way = _way(turn=0.02)
    poses, words = poses_of_fixes(_fixes(way, 0.4), _imu(way, sigma=0.01), FRAME, None, "fix")
    np.testing.assert_allclose(poses.positions, way.positions, atol=1e-6)
    difference = angles_from_quaternions(poses.quaternions_xyzw) - way.angles
    assert np.abs(difference).max() < 0.02  # 30 ms of turning, and the last one held
    assert np.median(np.abs(difference[:, 2])) == pytest.approx(0.006, abs=0.001)
    np.testing.assert_allclose(poses.covariances[3], np.diag([0.16, 0.64, 1e-4]), atol=1e-12)
    assert words == "orientations of /imu"


def test_an_imu_that_states_no_sigma_gets_one_and_a_receiver_that_states_none_does_not():
    way = _way()
    poses, words = poses_of_fixes(_fixes(way, 0.4), _imu(way), FRAME, None, "fix")
    assert math.sqrt(poses.covariances[0, 2, 2]) == pytest.approx(math.radians(2.0))
    assert "2 degrees assumed" in words
    assert poses_of_fixes(_fixes(way), _imu(way), FRAME, None, "fix")[0].covariances is None


def test_an_imu_that_does_not_know_north_gives_roll_and_pitch():
    way = _way(turn=0.01)
    poses, words = poses_of_fixes(_fixes(way, 0.2), _imu(way, off=1.5), FRAME, None, "fix")
    angles = angles_from_quaternions(poses.quaternions_xyzw)
    assert np.abs(angles - way.angles)[8:-8].max() < 0.01
    assert "86 degrees off" in words and "roll and pitch of the latter" in words
    assert math.sqrt(poses.covariances[0, 2, 2]) == pytest.approx(math.sqrt(2.0) * 0.4 / 5.0)


def test_without_orientations_the_course_over_ground_is_the_heading():
    way = _way(turn=0.01)
    poses, words = poses_of_fixes(_fixes(way), None, FRAME, None, "fix")
    angles = angles_from_quaternions(poses.quaternions_xyzw)
    assert np.abs(angles[8:-8, 2] - way.angles[8:-8, 2]).max() < 0.01
    assert np.abs(angles[:, 2] - way.angles[:, 2]).max() < 0.08  # at both ends it is held
    assert not angles[:, :2].any() and "course over ground; roll and pitch 0" in words


def test_a_vehicle_that_stands_keeps_its_heading_whatever_its_receiver_does():
    way = _way(30)
    rng = np.random.default_rng(2)
    standing = np.tile(way.positions[-1], (300, 1)) + rng.normal(0.0, 0.4, (300, 3))
    positions = np.concatenate([way.positions, standing])
    times = 100.0 + 0.1 * np.arange(len(positions))
    fixes = Fixes(times, FRAME.to_geographic(positions), np.full((len(times), 2, 2), np.nan), 0)
    poses, _ = poses_of_fixes(fixes, None, FRAME, None, "fix")
    assert np.abs(angles_from_quaternions(poses.quaternions_xyzw)[:, 2] - 0.8).max() < 0.1


def test_neither_orientations_nor_a_way():
    way = _way(3)
    with pytest.raises(TrajectoryError, match="got neither"):
        poses_of_fixes(_fixes(way), None, FRAME, None, "fix")


def test_positions_that_the_projection_does_not_reach():
    fixes = Fixes(np.arange(2.0), np.array([[0.0, -81.0, 0.0], [90.0, 99.0, 0.0]]), np.full((2, 2, 2), np.nan), 0)
    with pytest.raises(TrajectoryError):
        poses_of_fixes(fixes, None, FRAME, None, "fix")


def test_heights_above_a_geoid_that_is_not_there_are_not_made_up():
    """Heights of DHHN2016 need a grid, which is not installed with pyproj."""
    frame = GeographicFrame("EPSG:25832+7837")
    places = FRAME.to_geographic(_way(2).positions)
    assert frame.has_heights
    try:
        heights = frame.to_map(places)[:, 2]
    except CrsError as error:
        assert "--geoid-height" in str(error) and "\n" not in str(error)
    else:  # the grid is there after all
        assert (np.abs(heights - places[:, 2]) > 30.0).all()
    np.testing.assert_allclose(frame.to_map(places, geoid_height=45.0)[:, 2], 61.0 - 45.0, atol=1e-9)


def _map_with_ground(height):
    x, y = np.meshgrid(np.arange(-20, 20, 0.5), np.arange(-20, 20, 0.5))
    ground = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    wall = np.column_stack([np.full(500, 10.0), np.linspace(-15, 15, 500), np.linspace(height, height + 4, 500)])
    normals = np.tile([-1.0, 0.0, 0.0], (500, 1))
    return PointMap.from_points(wall, normals, cell=0.06, ground=ground)


def test_heights_far_from_the_map_s_ground_are_refused_with_what_the_geoid_may_be():
    prior = Trajectory.from_poses([0.0, 1.0], [Pose(0, 0, 48.0, 0, 0, 0), Pose(1, 0, 48.2, 0, 0, 0)])
    with pytest.raises(TrajectoryError, match=r"46\.1 m above it.*--geoid-height, about 44 here"):
        check_heights(_map_with_ground(2.0), prior)
    check_heights(_map_with_ground(46.2), prior)
    far = Trajectory.from_poses([0.0], [Pose(9e5, 0, 48.0, 0, 0, 0)])
    check_heights(_map_with_ground(2.0), far)  # outside the map: said elsewhere


@pytest.fixture
def recorded(tmp_path):
    """A recording with positions, orientations and odometry, of a bend."""
    way = _way(turn=0.02)
    odometry = Trajectory.from_poses(way.times, [way.pose(0).inverse @ pose for pose in way.poses()])
    path = tmp_path / "drive.bag"
    scans = NoScans()
    record_drive(path, RecordingKind.ROS1, scans, way, UTM, sigma=0.3, odometry=odometry)
    return path, way, odometry


def test_positions_and_odometry_of_a_recording(recorded):
    path, way, odometry = recorded
    prior = read_recorded_poses(path, crs=UTM)
    np.testing.assert_allclose(prior.trajectory.positions, way.positions, atol=1e-6)
    np.testing.assert_allclose(prior.trajectory.angles, way.angles, atol=1e-9)
    assert prior.has_ellipsoidal_heights and "as they are" in prior.words
    assert "less 40 m" in read_recorded_poses(path, crs=UTM, geoid_height=40.0).words
    motion = read_recorded_poses(path, is_odometry=True)
    np.testing.assert_allclose(motion.trajectory.positions, odometry.positions, atol=1e-9)
    assert motion.words == "poses from /odometry (Odometry) in the frame sensor"
    assert read_recorded_poses(path, "/odometry").trajectory.covariances is None


def test_poses_that_are_not_there(recorded, real_data):
    path, _, _ = recorded
    with pytest.raises(CrsError, match="a map with a CRS"):
        read_recorded_poses(path)
    with pytest.raises(OptionError, match=r"/imu/data.*Imu.*Ask for"):
        read_recorded_poses(path, "/imu/data", UTM)
    with pytest.raises(OptionError, match="no such topic"):
        read_recorded_poses(path, "/gps", UTM)
    bags = real_data("recorders/ros1bag")
    with pytest.raises(FileError, match=r"got none.*--prior"):
        read_recorded_poses(bags / "example.bag", crs=UTM)
    truth = read_recorded_poses(bags / "embag_test.bag")
    assert len(truth.trajectory) == 5 and "/base_pose_ground_truth (Odometry)" in truth.words


def test_swapped_latitude_and_longitude_are_named():
    fixes = _fixes(_way())
    swapped = Fixes(fixes.times, fixes.places[:, [1, 0, 2]], fixes.covariances, 0)
    with pytest.raises(TrajectoryError, match=r"got latitude 9\.7.*, longitude 52\.3.*Are the two swapped"):
        poses_of_fixes(swapped, None, FRAME, None, "log.csv")


def test_bearings_for_headings_are_named():
    way = _way(turn=0.05)
    turns = FRAME.quaternions_to_enu(FRAME.to_geographic(way.positions), way.quaternions_xyzw)
    roll, pitch, heading = angles_from_quaternions(turns).T
    of_compass = quaternions_from_angles(roll, pitch, math.pi / 2 - heading)
    imu = Orientations("/imu", Trajectory(way.times, np.zeros((len(way), 3)), of_compass), np.full(len(way), math.nan))
    trajectory, words = poses_of_fixes(_fixes(way), imu, FRAME, None, "log.csv")
    assert "degrees off it (but " in words and "mixed up: bearings count clockwise from north" in words
    np.testing.assert_allclose(trajectory.angles[:, 2], way.angles[:, 2], atol=0.4)  # the course
