"""`maxcon relocalize`: a drive is found without its prior; what cannot work is one line."""

import json
import math

import numpy as np
import pytest

from localized_poses import rows_of
from maxcon.drive.poses_table import COLUMNS
from maxcon.io.trajectories import read_trajectory


@pytest.fixture
def relocalize(maxcon, drive):
    """Relocalize the drive, or other scans, in the city or another map."""

    def run(*options, scans=drive.dataset.scans, city=drive.city):
        return maxcon("relocalize", city, scans, *options)

    return run


@pytest.fixture
def place(drive):
    """Where the first scan was taken."""
    return drive.reference.at(float(drive.reference.times[0]), 0.5)


def test_a_drive_is_found_without_its_prior_and_gone_on_with(relocalize, drive, tmp_path):
    table, tum = tmp_path / "poses.csv", tmp_path / "poses.tum"
    ended = relocalize("-o", table, "--tum", tum)
    assert (ended.code, ended.err) == (0, ""), ended
    assert "4 of 4 epochs localized" in ended.out
    assert "searched without a prior: the whole map" in ended.out
    rows = rows_of(table)
    assert tuple(rows[0]) == COLUMNS
    for row in rows:
        truth = drive.reference.at(float(row["time"]), 0.5)
        assert math.hypot(float(row["x"]) - truth.x, float(row["y"]) - truth.y) < 0.1
        assert float(row["protection_along"]) < 0.5
    assert len(read_trajectory(tum).times) == 4
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:4]))
    ended = relocalize("-o", table, "--resume", "--threads", "2", "--json")
    told = json.loads(ended.out)
    assert (ended.code, told["epochs"], told["epochs_before"]) == (0, 1, 3)
    assert told["searched"].startswith("searched without a prior: the whole map")
    assert rows_of(table) == rows


def test_without_a_table_a_line_is_printed_for_each(relocalize, place):
    ended = relocalize("--around", f"{place.x:.1f},{place.y:.1f}", "--radius", "60")
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert len(lines) == 4 and all(": localized; x 5" in line for line in lines)


def test_epochs_without_an_answer_are_rows_with_their_status(relocalize, drive, place, tmp_path):
    scans, table = tmp_path / "scans", tmp_path / "poses.csv"
    scans.mkdir()
    (scans / "000000.bin").write_bytes(b"no scan")
    (scans / "000001.bin").write_bytes((drive.dataset.scans / "000001.bin").read_bytes())
    np.savetxt(scans / "times.txt", drive.reference.times[:2], fmt="%.9f")
    elsewhere = ("--around", f"{place.x + 25.0:.1f},{place.y:.1f}", "--radius", "4")
    ended = relocalize("-o", table, *elsewhere, scans=scans)
    assert ended.code == 1 and "0 of 2 epochs localized" in ended.out
    first, second = rows_of(table)
    assert first["status"] == "unreadable scan"
    assert second["status"] not in ("localized", "unreadable scan") and second["x"] == ""


@pytest.mark.parametrize(("options", "words"), [
    ("--radius 50", ("--radius together with --around X,Y",)),
    ("--around nan,3", ("--around X,Y",)),
    ("--around 1,2", ("within 300 m", "CRS")),
    ("--tum x.tum", ("--tum together with --out",)),
])  # fmt: skip
def test_slips_are_one_line(relocalize, refused, options, words):
    refused(relocalize(*options.split()), *words)
