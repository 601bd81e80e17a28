# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv: what is written reads back, and only localized epochs have a pose."""

import csv
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from court_drive import POSE, START, made_epoch

from maxcon import Pose, Status
from maxcon.drive.poses_table import COLUMNS, GrowingTable, localized_trajectory, rows_there, write_poses
from maxcon.errors import FileError
from maxcon.io.trajectories import read_trajectory


def test_the_table_reads_back_as_a_trajectory(tmp_path):
    turned = Pose(POSE.x + 10.0, POSE.y, POSE.z, -0.01, 0.02, -math.pi)
    write_poses(tmp_path / "poses.csv", [made_epoch(0), made_epoch(1, pose=turned)])
    found = read_trajectory(tmp_path / "poses.csv")
    np.testing.assert_allclose(found.times, [START, START + 1], rtol=0, atol=1e-9)
    for read, written in zip(found.poses(), (POSE, turned), strict=True):
        np.testing.assert_allclose(read.position, written.position, rtol=0, atol=5e-5)
        np.testing.assert_allclose(read.rotation, written.rotation, rtol=0, atol=1e-8)


def test_columns_and_text(tmp_path):
    write_poses(tmp_path / "poses.csv", [made_epoch(0)])
    header, row = (tmp_path / "poses.csv").read_text().splitlines()
    assert header.split(",") == list(COLUMNS)
    assert header.startswith("time,x,y,z,roll,pitch,heading,score,status,ms,protection_along,protection_across,cov_x_x")
    assert header.endswith("cov_pitch_heading,cov_heading_heading,reason")
    assert len(COLUMNS) == 10 + 2 + 21 + 1
    assert row == (
        "386400.123456789,549936.5193,5801960.0921,62.0056,"
        "0.001234568,-0.004494209,3.043043369,256.077,localized,12.35," + 23 * ","
    )


def test_the_covariance_is_written_as_its_upper_triangle(tmp_path):
    half = np.triu(np.arange(36.0).reshape(6, 6) + 1.0)
    epoch = made_epoch(0)
    sure = replace(epoch.estimate, covariance=half + np.triu(half, 1).T, protection_level=(0.12345, math.inf))
    write_poses(tmp_path / "poses.csv", [replace(epoch, estimate=sure)])
    with (tmp_path / "poses.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["protection_along"], row["protection_across"]) == ("0.1235", "")
    assert (row["cov_x_x"], row["cov_x_y"], row["cov_y_y"], row["cov_heading_heading"]) == ("1", "2", "8", "36")
    assert [float(row[name]) for name in COLUMNS if name.startswith("cov_")] == half[np.triu_indices(6)].tolist()


def test_a_reason_of_many_words_is_read_back_and_does_not_disturb_the_others(tmp_path):
    reason = 'Expected a "scan", got 3 bytes,\nof 16. Copy it again.'
    write_poses(tmp_path / "poses.csv", [made_epoch(0), replace(made_epoch(1), reason=reason)])
    with (tmp_path / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["reason"] for row in rows] == ["", 'Expected a "scan", got 3 bytes, of 16. Copy it again.']
    assert len(read_trajectory(tmp_path / "poses.csv")) == 2


@pytest.mark.parametrize("status", list(Status))
def test_only_localized_epochs_have_a_pose(tmp_path, status):
    write_poses(tmp_path / "poses.csv", [made_epoch(0, status)])
    with (tmp_path / "poses.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["status"] == status.value
    has_pose = {row[name] != "" for name in COLUMNS[1:7]}
    assert has_pose == {status is Status.LOCALIZED}
    assert (row["score"] != "") == (status not in (Status.NO_PRIOR, Status.NO_POINTS, Status.OUTSIDE_MAP))


def test_epochs_without_a_pose_are_passed_over_when_read(tmp_path):
    write_poses(tmp_path / "poses.csv", [made_epoch(0, Status.NO_PRIOR), made_epoch(1), made_epoch(2, Status.AT_RIM)])
    assert len(read_trajectory(tmp_path / "poses.csv")) == 1


def test_the_trajectory_of_the_localized_epochs():
    assert localized_trajectory([]) is None
    assert localized_trajectory([made_epoch(0, Status.NO_MATCH)]) is None
    found = localized_trajectory([made_epoch(0), made_epoch(1, Status.UNDETERMINED), made_epoch(2)])
    np.testing.assert_array_equal(found.times, [START, START + 2])
    np.testing.assert_array_equal(found.positions[0], POSE.position)


def test_the_table_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "poses.csv"
    write_poses(path, [made_epoch(0)])
    before = path.read_bytes()
    with pytest.raises(AttributeError):
        write_poses(path, [made_epoch(0), None])
    assert path.read_bytes() == before
    with pytest.raises(FileError, match=r"poses\.csv, got: No such file or directory.*nothing was written"):
        write_poses(tmp_path / "missing" / "poses.csv", [made_epoch(0)])
    assert [name.name for name in tmp_path.iterdir()] == ["poses.csv"]


def test_a_reason_in_any_letters_is_written_the_same_under_any_locale(tmp_path):
    script = (
        "from test_poses_table import made_epoch, replace, write_poses; import sys;"
        "write_poses(sys.argv[1], [replace(made_epoch(0), reason='Stra\\u00dfe')])"
    )
    plain = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONPATH": str(Path(__file__).parent)}
    plain["PYTHONPATH"] += os.pathsep + os.environ.get("PYTHONPATH", "")
    subprocess.run([sys.executable, "-c", script, tmp_path / "p.csv"], env=os.environ | plain, check=True)
    assert (tmp_path / "p.csv").read_bytes().endswith("Straße\r\n".encode())
    assert rows_there(tmp_path / "p.csv", np.array([START])).n_rows == 1


def test_another_process_at_the_same_table_is_refused(tmp_path):
    path = tmp_path / "poses.csv"
    with GrowingTable(path) as one, GrowingTable(path) as other:
        one.add(made_epoch(0))
        with pytest.raises(FileError, match="another process is at work on it"):
            other.add(made_epoch(0))
    assert len(path.read_text().splitlines()) == 2
    assert [name.name for name in tmp_path.iterdir()] == ["poses.csv"]


def test_rows_go_on_behind_those_that_are_whole(tmp_path):
    path, times = tmp_path / "poses.csv", np.array([made_epoch(number).raw.time for number in range(3)])
    write_poses(path, [made_epoch(number) for number in range(3)])
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])  # killed in the third row
    there = rows_there(path, times)
    assert (there.n_rows, there.n_localized) == (2, 2)
    with GrowingTable(path, there) as table:
        table.add(made_epoch(2))
    assert path.read_bytes() == whole
    with GrowingTable(path, there) as table, pytest.raises(FileError, match="it has grown"):
        table.add(made_epoch(2))
