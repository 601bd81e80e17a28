# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Bags and MCAP files as scans: what was written is read, in every format, and nothing that is broken breaks more."""

import os
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from maxcon.errors import FileError, MaxconError, OptionError
from maxcon.geometry import Pose
from maxcon.io.recordings.cloud_sources import open_clouds
from maxcon.io.recordings.mcap_files import unpacked_records
from maxcon.io.recordings.opening import open_recording
from maxcon.io.recordings.writing import RecordingKind
from maxcon.io.scans import RawScan, Scans, open_scans
from maxcon.lab.simulation.datasets.recorded_drive import record_drive
from maxcon.scan.trajectory import Trajectory

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
lz4 = pytest.importorskip("lz4.frame")
zstandard = pytest.importorskip("zstandard")

NAMES = {RecordingKind.ROS1: "drive.bag", RecordingKind.ROS2: "drive", RecordingKind.MCAP: "drive.mcap"}
START = 1_626_870_701.0


class MadeScans(Scans):
    """Scans of random points, with times per point if asked for."""

    def __init__(self, n_scans, n_points=500, *, has_times=True):
        self.times = START + 0.1 * np.arange(n_scans)
        self.n_points, self.has_times = n_points, has_times

    def name(self, i):
        return str(i)

    def read(self, i, min_range=1.0, max_range=120.0):
        rng = np.random.default_rng(i)
        points = rng.uniform(-50, 50, (self.n_points, 3)).astype(np.float32).astype(np.float64)
        offsets = np.linspace(-0.05, 0.05, self.n_points) if self.has_times else None
        return RawScan(points, float(self.times[i]), str(i), len(points), 0, 0, 0, offsets)


def _prior(times):
    return Trajectory.from_poses(
        times, [Pose(550_000 + 8 * (t - times[0]), 5_802_000, 60, 0.01, -0.02, 0.3) for t in times]
    )


@pytest.fixture
def recorded(tmp_path):
    def write(kind, scans):
        path = tmp_path / NAMES[kind]
        record_drive(path, kind, scans, _prior(scans.times), "EPSG:25832", sigma=0.3)
        return path

    return write


@pytest.mark.parametrize("kind", RecordingKind)
@pytest.mark.parametrize("has_times", [True, False])
def test_what_was_written_is_read(recorded, kind, has_times):
    made = MadeScans(5, has_times=has_times)
    with_path = recorded(kind, made)
    scans = open_scans(with_path)
    assert len(scans) == 5
    np.testing.assert_allclose(scans.times, made.times, atol=1e-6)
    for i in (0, 1, 4, 2, 2):  # one after the other, and back
        raw, wanted = scans.read(i, 0.0, 200.0), made.read(i)
        np.testing.assert_array_equal(raw.points, wanted.points)
        assert raw.time == pytest.approx(wanted.time, abs=1e-6)
        assert raw.name == f"/points#{i}"
        if has_times:
            np.testing.assert_allclose(raw.point_times, wanted.point_times, atol=1e-6)
        else:
            assert raw.point_times is None
    assert "/points" in scans.words and ("relative" in scans.words) == has_times
    scans.close()


def test_the_time_of_a_scan_is_its_middle_or_that_of_its_message(recorded):
    class FromTheEnd(MadeScans):
        def read(self, i, min_range=1.0, max_range=120.0):
            raw = super().read(i)
            return replace(raw, point_times=raw.point_times - 0.05)

    path = recorded(RecordingKind.MCAP, FromTheEnd(3))
    stamps = START + 0.1 * np.arange(3)
    np.testing.assert_allclose(open_scans(path).times, stamps - 0.05, atol=1e-6)
    at_stamps = open_scans(path, at_stamp=True)
    np.testing.assert_allclose(at_stamps.times, stamps, atol=1e-6)
    assert at_stamps.read(0).point_times.max() == pytest.approx(0.0, abs=1e-6)
    assert open_scans(path).read(0).point_times.max() == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("kind", RecordingKind)
