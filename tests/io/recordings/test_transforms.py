"""Transforms of a recording: composed and interpolated between frames, and as the mounting of a scanner."""

import math

import numpy as np
import pytest

from maxcon.errors import FileError, OptionError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.io.recordings.opening import open_recording
from maxcon.io.recordings.poses import read_recorded_poses
from maxcon.io.recordings.recording import Entry, header_of
from maxcon.io.recordings.transforms import TransformTree, parse_frames
from recorded_drives import NAMES, transforms, write_entries

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

T_base_gnss = Pose(-0.4, 0.3, 1.6, 0.0, 0.0, 0.0)
T_base_imu = Pose(0.2, 0.0, 0.5, 0.0, 0.0, math.pi / 2)
T_base_lidar = Pose(1.1, 0.0, 1.9, 0.01, 0.04, -0.3)
STATIC = transforms(
    1.0, ("base_link", "gnss", T_base_gnss), ("base_link", "imu", T_base_imu), ("base_link", "/lidar", T_base_lidar),
    topic="/tf_static",
)  # fmt: skip


def odom(time):
    """T_map_odom at a time: a correction that drifts."""
    return Pose(500_000.0 + 0.02 * time, 5_800_000.0, 60.0, 0.0, 0.0, 0.5)


def base(time):
    """T_odom_base at a time: a bend."""
    return Pose(8.0 * time, 0.2 * time, 0.0, 0.01, -0.02, 0.1 * time)


def drive(n=101):
    """Corrections once a second, odometry each 10 ms, mounting once."""
    return [
        STATIC,
        *(transforms(1.0 + k, ("map", "odom", odom(1.0 + k))) for k in range(n // 100 + 1)),
        *(transforms(1.0 + 0.01 * k, ("/odom", "base_link", base(1.0 + 0.01 * k))) for k in range(n)),
    ]


def written(folder, entries, kind="mcap"):
    folder.mkdir(exist_ok=True)
    return write_entries(folder / NAMES[kind], sorted(entries, key=lambda entry: entry.time))


@pytest.mark.parametrize("kind", NAMES)
def test_a_chain_is_composed_and_interpolated(tmp_path, kind):
    path = written(tmp_path, drive(), kind)
    poses = read_recorded_poses(path, frames=("map", "lidar"))
    assert poses.words == "poses from /tf (map -> odom -> base_link -> lidar)"
    assert len(poses.trajectory) == 101
    for time in (1.0, 1.37, 1.415, 2.0):
        true = odom(time) @ base(time) @ T_base_lidar
        found = poses.trajectory.at(time)
        np.testing.assert_allclose(found.position, true.position, atol=1e-4)
        np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-5)


def test_a_chain_is_read_backwards_and_the_static_mounting_moves_poses_to_the_scanner(tmp_path):
    path = written(tmp_path, drive())
    forth = read_recorded_poses(path, frames=("gnss", "odom")).trajectory.at(1.5)
    np.testing.assert_allclose(forth.position, (base(1.5) @ T_base_gnss).inverse.position, atol=1e-4)
    poses = read_recorded_poses(path, frames=("map", "base_link"), sensor_frame="lidar")
    assert "moved from base_link to lidar by /tf_static: 1.100 0.000 1.900 m, 0.57 2.29 -17.19 degrees" in poses.words
    true = odom(1.5) @ base(1.5) @ T_base_lidar
    np.testing.assert_allclose(poses.trajectory.at(1.5).position, true.position, atol=1e-4)
    assert "moved" not in read_recorded_poses(path, frames=("map", "base_link"), sensor_frame="another").words


def test_an_antenna_and_an_imu_with_frames_of_their_own(tmp_path):
    """A position is the antenna's, its orientation the IMU's; both lie in the vehicle as /tf_static says."""
    from maxcon.io.crs import GeographicFrame

    frame = GeographicFrame("EPSG:25832")
    entries = [STATIC]
    for k in range(50):
        time = 1.0 + 0.1 * k
        T_map_base = Pose(500_000.0 + 8.0 * time, 5_800_000.0, 60.0, 0.01, -0.02, 0.0)
        antenna = frame.to_geographic((T_map_base @ T_base_gnss).position[None])
        imu = T_map_base @ T_base_imu
        turn = quaternions_from_angles(imu.roll, imu.pitch, imu.heading)
        (turn,) = frame.quaternions_to_map(antenna, turn.reshape(1, 4), inverse=True)
        latitude, longitude, height = antenna[0].tolist()
        entries.append(Entry(time, "/fix", "sensor_msgs/msg/NavSatFix", {
            "header": header_of(time, "gnss"), "status": dict(status=0, service=1), "latitude": latitude,
            "longitude": longitude, "altitude": height, "position_covariance": np.zeros(9),
        }))  # fmt: skip
        zero = dict(x=0.0, y=0.0, z=0.0)
        entries.append(Entry(time, "/imu", "sensor_msgs/msg/Imu", {
            "header": header_of(time, "imu"), "orientation": dict(zip("xyzw", turn.tolist(), strict=True)),
            "orientation_covariance": np.zeros(9), "angular_velocity": zero, "linear_acceleration": zero,
            "angular_velocity_covariance": np.zeros(9), "linear_acceleration_covariance": np.zeros(9),
        }))  # fmt: skip
    path = written(tmp_path, entries)
    poses = read_recorded_poses(path, crs="EPSG:25832", sensor_frame="lidar", are_sure=True)
    true = T_map_base @ T_base_lidar
    found = poses.trajectory.pose(len(poses.trajectory) - 1)
    np.testing.assert_allclose(found.position, true.position, atol=2e-3)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-5)


