# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Recordings on the command line: localized as the files are, described, and refused in a line."""

import csv

import numpy as np
import pytest

from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.simulation.dataset_files import CRS
from maxcon.simulation.recordings import RecordingKind, record_drive

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

NAMES = {RecordingKind.ROS1: "drive.bag", RecordingKind.ROS2: "drive", RecordingKind.MCAP: "drive.mcap"}


@pytest.fixture(scope="module")
def recordings(drive, tmp_path_factory):
    """The simulated drive in every format, by its kind."""
    folder = tmp_path_factory.mktemp("recordings")
    dataset = drive.dataset
    for kind, name in NAMES.items():
        prior = read_trajectory(dataset.prior)
        record_drive(folder / name, kind, open_scans(dataset.scans), prior, CRS, odometry=prior)
    return {kind: folder / name for kind, name in NAMES.items()}


def _poses(path):
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert all(row["status"] == "localized" for row in rows)
    return np.array([[float(row[name]) for name in ("time", "x", "y", "z", "heading")] for row in rows])


@pytest.fixture(scope="module")
def of_files(drive, tmp_path_factory):
    """The poses of the scans as files."""
    import subprocess
    import sys

    out = tmp_path_factory.mktemp("files") / "poses.csv"
    arguments = ["localize", drive.city, drive.dataset.scans, "--prior", drive.dataset.prior, "-o", out, "-q"]
    script = "from maxcon.cli import main; main()"
    subprocess.run([sys.executable, "-c", script, *map(str, arguments)], check=True, capture_output=True)
    return _poses(out)


@pytest.mark.parametrize("kind", RecordingKind)
def test_a_recorded_drive_has_the_poses_of_its_files(maxcon, drive, recordings, of_files, kind, tmp_path):
    ended = maxcon("localize", drive.city, recordings[kind], "-o", tmp_path / "poses.csv", "-q")
    assert (ended.code, ended.err) == (0, "")
    assert "scans from /points" in ended.out and "prior: poses from /gnss/fix (NavSatFix)" in ended.out
    poses = _poses(tmp_path / "poses.csv")
    np.testing.assert_allclose(poses, of_files, atol=1e-4)  # a tenth of a millimetre


def test_a_recording_beside_files(maxcon, drive, recordings, of_files, tmp_path):
    arguments = ("localize", drive.city, drive.dataset.scans, "--prior", recordings[RecordingKind.MCAP])
    assert maxcon(*arguments, "-o", tmp_path / "a.csv", "-q").code == 0
    np.testing.assert_allclose(_poses(tmp_path / "a.csv"), of_files, atol=1e-4)
    arguments = ("localize", drive.city, recordings[RecordingKind.ROS1], "--prior", drive.dataset.prior)
    assert maxcon(*arguments, "-o", tmp_path / "b.csv", "-q").code == 0
    np.testing.assert_allclose(_poses(tmp_path / "b.csv"), of_files, atol=1e-4)


def test_what_is_asked_of_a_recording_and_is_not_there(maxcon, refused, drive, recordings, tmp_path):
    bag, scans = recordings[RecordingKind.ROS1], drive.dataset.scans
    out = ("-o", tmp_path / "poses.csv")
    for arguments, words in (
        ((scans,), ("--prior with rough poses",)),
        ((scans, "--prior", drive.dataset.prior, "--topic", "/a"), ("asked of a recording",)),
        (
            (scans, "--prior", drive.dataset.prior, "--geoid-height", "40"),
            ("--geoid-height with priors of a",),
        ),
        ((scans, "--prior", drive.dataset.prior, "--odometry-topic", "/a"), ("--odometry-topic together",)),
        ((bag, "--topic", "/a"), ("/points", "/a")),
        ((bag, "--prior-topic", "/a"), ("/a", "no such topic", "/gnss/fix")),
        ((bag, "--times", scans / "times.txt"), ("no times beside",)),
        ((bag.with_name("missing.bag"),), ("no such file",)),
    ):
        refused(maxcon("localize", drive.city, *arguments, *out), *words)
        assert not (tmp_path / "poses.csv").exists()


def test_heights_of_another_kind_are_refused(maxcon, refused, drive, tmp_path):
    prior = read_trajectory(drive.dataset.prior)
    lifted = type(prior)(prior.times, prior.positions + [0.0, 0.0, 46.0], prior.quaternions_xyzw)
    path = tmp_path / "drive.mcap"
    record_drive(path, RecordingKind.MCAP, open_scans(drive.dataset.scans), lifted, CRS)
    arguments = ("localize", drive.city, path, "-o", tmp_path / "poses.csv", "-q")
    refused(maxcon(*arguments), "above it", "--geoid-height, about 46")
    ended = maxcon(*arguments, "--geoid-height", "46")
    assert (ended.code, ended.err) == (0, "")
    assert "heights: the receiver's (ellipsoidal) less 46 m" in ended.out


def test_scans_without_times_of_points_are_not_deskewed(maxcon, refused, drive, recordings, tmp_path):
    bag = recordings[RecordingKind.ROS1]
    ended = maxcon("localize", drive.city, bag, "--deskew", "-o", tmp_path / "poses.csv", "-q")
    refused(ended, "a time for each point of /points#0", "Leave out --deskew")


@pytest.mark.parametrize("kind", RecordingKind)
def test_info_of_a_recording(maxcon, recordings, kind):
    ended = maxcon("scans", "info", recordings[kind])
    assert (ended.code, ended.err) == (0, "")
    for word in ("/gnss/fix", "sensor_msgs/msg/NavSatFix", "/points: 4 scans", "x float32 at 0", "normals"):
        assert word in ended.out
    assert maxcon("scans", "info", recordings[kind], "--topic", "/points").code == 0


def test_info_of_a_folder_and_a_file(maxcon, refused, drive, tmp_path):
    ended = maxcon("scans", "info", drive.dataset.scans)
    assert (ended.code, ended.err) == (0, "")
    assert "4 scans" in ended.out and "range" in ended.out
    assert maxcon("scans", "info", drive.dataset.scans / "000000.bin").code == 0
    refused(maxcon("scans", "info", tmp_path / "missing"), "no such folder or file")
    refused(maxcon("scans", "info", tmp_path / "missing.mcap"), "no such file")


def test_a_recording_needs_the_extra_recordings(maxcon, refused, drive, recordings, tmp_path, monkeypatch):
    import sys

    for name in ("rosbags", "mcap"):
        for loaded in [n for n in sys.modules if n == name or n.startswith(f"{name}.")]:
            monkeypatch.delitem(sys.modules, loaded)
        monkeypatch.setitem(sys.modules, name, None)
    for path in recordings.values():
        ended = maxcon("localize", drive.city, path, "-o", tmp_path / "poses.csv")
        refused(ended, path, "pip install 'maxcon[recordings]'")
