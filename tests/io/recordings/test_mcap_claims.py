# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""An MCAP file that claims more than it has: nothing is made ready for what is not there."""

import struct

import numpy as np
import pytest

from maxcon import Pose, Trajectory, open_scans
from maxcon.io.recordings.writing import RecordingKind
from maxcon.lab.simulation.datasets.recorded_drive import record_drive

pytest.importorskip("mcap", reason="the extra recordings is not installed")


@pytest.fixture
def recording(tmp_path):
    (tmp_path / "scans").mkdir()
    points = np.random.default_rng(0).uniform(2.0, 9.0, (50, 4)).astype("<f4")
    (tmp_path / "scans" / "1.5.bin").write_bytes(points.tobytes())
    prior = Trajectory.from_poses([1.0, 2.0], [Pose(550_000.0, 5_802_000.0, 50.0, 0.0, 0.0, 0.0)] * 2)
    path = tmp_path / "drive.mcap"
    record_drive(path, RecordingKind.MCAP, open_scans(tmp_path / "scans"), prior, "EPSG:25832")
    return path


def test_a_chunk_that_claims_to_hold_what_no_memory_does(recording):
    assert len(list(open_scans(recording).scans())) == 1
    data = bytearray(recording.read_bytes())
    at = data.index(b"\x04\x00\x00\x00zstd") + 8
    assert struct.unpack_from("<Q", data, at)[0] < len(data)
    struct.pack_into("<Q", data, at, 2**62)
    recording.write_bytes(data)
    # Read as far as the file goes: what is in the chunk is held against its size and checksum.
    assert [len(raw.points) for raw in open_scans(recording).scans()] == [50]
