"""Mounting: poses of the scanner from those of an antenna, an IMU or an odometer on the same vehicle."""

import math

import numpy as np
import pytest

from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.scan.mounting import Mounting, read_mounting, sensor_trajectory
from maxcon.scan.trajectory import Trajectory

T_VEHICLE_SENSOR = Pose(1.1, 0.2, 1.9, 0.02, -0.05, 1.5)
T_VEHICLE_PRIOR = Pose(-0.4, 0.3, 1.6, 0.01, 0.02, -0.7)
TEXT = """
[sensor]
position = [1.1, 0.2, 1.9]
roll_deg = 1.0
pitch_deg = -2
heading_deg = 90.0
[prior]
position = [-0.4, 0.3, 1.6]
"""


def _drive(n=30):
    """T_map_vehicle that turns, climbs and rolls."""
    rng = np.random.default_rng(4)
    values = np.column_stack([rng.uniform(-100, 100, (n, 3)), rng.uniform(-0.2, 0.2, (n, 2)), rng.uniform(-3, 3, n)])
    return [Pose(*row) for row in values.tolist()]


def _same(one, other):
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-9)
    dots = np.abs((one.quaternions_xyzw * other.quaternions_xyzw).sum(axis=1))
    np.testing.assert_allclose(dots, 1.0, atol=1e-12)


def test_poses_of_the_scanner_from_those_of_the_antenna_or_its_course_over_ground():
    vehicle = _drive()
    times = np.arange(len(vehicle))
    prior = Trajectory.from_poses(times, [pose @ T_VEHICLE_PRIOR for pose in vehicle])
    sensor = Trajectory.from_poses(times, [pose @ T_VEHICLE_SENSOR for pose in vehicle])
    mounting = Mounting(T_VEHICLE_SENSOR, T_VEHICLE_PRIOR, T_VEHICLE_PRIOR)
    _same(mounting.of_prior(prior), sensor)
    _same(mounting.of_odometry(prior), sensor)
    _same(Mounting(T_VEHICLE_SENSOR, T_VEHICLE_PRIOR).of_odometry(sensor), sensor)
    prior = Trajectory.from_poses(times, [pose @ Pose(*T_VEHICLE_PRIOR.position.tolist(), 0, 0, 0) for pose in vehicle])
    _same(Mounting(T_VEHICLE_SENSOR, T_VEHICLE_PRIOR).of_prior(prior, has_orientations=False), sensor)


def test_covariances_follow_the_lever_arm():
    """Against drawn errors."""
    rng = np.random.default_rng(5)
    covariance = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.001], [0.002, -0.001, math.radians(1.0) ** 2]])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 10_000)
    pose, T_part_sensor = Pose(1.0, 2.0, 3.0, 0.05, -0.1, 0.8), Pose(4.0, -2.0, 1.0, 0.0, 0.0, 0.3)
    one = sensor_trajectory(Trajectory.from_poses([0.0], [pose], covariance[None]), T_part_sensor)
    drawn = [Pose(pose.x + x, pose.y + y, pose.z, pose.roll, pose.pitch, pose.heading + h) for x, y, h in errors]
    sensors = sensor_trajectory(Trajectory.from_poses(np.arange(len(drawn)), drawn), T_part_sensor)
    seen = np.cov(np.column_stack([sensors.positions[:, :2], sensors.angles[:, 2]]).T)
    np.testing.assert_allclose(one.covariances[0], seen, rtol=0.08, atol=6e-4)
    unknown = Trajectory.from_poses([0.0], [pose], np.full((1, 3, 3), np.nan))
    assert np.isnan(sensor_trajectory(unknown, T_part_sensor).covariances).all()


def test_a_file_of_one_scanner_of_several_and_none(tmp_path):
    path = tmp_path / "mounting.toml"
    path.write_text(TEXT)
    mounting = read_mounting(path)
    np.testing.assert_allclose(mounting.T_vehicle_sensor.values, [1.1, 0.2, 1.9, *np.radians([1.0, -2.0, 90.0])])
    np.testing.assert_allclose(mounting.T_vehicle_prior.values, [-0.4, 0.3, 1.6, 0, 0, 0])
    assert mounting.T_vehicle_odometry is None
    path.write_text(
        "[prior]\nposition = [0, 0, 1]\n[scanner.front]\ntopic = '/front'\nposition = [1, 0, 0]\n"
        "[scanner.rear]\nscans = 'rear.bag'\ntopic = '/rear'\nheading_deg = 180\n"
    )
    mounting = read_mounting(path)
    front, rear = mounting.scanners
    assert (front.name, front.topic, front.scans) == ("front", "/front", None)
    assert (rear.name, rear.topic, rear.scans) == ("rear", "/rear", tmp_path / "rear.bag")
    np.testing.assert_allclose(front.T_vehicle_sensor.position, [1, 0, 0])
    assert abs(rear.T_vehicle_sensor.heading) == pytest.approx(np.pi)
    np.testing.assert_allclose(mounting.T_vehicle_sensor.values, 0.0)
    with pytest.raises(FileError, match=r"none\.toml"):
        read_mounting(tmp_path / "none.toml")


@pytest.mark.parametrize(("text", "words"), [
    ("", "neither"), ("[odometry]\nposition=[0,0,0]", "neither"), ("[sensors]", "unknown field `sensors`"),
    ("sensor = 3", "`sensor`: expected"), ("[sensor]\nheading = 1.5", "unknown field `heading`"),
    ("[sensor]\nposition = [1, 2]", "at `sensor.position`.*length 3"),
    ("[sensor]\nposition = [1100, 0, 1900]", "in m"), ("[sensor]\nposition = [1, true, 2]", "in m"),
    ("[sensor]\nroll_deg = nan", "roll_deg"), ("[sensor]\nroll_deg = '3'", "roll_deg"), ("[sensor", "a mounting"),
    ("scanner = 3", "`scanner`: expected"), ("[scanner.a]\nposition = [1, 2, 3]", "a topic, or scans"),
    ("[scanner.a]\ntopic = 3", "expected `str"), ("[scanner.a]\ntopic = '/a'\nrange = 3", "unknown field `range`"),
    ("[sensor]\n[scanner.a]\ntopic = '/a'", "it has both"),
])  # fmt: skip
def test_what_is_no_mounting_is_refused(tmp_path, text, words):
    path = tmp_path / "mounting.toml"
    path.write_text(text)
    with pytest.raises(FileError, match=words) as error:
        read_mounting(path)
    assert "mounting.toml" in str(error.value) and "\n" not in str(error.value)
