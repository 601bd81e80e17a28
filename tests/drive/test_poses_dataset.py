# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The dataset of poses: rows wait in parts, a drive is published whole, and what is read back is what was found."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from court_drive import POSE, made_epoch

from maxcon import Status
from maxcon.drive.poses_dataset import PosesDataset, poses_schema
from maxcon.drive.poses_table import COVARIANCES, FORMATS, write_poses
from maxcon.errors import FileError, OptionError

SOME = np.random.default_rng(0).normal(0.0, 0.03, (9, 6))


def epoch(number, status=Status.LOCALIZED):
    """With a covariance, and a protection level that is known along the heading only."""
    made = made_epoch(number, status, covariance=SOME.T @ SOME, protection_level=(0.1234567, math.inf))
    return replace(made, reason="a\nreason")


def test_rows_are_published_once_and_whole(tmp_path):
    dataset = PosesDataset(tmp_path)
    assert not dataset.has_any_rows()
    dataset.add("a", [epoch(2), epoch(3, Status.AMBIGUOUS)])
    dataset.add("a", [epoch(0), epoch(1)])
    dataset.add("a", [epoch(1)])  # done twice, as after a kill
    assert (dataset.has_rows("a"), dataset.is_done("a"), dataset.has_any_rows()) == (True, False, True)
    waiting = dataset.rows("a")
    assert waiting.column("epoch").to_pylist() == [0, 1, 2, 3]
    dataset.publish("a")
    assert dataset.is_done("a") and not (tmp_path / "_parts").exists()
    assert dataset.rows("a").equals(waiting)
    assert waiting.schema.equals(poses_schema())
    assert dataset.statuses("a") == ["localized", "localized", "localized", "ambiguous"]


def test_rows_are_those_of_the_table_of_poses_before_rounding(tmp_path):
    epochs = [epoch(0), epoch(1, Status.AMBIGUOUS)]
    dataset = PosesDataset(tmp_path)
    dataset.add("a", epochs)
    write_poses(tmp_path / "poses.csv", epochs)
    with (tmp_path / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = dataset.rows("a").to_pylist()
    assert found[0]["x"] == POSE.x and rows[0]["x"] == "549936.5193"
    assert (found[0]["protection_along"], found[0]["protection_across"]) == (0.1234567, None)
    assert found[0][COVARIANCES[0]] == (SOME.T @ SOME)[0, 0]
    assert found[1]["x"] is None and found[1]["score"] == 256.0771 and found[1]["reason"] == "a reason"
    for numbers, cells in zip(found, rows, strict=True):
        del numbers["epoch"]
        assert {name: format_of(name, value) for name, value in numbers.items()} == cells


def format_of(name, value):
    return "" if value is None else format(value, FORMATS.get(name, ""))


@pytest.mark.parametrize("is_done", [True, False])
def test_a_broken_file_is_named(tmp_path, is_done):
    dataset = PosesDataset(tmp_path)
    dataset.add("a", [epoch(0)])
    if is_done:
        dataset.publish("a")
    (path,) = tmp_path.rglob("*.parquet")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FileError, match=f"Expected poses of a drive in {path}.*remove it"):
        dataset.rows("a")
    if is_done:
        with pytest.raises(FileError, match=f"Expected poses of a drive in {path}"):
            dataset.statuses("a")


UNREADABLE = Path("/proc/self/mem")


@pytest.mark.skipif(not UNREADABLE.exists(), reason="no file here that is there and cannot be read")
def test_a_prior_that_cannot_be_read_keeps_no_other_drive_from_its_own(tmp_path):
    sources = {name: {"map": tmp_path, "prior": prior} for name, prior in (("broken", UNREADABLE), ("whole", None))}
    for _ in range(2):
        PosesDataset(tmp_path).check_sources(sources)
    assert '"broken"' in (tmp_path / "_drives.json").read_text()


@pytest.mark.parametrize(("name", "check"), [("_options.json", "check_options"), ("_drives.json", "check_sources")])
@pytest.mark.parametrize("content", [b"{", b"[]", b'{"a": 1}', b"\xff"])
def test_provenance_that_is_none_is_refused(tmp_path, name, check, content):
    dataset = PosesDataset(tmp_path)
    dataset.add("a", [epoch(0)])
    (tmp_path / name).write_bytes(content)
    with pytest.raises((FileError, OptionError), match=rf"{name}.*[Nn]ame another folder"):
        getattr(dataset, check)({})
