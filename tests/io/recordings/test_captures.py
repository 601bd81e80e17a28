# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Captures of a VLP-16: the points that were put in come out, in any order, each turn from its own packets."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.errors import FileError
from maxcon.io.recordings import clouds
from maxcon.io.scans import describe, open_scans
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
    assert ": 4 scans, " in found.scanners[0]["scans"]


def test_any_turn_is_decoded_from_its_own_packets(capture, monkeypatch):
    """They were decoded from the beginning of the capture, each time."""
    in_order = list(open_scans(capture).scans(0.0, 200.0))
    scans, decode, n_packets = open_scans(capture), clouds._decoded, []
    assert len(scans) == 4

    def counted(package, packets, config):
        n_packets.append(len(packets))
        return decode(package, packets, config)

    monkeypatch.setattr(clouds, "_decoded", counted)
    for i in (3, 1, 2, 0, 3):
        raw = scans.read(i, 0.0, 200.0)
        np.testing.assert_array_equal(raw.points, in_order[i].points)
        np.testing.assert_array_equal(raw.point_times, in_order[i].point_times)
    assert n_packets == [76] * 5


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
