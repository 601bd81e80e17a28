"""Captures of a VLP-16, whose points come out as they were put in, and real files of recorders and scanners."""

from unittest.mock import Mock

import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.errors import FileError
from maxcon.io.point_records import decode_points, records_of_message
from maxcon.io.recordings import clouds
from maxcon.io.recordings.clouds import open_clouds
from maxcon.io.scans import describe, open_scans, read_scan_file
from recorded_drives import velodyne_points, write_capture

pytest.importorskip("velodyne_decoder")
pytest.importorskip("dpkt")

TIMES = [386400.0, 386400.11, 386407.0, 386407.11]  # with a gap, after which a turn has no packet of the one before


@pytest.fixture(scope="module")
def turns():
    return np.random.default_rng(0).uniform(2.0, 90.0, (4, 1800, 16))


@pytest.fixture(scope="module")
def capture(turns, tmp_path_factory):
    return write_capture(tmp_path_factory.mktemp("capture") / "drive.pcap", turns, TIMES)


def test_the_points_and_times_of_the_turns(capture, turns):
    read = open_scans(capture)
    np.testing.assert_allclose(read.times, TIMES, atol=5e-6)
    for i in (0, 2):
        true, raw = velodyne_points(turns[i]), read.read(i, 0.0, 200.0)
        distances, rows = cKDTree(true).query(raw.points)
        assert len(raw.points) == len(np.unique(rows)) == len(true) == 28_800
        # 2 mm in range and 0.01 degrees in azimuth: half of each at most.
        assert (distances < 0.0011 + np.radians(0.0055) * np.linalg.norm(true[rows], axis=1)).all()
        assert raw.point_times.min() == pytest.approx(-0.0497, abs=1e-4)
    found = describe(capture)
    assert [(topic.name, topic.n_messages) for topic in found.topics] == [("port 2368", 4 * 76)]
    assert ": 4 scans, " in found.scanners[0].words["scans"]


def test_any_turn_is_decoded_from_its_own_packets(capture, monkeypatch):
    """They were decoded from the beginning of the capture, each time."""
    in_order = list(open_scans(capture).scans(0.0, 200.0))
    scans, decoded = open_scans(capture), Mock(wraps=clouds._decoded)
    assert len(scans) == 4
    monkeypatch.setattr(clouds, "_decoded", decoded)
    for i in (3, 1, 2, 0, 3):
        raw = scans.read(i, 0.0, 200.0)
        np.testing.assert_array_equal(raw.points, in_order[i].points)
        np.testing.assert_array_equal(raw.point_times, in_order[i].point_times)
    assert [len(call.args[1]) for call in decoded.call_args_list] == [76] * 5


def test_packets_of_others_and_cut_captures(capture, tmp_path):
    data = capture.read_bytes()
    cut = tmp_path / "cut.pcap"
    cut.write_bytes(data[: 24 + 16 + 100])
    with pytest.raises(FileError, match=r"a turn of a Velodyne scanner in .*cut\.pcap, got none"):
        len(open_scans(cut))
    cut.write_bytes(data[: len(data) // 2])
    assert len(open_scans(cut)) == 2
    cut.write_bytes(b"no capture at all, but some other bytes")
    with pytest.raises(FileError, match=r"cut\.pcap to be a capture of packets"):
        open_scans(cut)
    other = tmp_path / "other.pcap"
    other.write_bytes(data.replace(b"\x09\x40\x09\x40\x04\xbe", b"\x1d\x4e\x1d\x4e\x04\xaf"))  # port and length
    with pytest.raises(FileError, match=r"packets of a Velodyne in .*got 304 of 1191 bytes to port 7502\. Record"):
        open_scans(other)


pytest.importorskip("rosbags")
pytest.importorskip("mcap")


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
