# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize --track`: a drive as a track, with odometry and without."""

import numpy as np
import pytest

from localized_poses import rows_of
from maxcon import Trajectory
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.scanners import ProfileScanner


@pytest.fixture(scope="module")
def dense(built_once):
    """Twelve epochs through the city of the small drive, whose map is there already."""
    thinnest = (ProfileScanner(line_rate=2.0, points_per_line=30),)

    def make(folder):
        simulate(folder / "dataset", n_epochs=12, seed=3, before=30.0, after=20.0, mapping_scanners=thinnest)

    return Dataset.open(built_once("dense", make) / "dataset")


@pytest.fixture
def odometry(dense, tmp_path):
    """The reference from a frame of its own."""
    reference = read_trajectory(dense.reference)
    poses = [reference.pose(0).inverse @ pose for pose in reference.poses()]
    write_tum(tmp_path / "odometry.txt", Trajectory.from_poses(reference.times, poses))
    return tmp_path / "odometry.txt"


def test_a_drive_is_tracked_with_odometry(localize, dense, odometry, tmp_path):
    options = ("--track", "--odometry", odometry, "--drift", "0.005", "--plot", tmp_path / "pictures")
    ended = localize(*options, "--plot-epochs", "11", scans=dense.scans, prior=dense.prior)
    assert ended.err == ""
    statuses = [row["status"] for row in rows_of(tmp_path / "poses.csv")]
    assert statuses[2:] == ["localized"] * 10
    assert ended.code == 0  # whether or not it knew at once where it was
    assert ("the track begins with epoch" in ended.out) == (statuses[0] != "localized")
    found, reference = read_trajectory(tmp_path / "poses.csv"), read_trajectory(dense.reference)
    true = np.array([reference.at(float(time)).position for time in found.times])
    assert np.abs(found.positions[:, :2] - true[:, :2]).max() < 0.1
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["000011.png"]  # of its default cells


def test_odometry_that_jumps_is_said_and_trusted_less(localize, dense, odometry, tmp_path):
    told, jumps = read_trajectory(odometry), tmp_path / "jumps.txt"
    off = np.random.default_rng(0).uniform(-1.0, 1.0, told.positions.shape) * [1.0, 1.0, 0.0]
    write_tum(jumps, Trajectory(told.times, told.positions + off, told.quaternions_xyzw))
    ended = localize("--track", "--odometry", jumps, scans=dense.scans, prior=dense.prior)
    assert ended.out.startswith("the odometry jumps as no vehicle does")
    assert {row["status"] for row in rows_of(tmp_path / "poses.csv")[-4:]} == {"localized"}