def test_what_cannot_be_is_refused(tmp_path):
    path = written(tmp_path, [*drive(), transforms(1.5, ("shore", "boat", Pose(0, 0, 0, 0, 0, 0)))])
    for frames, kind, words in (
        (("map", "velodyne"), OptionError, r"Expected a frame of .*, got 'velodyne'\. It has base_link, boat"),
        (("map", "boat"), FileError, "between map and boat, got none"),
        (("gnss", "lidar"), FileError, "which is static"),
        (None, FileError, r"two of the frames base_link.*--prior-frames FIXED:MOVING"),
    ):
        with pytest.raises(kind, match=words):
            read_recorded_poses(path, frames=frames)
    for text in ("map", "map:", "a:b:c"):
        with pytest.raises(OptionError, match="FIXED:MOVING"):
            parse_frames(text, "--prior-frames")
    two = [*drive(), transforms(1.5, ("utm", "base_link", base(1.5)))]
    with pytest.raises(FileError, match=r"one parent of the frame base_link in .*, got odom, utm"):
        read_recorded_poses(written(tmp_path / "two", two), frames=("map", "lidar"))
    circle = [transforms(1.0, ("a", "b", base(1.0)), ("b", "a", base(1.0)))]
    with open_recording(written(tmp_path / "circle", circle)) as recording:
        assert TransformTree(recording).static_pose("a", "b") is None


def test_no_pose_is_made_across_a_gap(tmp_path):
    still = [STATIC, transforms(1.0, ("map", "odom", odom(1.0)), ("odom", "base_link", base(1.0)))]
    later = [transforms(9.0, ("map", "odom", odom(9.0))), transforms(5.0, ("odom", "base_link", base(5.0)))]
    trajectory = read_recorded_poses(written(tmp_path, still + later), frames=("map", "lidar")).trajectory
    np.testing.assert_allclose(trajectory.times, [1.0])
    apart = [transforms(1.0, ("map", "odom", odom(1.0))), transforms(9.0, ("odom", "base_link", base(9.0)))]
    with pytest.raises(TrajectoryError, match="at common times"):
        read_recorded_poses(written(tmp_path / "apart", apart), frames=("map", "base_link"))
