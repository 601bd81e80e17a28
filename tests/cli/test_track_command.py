# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize --track`: a drive as a track, with odometry and without."""

import csv

import numpy as np
import pytest

from maxcon import Trajectory
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation import ProfileScanner, simulate


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    """Twelve epochs through the city of the small drive, whose map is there already."""
    thinnest = (ProfileScanner(line_rate=2.0, points_per_line=30),)
    out = tmp_path_factory.mktemp("dense") / "dataset"
    return simulate(out, n_epochs=12, seed=3, before=30.0, after=20.0, mapping_scanners=thinnest)


@pytest.fixture
def odometry(dense, tmp_path):
    """The reference from a frame of its own."""
    reference = read_trajectory(dense.reference)
    poses = [reference.pose(0).inverse @ pose for pose in reference.poses()]
    write_tum(tmp_path / "odometry.txt", Trajectory.from_poses(reference.times, poses))
    return tmp_path / "odometry.txt"


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_drive_is_tracked_with_odometry(maxcon, drive, dense, odometry, tmp_path):
    out = tmp_path / "poses.csv"
    ended = maxcon(
        "localize", drive.city, dense.scans, "--prior", dense.prior, "--track", "--odometry", odometry,
        "--drift", "0.005", "-o", out,
    )  # fmt: skip
    assert ended.err == ""
    statuses = [row["status"] for row in rows(out)]
    assert statuses[2:] == ["localized"] * 10
    assert ended.code == 0  # whether or not it knew at once where it was
    assert ("the track begins with epoch" in ended.out) == (statuses[0] != "localized")
    found, reference = read_trajectory(out), read_trajectory(dense.reference)
    true = np.array([reference.at(float(time)).position for time in found.times])
    assert np.abs(found.positions[:, :2] - true[:, :2]).max() < 0.1


def test_the_prior_s_own_motion_does_without_odometry(maxcon, drive, dense, tmp_path):
    out = tmp_path / "poses.csv"
    ended = maxcon("localize", drive.city, dense.scans, "--prior", dense.prior, "--track", "-o", out)
    assert ended.err == ""
    assert {row["status"] for row in rows(out)[-4:]} == {"localized"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--odometry", "o.txt"), "Expected --odometry together with --track or --deskew, got it alone."),
        (("--track", "--drift", "0.01"), "Expected --drift together with --odometry, got it alone."),
        (("--track", "--odometry", "missing.txt"), "missing.txt"),
    ],
)
def test_options_without_effect_are_refused(maxcon, drive, dense, tmp_path, options, words):
    ended = maxcon(
        "localize", drive.city, dense.scans, "--prior", dense.prior, "-o", tmp_path / "p.csv", *options
    )  # fmt: skip
    assert ended.code == 2
    assert words in ended.err
    assert not (tmp_path / "p.csv").exists()


def test_odometry_of_another_clock_names_its_file(maxcon, drive, dense, odometry, tmp_path):
    told = read_trajectory(odometry)
    late = tmp_path / "late.txt"
    write_tum(late, Trajectory(told.times + 1e6, told.positions, told.quaternions_xyzw))
    ended = maxcon(
        "localize", drive.city, dense.scans, "--prior", dense.prior, "--track", "--odometry", late,
        "-o", tmp_path / "p.csv",
    )  # fmt: skip
    assert ended.code == 2
    assert "late.txt" in ended.err and "Expected an odometry pose" in ended.err
