# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Real files of recorders and scanners: what is in them."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.io.point_records import decode_points, records_of_message
from maxcon.io.recordings.clouds import open_clouds
from maxcon.io.scans import open_scans, read_scan_file

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
pytest.importorskip("velodyne_decoder")


@pytest.fixture(scope="module")
def recorders(real_data):
    return real_data("recorders")


def test_seconds_and_nanoseconds_of_a_real_scanner(recorders):
    with_clouds = open_clouds(recorders / "ros1bag" / "embag_test.bag")
    clouds = [cloud.points() for cloud in with_clouds.clouds()]
    for cloud in clouds:
        assert cloud.times.kind == "time_sec + time_nsec: s + ns, absolute"
        assert "the message has the time of the last point" in cloud.times.words
        assert -0.089 < cloud.times.offsets.min() < -0.087 and abs(cloud.times.offsets.max()) < 1e-9
    points = np.concatenate([cloud.points for cloud in clouds])
    assert points[:, 1].min() > 4.0  # +y is forward


def test_an_unaligned_cloud_with_repeated_points(recorders):
    rosbags = pytest.importorskip("rosbags.typesys")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
    data = (recorders / "ros2bag" / "cloudini" / "dds_message.bin").read_bytes()
    content = store.deserialize_cdr(data, "sensor_msgs/msg/PointCloud2")
    stamp = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec
    cloud = decode_points(records_of_message(content), stamp)
    assert (cloud.n_points, cloud.n_invalid) == (64_000, 4_578)
    assert cloud.n_duplicates + len(cloud.points) == 64_000 - 4_578
    assert len(np.unique(cloud.points, axis=0)) == len(cloud.points) > 30_000
    assert cloud.times.offsets.min() >= 0.0 and cloud.times.offsets.max() < 0.051
    assert cloud.times.kind == "timestamp (float64): s, absolute"


def test_packets_of_a_velodyne_become_the_cloud_that_another_driver_made(recorders):
    folder = recorders / "ros2bag" / "nebula" / "vlp16"
    true = read_scan_file(folder / "1673400472138016708.pcd").points
    medians, shares = [], []
    for raw in open_scans(folder / "1673400471837873222").scans(0.0, 200.0):
        distances, _ = cKDTree(raw.points).query(true)
        medians.append(np.median(distances))
        shares.append(np.mean(distances < 0.05))
    assert min(medians) < 0.01 and max(shares) > 0.9


def test_one_of_several_topics_and_scans_of_three_floats_that_others_wrote(recorders):
    several = recorders / "ros1bag" / "rms_1xxx_lms_1xx_movement_off.bag"
    assert len(open_scans(several, topic="/cloud")) == 89
    folder = recorders / "drives" / "gtsam_points" / "newer_06"
    for name in ("raw_00.bin", "raw_01.bin", "deskewed_02.bin"):
        values = np.fromfile(folder / name, "<f4").reshape(-1, 3)
        np.testing.assert_array_equal(read_scan_file(folder / name).points, values)
