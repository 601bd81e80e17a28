# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The commands of the README, one after the other, in one folder."""

from functools import partial

import numpy as np
import pytest

from localized_poses import rows_of
from maxcon.drive.poses_table import COLUMNS
from maxcon.io.trajectories import read_trajectory
from maxcon.lab import simulation


@pytest.fixture
def run(maxcon, thin_profiles, tmp_path, monkeypatch):
    """Run a command in the folder; what it printed. Of the city to simulate only a part is mapped, with few points."""
    part = partial(simulation.simulate, before=30.0, after=20.0, mapping_scanners=thin_profiles)
    monkeypatch.setattr(simulation, "simulate", part)
    monkeypatch.chdir(tmp_path)

    def printed(*arguments):
        ended = maxcon(*arguments)
        assert (ended.code, ended.err) == (0, ""), ended
        return ended.out

    return printed


def test_from_nothing_to_poses(run, tmp_path):
    printed = run("simulate", "dataset", "--epochs", "3", "--seed", "7", "--recording", "mcap")
    clouds = sorted((tmp_path / "dataset" / "map").glob("*.laz"))
    assert printed.splitlines()[0] == "dataset"
    assert f"({len(clouds)} files, vehicles are class 64)" in printed
    assert "map sigma    0 m (map build --sigma 0)\n" in printed
    for name in ("map/trajectory.txt", "scans", "reference.txt", "prior.txt", "drive.mcap"):
        assert f"dataset/{name}" in printed and (tmp_path / "dataset" / name).exists()
    assert "/points: 3 scans" in run("scans", "info", "dataset/drive.mcap")

    given = ("--trajectory", "dataset/map/trajectory.txt", "--vehicle-class", "64", "--sigma", "0")
    built = run("map", "build", *clouds, *given, "-o", "city.map")
    info = run("map", "info", "city.map", "--check")
    assert built == f"city.map\n{info.partition('checked')[0]}"
    utm, sided = "ETRS89 / UTM zone 32N (EPSG:25832)", "turned to the sensor's side"
    for words in ("0.06 m", utm, sided, "sigma        0 m, given\n", " ground", "class 64", "are as they were written"):
        assert words in info
    assert sum(line.startswith("source") for line in info.splitlines()) == len(clouds)

    files = ("--prior", "dataset/prior.txt", "-o", "poses.csv", "--tum", "poses.txt")
    printed = run("localize", "city.map", "dataset/scans", *files)
    assert printed.startswith("3 of 3 epochs localized, median ") and "written to poses.csv" in printed
    reference, rows = read_trajectory(tmp_path / "dataset" / "reference.txt"), rows_of(tmp_path / "poses.csv")
    assert list(rows[0]) == list(COLUMNS)
    assert [row["status"] for row in rows] == ["localized"] * 3
    assert all(float(row["score"]) > 1.0 for row in rows)
    for found in (read_trajectory(tmp_path / "poses.csv"), read_trajectory(tmp_path / "poses.txt")):
        np.testing.assert_allclose(found.times, reference.times, atol=1e-6)
        assert np.abs(found.positions[:, :2] - reference.positions[:, :2]).max() < 0.06
        turns = np.angle(np.exp(1j * (found.angles[:, 2] - reference.angles[:, 2])))
        assert np.abs(np.degrees(turns)).max() < 0.5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["city.map", "dataset", "poses.csv", "poses.txt"]
    assert sorted(path.name for path in (tmp_path / "city.map").iterdir()) == ["ground", "manifest.json", "tiles"]
