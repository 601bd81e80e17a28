"""Bags and MCAP files as scans: what was written is read, in every format, and nothing that is broken breaks more."""

import os
import struct
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from maxcon.errors import FileError, OptionError
from maxcon.io.recordings.clouds import open_clouds
from maxcon.io.recordings.opening import open_recording, unpacked_records
from maxcon.io.scans import open_scans
from maxcon.lab.simulation.recordings import cloud_message
from recorded_drives import NAMES, START, MadeScans, made_prior, record_drive, write_entries

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
lz4 = pytest.importorskip("lz4.frame")
zstandard = pytest.importorskip("zstandard")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Thirty scans with times of points in every format, by its kind."""
    folder = tmp_path_factory.mktemp("recorded")
    made = MadeScans(30, n_points=3000)
    return {kind: record_drive(folder / name, made, sigma=0.3) for kind, name in NAMES.items()}


def assert_read(raw, wanted):
    np.testing.assert_array_equal(raw.points, wanted.points)
    assert raw.time == pytest.approx(wanted.time, abs=1e-6)
    assert raw.name == f"/points#{wanted.name}"
    np.testing.assert_allclose(raw.point_times, wanted.point_times, atol=1e-6)


@pytest.mark.parametrize("kind", NAMES)
def test_what_was_written_is_read_in_any_order_by_several_threads(recorded, kind):
    made, scans = MadeScans(30, n_points=3000), open_scans(recorded[kind])
    np.testing.assert_allclose(scans.times, made.times, atol=1e-6)
    for i in (0, 1, 4, 2, 2, 29):
        assert_read(scans.read(i, 0.0, 200.0), made.read(i))
    with ThreadPoolExecutor(4) as pool:
        for i, raw in enumerate(pool.map(lambda i: scans.read(i, 0.0, 200.0), range(30))):
            assert_read(raw, made.read(i))
    assert "/points" in scans.words and "relative" in scans.words
    scans.close()


def test_clouds_recorded_out_of_order_are_all_read(tmp_path):
    """Clouds that were recorded earlier than one before them in the file were lost."""
    from mcap.writer import Writer

    made = MadeScans(40)
    plain = record_drive(tmp_path / "plain.mcap", made)
    shuffled, rng = tmp_path / "shuffled.mcap", np.random.default_rng(3)
    with open_recording(plain) as recording, shuffled.open("wb") as stream:
        writer = Writer(stream, chunk_size=30_000)  # a few clouds each, whose times overlap
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"")
        channel = writer.register_channel("/points", "cdr", schema)
        messages = list(recording.messages(["/points"]))
        for i in np.argsort(np.arange(40) + rng.uniform(0.0, 12.0, 40)):
            delay = int(rng.uniform(0.0, 2e9))
            writer.add_message(channel, messages[i].recorded + delay, messages[i].data, messages[i].recorded)
        writer.finish()
    scans = open_scans(shuffled)
    assert (np.diff(scans._index[0]) < 0).any()
    np.testing.assert_allclose(scans.times, made.times, atol=1e-6)
    for i in (*range(40), *rng.permutation(40).tolist()):
        np.testing.assert_array_equal(scans.read(i, 0.0, 200.0).points, made.read(i).points)


def test_the_time_of_a_scan_is_its_middle_or_that_of_its_message(tmp_path):
    class FromTheEnd(MadeScans):
        def read(self, i, min_range=1.0, max_range=120.0):
            raw = super().read(i)
            return replace(raw, point_times=raw.point_times - 0.05)

    path = record_drive(tmp_path / "drive.mcap", FromTheEnd(3))
    stamps = START + 0.1 * np.arange(3)
    np.testing.assert_allclose(open_scans(path).times, stamps - 0.05, atol=1e-6)
    without = open_scans(record_drive(tmp_path / "without.mcap", MadeScans(2, has_times=False)))
    assert without.read(1).point_times is None and "relative" not in without.words
    at_stamps = open_scans(path, at_stamp=True)
    np.testing.assert_allclose(at_stamps.times, stamps, atol=1e-6)
    assert at_stamps.read(0).point_times.max() == pytest.approx(0.0, abs=1e-6)
    assert open_scans(path).read(0).point_times.max() == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("kind", NAMES)
def test_memory_does_not_grow_with_the_recording(kind, tmp_path):
    path = record_drive(tmp_path / NAMES[kind], MadeScans(40, n_points=20_000))
    size = sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir()))
    scans = open_scans(path)
    tracemalloc.start()
    n_points = sum(len(raw.points) for raw in scans.scans(0.0, 200.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert n_points == 40 * 20_000 and peak < 0.7 * size


def test_an_mcap_that_its_recorder_did_not_close_is_read_as_far_as_it_is_whole(tmp_path):
    made = MadeScans(40, n_points=20_000)
    path = record_drive(tmp_path / "cut.mcap", made)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    scans = open_scans(path)
    assert 10 < len(scans) < 40
    np.testing.assert_array_equal(scans.read(3, 0.0, 200.0).points, made.read(3).points)
    assert "was not closed" in scans.words
    # So is one with a chunk that claims more than any memory: it is held against its size and checksum.
    data = bytearray(record_drive(path, MadeScans(1, n_points=50)).read_bytes())
    at = data.index(b"\x04\x00\x00\x00zstd") + 8
    assert struct.unpack_from("<Q", data, at)[0] < len(data)
    struct.pack_into("<Q", data, at, 2**62)
    path.write_bytes(data)
    assert [raw.n_returns for raw in open_scans(path).scans()] == [50]


def _text_bag(path, topic, text, compression=None):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, writer = get_typestore(Stores.ROS1_NOETIC), Writer(path)
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        connection = writer.add_connection(topic, "std_msgs/msg/String", typestore=store)
        content = store.types["std_msgs/msg/String"](text)
        writer.write(connection, 1, store.serialize_ros1(content, "std_msgs/msg/String"))
    return path


def test_chunks_that_unpack_hugely_are_refused(tmp_path, monkeypatch):
    from mcap.records import Chunk

    monkeypatch.setattr("maxcon.io.recordings.opening.LARGEST_CHUNK", 2**20)
    for compression in ("BZ2", "LZ4"):
        path = _text_bag(tmp_path / f"{compression}.bag", "/text", "\0" * 2**22, compression)
        assert path.stat().st_size < 2**17
        with open_recording(path) as recording, pytest.raises(FileError, match="unpacks to more"):
            list(recording.messages(["/text"]))
    packed = {"zstd": zstandard.compress(bytes(2**22)), "lz4": lz4.compress(bytes(2**22)), "": bytes(100)}
    for compression, data in packed.items():
        for size in (100 if compression else 10, 2**30):
            chunk = Chunk(compression, data, 1, 0, 0, size)
            with pytest.raises(Exception, match=r"a chunk of 1,073,741,824 bytes|instead of"):
                unpacked_records(chunk)


def test_topics_are_found_or_asked_for(recorded, tmp_path):
    with pytest.raises(OptionError, match=r"/lidar.*got no such topic. Ask for /points"):
        open_clouds(recorded["mcap"], "/lidar")
    with pytest.raises(OptionError, match=r"/gnss/fix.*NavSatFix.*Ask for /points"):
        open_clouds(recorded["mcap"], "/gnss/fix")
    with pytest.raises(OptionError, match="no times beside"):
        open_scans(recorded["mcap"], "times.txt")
    several = [cloud_message(MadeScans(1), 0, topic) for topic in ("/front", "/rear")]
    with pytest.raises(FileError, match=r"/front .*PointCloud2\), /rear.*Choose one with --topic"):
        open_clouds(write_entries(tmp_path / "two.bag", several))
    assert len(open_scans(tmp_path / "two.bag", topic="/rear")) == 1


def test_what_is_no_recording_and_what_lies_beside_scans(tmp_path):
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "empty.bag").touch()
    os.mkfifo(tmp_path / "pipe.mcap")
    for name, words in (
        ("drive.bag", "no such file"), ("folder.mcap", "folder"), ("empty.bag", "seems to be empty"),
        ("pipe.mcap", "which is no file"),
        *((name, "Expected") for name in ("long" * 100 + ".bag", "long" * 100, "nul\0.mcap")),
    ):  # fmt: skip
        with pytest.raises(FileError, match=words):
            open_scans(tmp_path / name)
    with pytest.raises(OptionError, match="asked of a recording"):
        open_scans(tmp_path / "folder.mcap", topic="/points")
    bag = tmp_path / "bag"
    bag.mkdir()
    record_drive(bag / "drive.mcap", MadeScans(2))
    assert len(open_scans(bag)) == 2  # a bag whose metadata.yaml is missing
    np.ones((5, 4), "<f4").tofile(bag / "1.5.bin")
    assert open_scans(bag).times.tolist() == [1.5]
    (bag / "metadata.yaml").touch()
    assert open_scans(bag).times.tolist() == [1.5]


def test_two_clouds_of_one_time_are_one_scan_and_names_cannot_break_a_line(tmp_path):
    made = MadeScans(4)
    made.times = START + np.array([0.0, 0.1, 0.1, 0.2])
    scans = open_scans(record_drive(tmp_path / "twice.bag", made, made_prior(START + np.arange(3))))
    assert len(scans) == 3 and "1 left out" in scans.words
    np.testing.assert_array_equal(scans.read(2, 0.0, 200.0).points, made.read(3).points)
    with pytest.raises(FileError, match=r"^[^\n]*/a\?b\?\[31m[^\n]*$"):
        open_scans(_text_bag(tmp_path / "odd.bag", "/a\nb\x1b[31m", "x"))
