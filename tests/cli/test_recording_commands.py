"""Recordings on the command line: localized as the files are, described, and refused in a line."""

import json

import numpy as np
import pytest

from localized_poses import localized_poses
from maxcon.geometry import Pose
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation.datasets import CRS
from maxcon.scan.trajectory import Trajectory
from recorded_drives import NAMES, record_drive

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


@pytest.fixture(scope="module")
def recordings(drive, built_once):
    """The simulated drive in every format, by its kind."""
    dataset = drive.dataset

    def make(folder):
        prior = read_trajectory(dataset.prior)
        for name in NAMES.values():
            record_drive(folder / name, open_scans(dataset.scans), prior, CRS, odometry=prior)

    folder = built_once("recordings", make)
    return {kind: folder / name for kind, name in NAMES.items()}


@pytest.fixture
def assert_same(poses, tmp_path):
    """Check that the poses are those of the drive's files, to a tenth of a millimetre."""

    def check(ended, name="poses.csv"):
        assert (ended.code, ended.err) == (0, "")
        np.testing.assert_allclose(localized_poses(tmp_path / name), localized_poses(poses), atol=1e-4)

    return check


@pytest.mark.parametrize("kind", NAMES)
def test_a_recorded_drive_has_the_poses_of_its_files(localize, maxcon, recordings, assert_same, kind):
    ended = localize(scans=recordings[kind], prior=None)
    assert_same(ended)
    assert "scans from /points" in ended.out and "prior: poses from /gnss/fix (NavSatFix)" in ended.out
    ended = maxcon("scans", "info", recordings[kind], "--topic", "/points")
    assert (ended.code, ended.err) == (0, "")
    for word in ("/gnss/fix", "sensor_msgs/msg/NavSatFix", "/points: 4 scans", "x float32 at 0", "normals"):
        assert word in ended.out
    facts = json.loads(maxcon("scans", "info", recordings[kind], "--topic", "/points", "--json").out)
    (scanner,) = facts["scanners"]
    assert {"name": "/gnss/fix", "type": "sensor_msgs/msg/NavSatFix", "n_messages": 4} in facts["topics"]
    assert (scanner["n_scans"], scanner["n_read"], scanner["problem"]) == (4, 4, "")
    assert f"{scanner['points_per_scan']:,.0f} a scan" in ended.out
    least, median, largest = scanner["range"]
    assert f"{least:.2f} to {largest:.1f} m, median {median:.1f} m" in ended.out
    assert f"{100.0 * scanner['with_normals']:.0f} % of the points" in ended.out


def test_what_is_asked_of_a_recording_and_is_not_there(localize, refused, recordings, tmp_path):
    bag = recordings["bag"]
    for options, words in (
        (("--prior-frames", "a:b", "--prior-topic", "/c"), ("either --prior-topic or --prior-frames",)),
        (("--topic", "/a"), ("/points", "/a")),
        (("--prior-topic", "/a"), ("/a", "no such topic", "/gnss/fix")),
        (("--deskew",), ("a time for each point of /points#0", "--turn-time")),
    ):
        refused(localize(*options, scans=bag, prior=None), *words)
    refused(localize(prior=None), "--prior with rough poses")
    assert not (tmp_path / "poses.csv").exists()


def test_a_recording_needs_the_extra_recordings(localize, refused, recordings, without):
    without("rosbags", "mcap")
    for path in recordings.values():
        refused(localize(scans=path, prior=None), path, "pip install 'maxcon[recordings]'")


def test_scans_are_deskewed_by_odometry(localize, drive, assert_same, tmp_path):
    """By one of a car that stood: what becomes of points in motion is tested beside the code that moves them."""
    times = np.arange(drive.reference.times[0] - 1.0, drive.reference.times[-1] + 1.0, 0.1)
    still = Trajectory.from_poses(times, [Pose(1.0, 2.0, 0.0, 0.0, 0.0, 0.3)] * len(times))
    write_tum(tmp_path / "still.txt", still)
    ended = localize("--odometry", tmp_path / "still.txt", "--deskew", "--turn-time", "0.1")
    assert_same(ended)
    assert "deskewed by the odometry" in ended.out


def test_two_scanners_in_one_epoch(localize, refused, drive, tmp_path):
    """The scan's points left and right of the car as two scanners, each in a frame of its own: the same poses."""
    mounts = {"left": Pose(0.4, 1.1, -0.3, 0.0, 0.1, 0.7), "right": Pose(-0.2, -0.8, 0.1, 0.02, 0.0, -1.9)}
    whole, text = open_scans(drive.dataset.scans), "[prior]\n"
    for side, mount in mounts.items():
        (tmp_path / side).mkdir()
        for i in range(len(whole)):
            points = whole.read(i, 0.0, np.inf).points
            points = points[(points[:, 1] > 0) == (side == "left")]
            rows = np.column_stack([(points - mount.position) @ mount.rotation, np.zeros(len(points))])
            (tmp_path / side / f"{i:06d}.bin").write_bytes(rows.astype("<f4").tobytes())
        (tmp_path / side / "times.txt").write_text("".join(f"{time:.6f}\n" for time in whole.times))
        roll, pitch, heading = np.degrees([mount.roll, mount.pitch, mount.heading])
        text += f"[scanner.{side}]\nscans = '{side}'\nposition = {mount.position.tolist()}\n"
        text += f"roll_deg = {roll}\npitch_deg = {pitch}\nheading_deg = {heading}\n"
    (tmp_path / "rig.toml").write_text(text)
    rig = ("--mounting", tmp_path / "rig.toml")
    ended = localize(*rig, scans=tmp_path)
    assert (ended.code, ended.err) == (0, "")
    assert "scans of 2 scanners: left in 4 epochs, up to 0.0 ms off; right in 4 epochs" in ended.out
    poses = localized_poses(tmp_path / "poses.csv")
    true = np.array([drive.reference.at(time).position for time in poses[:, 0]])
    assert np.linalg.norm(poses[:, 1:3] - true[:, :2], axis=1).max() < 0.02
    for_one = ("--overwrite", "--turn-time", "0.1", "--deskew")
    refused(localize(*rig, *for_one, scans=tmp_path), "rig.toml, or --turn-time, got both")