def test_memory_does_not_grow_with_the_recording(recorded, kind):
    path = recorded(kind, MadeScans(80, n_points=20_000))
    size = sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir()))
    scans = open_scans(path)
    tracemalloc.start()
    n_points = sum(len(raw.points) for raw in scans.scans(0.0, 200.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert n_points == 80 * 20_000
    assert peak < 0.6 * size


def test_an_mcap_that_its_recorder_did_not_close_is_read_as_far_as_it_is_whole(recorded, tmp_path):
    made = MadeScans(40, n_points=20_000)
    whole = recorded(RecordingKind.MCAP, made).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    scans = open_scans(cut)
    assert 10 < len(scans) < 40
    np.testing.assert_array_equal(scans.read(3, 0.0, 200.0).points, made.read(3).points)
    assert "was not closed" in scans.words


@pytest.mark.parametrize("kind", RecordingKind)
def test_broken_recordings_are_refused_in_a_line(recorded, kind, tmp_path):
    path = recorded(kind, MadeScans(3, n_points=30))
    source = path if path.is_file() else next(path.glob("*.db3"))
    whole, broken = source.read_bytes(), tmp_path / f"broken{source.suffix}"
    rng = np.random.default_rng(7)
    for number in range(120):
        content = bytearray(whole)
        if number % 3 == 0:
            content = content[: int(rng.integers(0, len(whole)))]
        else:
            for at in rng.integers(0, len(whole) if number % 3 == 1 else min(len(whole), 4096), 1 + number % 5):
                content[at] = int(rng.integers(256))
        broken.write_bytes(bytes(content))
        try:
            scans = open_scans(broken)
            for i in range(len(scans)):
                try:
                    scans.read(i)
                except FileError as error:
                    assert "\n" not in str(error)
        except MaxconError as error:
            assert "\n" not in str(error), str(error)


def test_chunks_that_unpack_hugely_are_refused(tmp_path, monkeypatch):
    from mcap.records import Chunk
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    monkeypatch.setattr("maxcon.io.recordings.bags.LARGEST_CHUNK", 2**20)
    monkeypatch.setattr("maxcon.io.recordings.mcap_files.LARGEST_CHUNK", 2**20)
    store = get_typestore(Stores.ROS1_NOETIC)
    text = store.serialize_ros1(store.types["std_msgs/msg/String"]("\0" * 2**22), "std_msgs/msg/String")
    for compression in ("BZ2", "LZ4"):
        path = tmp_path / f"{compression}.bag"
        writer = Writer(path)
        writer.set_compression(Writer.CompressionFormat[compression])
        with writer:
            connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
            writer.write(connection, 1, text)
        assert path.stat().st_size < 2**17
        with open_recording(path) as recording, pytest.raises(FileError, match="unpacks to more"):
            list(recording.messages(["/text"]))
    packed = {"zstd": zstandard.compress(bytes(2**22)), "lz4": lz4.compress(bytes(2**22)), "": bytes(100)}
    for compression, data in packed.items():
        for size in (100 if compression else 10, 2**30):
            chunk = Chunk(compression, data, 1, 0, 0, size)
            with pytest.raises(Exception, match=r"at most 1,048,576 bytes|instead of"):
                unpacked_records(chunk)


def test_topics_are_found_or_asked_for(recorded):
    path = recorded(RecordingKind.MCAP, MadeScans(1))
    with pytest.raises(OptionError, match=r"/lidar.*got /points"):
        open_clouds(path, "/lidar")
    with pytest.raises(OptionError, match=r"/gnss/fix.*NavSatFix.*Ask for /points"):
        open_clouds(path, "/gnss/fix")
    with pytest.raises(OptionError, match="no times beside"):
        open_scans(path, "times.txt")


def test_of_several_topics_one_is_asked_for(real_data):
    several = real_data("recorders/ros1bag/rms_1xxx_lms_1xx_movement_off.bag")
    with pytest.raises(FileError, match=r"/cloud_radar_track.*Choose one with --topic"):
        open_clouds(several)
    assert len(open_scans(several, topic="/cloud")) == 89


def test_what_is_no_recording(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        open_scans(tmp_path / "drive.bag")
    (tmp_path / "drive.mcap").mkdir()
    with pytest.raises(FileError):
        open_scans(tmp_path / "drive.mcap")
    (tmp_path / "empty.bag").touch()
    with pytest.raises(FileError, match="seems to be empty"):
        open_scans(tmp_path / "empty.bag")
    with pytest.raises(OptionError, match="asked of a recording"):
        open_scans(tmp_path, topic="/points")
    for name in ("long" * 100 + ".bag", "long" * 100, "nul\0.mcap"):
        with pytest.raises(FileError):
            open_scans(tmp_path / name)
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(FileError, match="which is no file"):
        open_scans(tmp_path / "pipe.mcap")


def test_a_recording_beside_scans_is_not_taken_for_them(recorded, tmp_path):
    recorded(RecordingKind.MCAP, MadeScans(2))
    assert len(open_scans(tmp_path)) == 2  # a bag whose metadata.yaml is missing
    np.ones((5, 4), "<f4").tofile(tmp_path / "1.5.bin")
    assert open_scans(tmp_path).times.tolist() == [1.5]
    (tmp_path / "metadata.yaml").touch()
    assert open_scans(tmp_path).times.tolist() == [1.5]


def test_two_clouds_of_one_time_are_one_scan(tmp_path):
    class Twice(MadeScans):
        def __init__(self):
            super().__init__(4)
            self.times = START + np.array([0.0, 0.1, 0.1, 0.2])

    path = tmp_path / "twice.bag"
    record_drive(path, RecordingKind.ROS1, Twice(), _prior(START + np.arange(3)), "EPSG:25832")
    scans = open_scans(path)
    assert len(scans) == 3 and "1 left out" in scans.words
    np.testing.assert_array_equal(scans.read(2, 0.0, 200.0).points, Twice().read(3).points)


@pytest.mark.parametrize("kind", RecordingKind)
def test_several_threads_read_what_one_does(recorded, kind):
    made = MadeScans(30, n_points=3000)
    scans = open_scans(recorded(kind, made))
    assert len(scans) == 30
    with ThreadPoolExecutor(4) as pool:
        raws = list(pool.map(lambda i: scans.read(i, 0.0, 200.0), range(30)))
    for i, raw in enumerate(raws):
        np.testing.assert_array_equal(raw.points, made.read(i).points)
        assert raw.name == f"/points#{i}"


def test_names_in_a_recording_cannot_break_a_line(tmp_path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / "odd.bag"
    with Writer(path) as writer:
        connection = writer.add_connection("/a\nb\x1b[31m", "std_msgs/msg/String", typestore=store)
        text = store.serialize_ros1(store.types["std_msgs/msg/String"]("x"), "std_msgs/msg/String")
        writer.write(connection, 1, text)
    with pytest.raises(FileError, match=r"/a\?b\?\[31m") as refused:
        open_scans(path)
    assert "\n" not in str(refused.value)
