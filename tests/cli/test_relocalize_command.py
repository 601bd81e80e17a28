# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon relocalize`: a drive is found without its prior; what cannot work is one line."""

import csv
import math

import numpy as np
import pytest

from maxcon.drive.poses_table import COLUMNS
from maxcon.io.trajectories import read_trajectory


@pytest.fixture(scope="module")
def searched(maxcon_in_process_of_its_own, drive, tmp_path_factory):
    """The drive looked for in the whole map, once for all: how that ended, and the folder of its tables."""
    folder = tmp_path_factory.mktemp("searched")
    tables = ("-o", folder / "poses.csv", "--tum", folder / "poses.tum")
    ended = maxcon_in_process_of_its_own("relocalize", drive.city, drive.dataset.scans, *tables)
    return ended, folder


@pytest.fixture
def relocalize(maxcon, drive):
    """Relocalize the drive, or other scans, in the city or another map."""

    def run(*options, scans=None, city=None):
        return maxcon("relocalize", city or drive.city, scans or drive.dataset.scans, *options)

    return run


def _rows(path):
    with path.open() as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert tuple(reader.fieldnames) == COLUMNS
    return rows


def test_a_drive_is_found_without_its_prior(searched, drive):
    ended, folder = searched
    assert (ended.code, ended.err) == (0, ""), ended
    assert "4 of 4 epochs localized" in ended.out
    assert "searched without a prior: the whole map" in ended.out
    for row in _rows(folder / "poses.csv"):
        truth = drive.reference.at(float(row["time"]), 0.5)
        assert math.hypot(float(row["x"]) - truth.x, float(row["y"]) - truth.y) < 0.1
        assert float(row["protection_along"]) < 0.5
    assert len(read_trajectory(folder / "poses.tum").times) == 4


def test_it_goes_on_with_a_table(relocalize, searched, tmp_path):
    whole, out = searched[1] / "poses.csv", tmp_path / "poses.csv"
    rows = _rows(whole)
    out.write_text("".join(whole.read_text().splitlines(keepends=True)[:3]))
    ended = relocalize("-o", out, "--resume", "--threads", "2")
    assert ended.code == 0
    assert [row | {"ms": ""} for row in _rows(out)] == [row | {"ms": ""} for row in rows]


def test_without_a_table_a_line_is_printed_for_each(relocalize, drive):
    truth = drive.reference.at(float(drive.reference.times[0]), 0.5)
    ended = relocalize("--around", f"{truth.x:.1f},{truth.y:.1f}", "--radius", "60")
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert len(lines) == 4
    assert all(": localized; x 5" in line for line in lines)


def test_in_another_place_the_exit_code_is_1_and_the_table_has_no_pose(relocalize, drive, tmp_path):
    truth = drive.reference.at(float(drive.reference.times[0]), 0.5)
    ended = relocalize("-o", tmp_path / "poses.csv", "--around", f"{truth.x + 25.0:.1f},{truth.y:.1f}", "--radius", "4")
    assert ended.code == 1, ended
    rows = _rows(tmp_path / "poses.csv")
    assert all(row["status"] != "localized" and row["x"] == "" for row in rows)
    assert "0 of 4 epochs localized" in ended.out


def test_a_scan_that_cannot_be_read_is_a_row(relocalize, drive, tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    names = sorted(path for path in drive.dataset.scans.iterdir() if path.suffix == ".bin")[:2]
    (scans / names[0].name).write_bytes(b"no scan")
    (scans / names[1].name).write_bytes(names[1].read_bytes())
    np.savetxt(scans / "times.txt", drive.reference.times[:2], fmt="%.9f")
    ended = relocalize("-o", tmp_path / "poses.csv", scans=scans)
    assert ended.code == 1
    assert [row["status"] for row in _rows(tmp_path / "poses.csv")] == ["unreadable scan", "localized"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--radius", "50"), ("--around",)),
        (("--around", "5"), ("--around X,Y", "'5'")),
        (("--around", "nan,3"), ("--around X,Y",)),
        (("--around", "1,2"), ("within 300 m", "CRS")),
        (("--around", "1,2", "--radius", "-5"), ("radius",)),
        (("--resume",), ("--out",)),
        (("--tum", "x.tum"), ("--out",)),
        (("--risk", "2"), ("risk",)),
        (("--min-range", "9", "--max-range", "3"), ("max",)),
    ],
)
def test_slips_are_one_line(relocalize, refused, options, words):
    refused(relocalize(*options), *words)


def test_a_table_that_is_there_is_not_replaced(relocalize, refused, tmp_path):
    (tmp_path / "poses.csv").write_text("mine")
    refused(relocalize("-o", tmp_path / "poses.csv"), "--overwrite")
    assert (tmp_path / "poses.csv").read_text() == "mine"


def test_what_is_no_map_and_what_is_no_folder_of_scans_is_said(relocalize, refused, tmp_path):
    refused(relocalize(city=tmp_path), tmp_path)
    refused(relocalize(scans=tmp_path / "none"), "none")
