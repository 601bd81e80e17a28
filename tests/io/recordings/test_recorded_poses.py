"""Poses of recordings in the coordinates of a map: positions, odometry, heights, and what is refused."""

import numpy as np
import pytest

from maxcon.drive.diagnosis import check_heights
from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.io.fixes import Heights
from maxcon.io.recordings.poses import read_recorded_poses
from maxcon.map import PointMap
from maxcon.scan.trajectory import Trajectory
from recorded_drives import MadeScans, bend, record_drive

pytest.importorskip("rosbags")

UTM = "EPSG:25832"


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
    way = bend(turn=0.02)
    odometry = Trajectory.from_poses(way.times, [way.pose(0).inverse @ pose for pose in way.poses()])
    path = record_drive(tmp_path / "drive.bag", MadeScans(0), way, UTM, sigma=0.3, odometry=odometry)
    return path, way, odometry


def test_positions_and_odometry_of_a_recording(recorded):
    path, way, odometry = recorded
    prior = read_recorded_poses(path, crs=UTM)
    np.testing.assert_allclose(prior.trajectory.positions, way.positions, atol=1e-6)
    np.testing.assert_allclose(prior.trajectory.angles, way.angles, atol=1e-9)
    assert prior.heights is Heights.ELLIPSOIDAL and "as they are" in prior.words
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
    with pytest.raises(FileError, match=r"Expected poses .*got /rosout .*--prior"):
        read_recorded_poses(bags / "example.bag", crs=UTM)
    truth = read_recorded_poses(bags / "embag_test.bag")
    assert len(truth.trajectory) == 5 and "/base_pose_ground_truth (Odometry)" in truth.words
