# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The commands of the README, one after the other, each in a process of its own."""

import csv

import numpy as np
import pytest

from maxcon.drive.poses_table import COLUMNS
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset


@pytest.fixture(scope="module")
def road(tmp_path_factory, maxcon_in_process_of_its_own):
    """Simulate, build, inform and localize in one folder; what each printed."""
    folder = tmp_path_factory.mktemp("road")
    printed = {}

    def run(name, *arguments):
        ended = maxcon_in_process_of_its_own(*arguments, cwd=folder)
        assert (ended.code, ended.err) == (0, ""), ended
        printed[name] = ended.out

    run("simulate", "simulate", "dataset", "--epochs", "3", "--seed", "7")
    clouds = sorted((folder / "dataset" / "map").glob("*.laz"))
    arguments = ("--trajectory", "dataset/map/trajectory.txt", "--vehicle-class", "64", "--sigma", "0")
    arguments = (*arguments, "-o", "city.map")
    run("build", "map", "build", *clouds, *arguments)
    run("info", "map", "info", "city.map", "--check")
    prior = ("--prior", "dataset/prior.txt")
    run("localize", "localize", "city.map", "dataset/scans", *prior, "-o", "poses.csv", "--tum", "poses.txt")
    return folder, printed


def test_simulate_says_what_it_wrote(road):
    folder, printed = road
    dataset = Dataset.open(folder / "dataset")
    assert printed["simulate"].splitlines()[0] == "dataset"
    assert f"({len(dataset.map_clouds)} files, vehicles are class 64)" in printed["simulate"]
    assert "map sigma    0 m (map build --sigma 0)\n" in printed["simulate"]
    for path in ("dataset/map/trajectory.txt", "dataset/scans", "dataset/reference.txt", "dataset/prior.txt"):
        assert path in printed["simulate"]
        assert (folder / path).exists()


def test_map_build_says_what_the_map_is_made_of(road):
    folder, printed = road
    assert printed["build"].startswith("city.map\n")
    assert printed["build"].removeprefix("city.map\n") == printed["info"].partition("checked")[0]
    for words in (
        "0.06 m",
        "ETRS89 / UTM zone 32N (EPSG:25832)",
        "turned to the sensor's side",
        "sigma        0 m, given\n",
        " ground",
        "class 64",
    ):
        assert words in printed["info"]
    n_clouds = len(list((folder / "dataset" / "map").glob("*.laz")))
    assert sum(line.startswith("source") for line in printed["info"].splitlines()) == n_clouds
    assert "tiles are as they were written" in printed["info"]


def test_every_epoch_is_localized_within_a_cell(road):
    folder, printed = road
    assert printed["localize"].startswith("3 of 3 epochs localized, median ")
    assert "written to poses.csv" in printed["localize"]
    reference = read_trajectory(folder / "dataset" / "reference.txt")
    with (folder / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(COLUMNS)
    assert [row["status"] for row in rows] == ["localized"] * 3
    assert all(float(row["ms"]) > 0.0 and float(row["score"]) > 1.0 for row in rows)
    for found in (read_trajectory(folder / "poses.csv"), read_trajectory(folder / "poses.txt")):
        np.testing.assert_allclose(found.times, reference.times, atol=1e-6)
        assert np.abs(found.positions[:, :2] - reference.positions[:, :2]).max() < 0.06
        turns = np.angle(np.exp(1j * (found.angles[:, 2] - reference.angles[:, 2])))
        assert np.abs(np.degrees(turns)).max() < 0.5


def test_nothing_else_is_left(road):
    folder, _ = road
    assert sorted(path.name for path in folder.iterdir()) == ["city.map", "dataset", "poses.csv", "poses.txt"]
    assert sorted(path.name for path in (folder / "city.map").iterdir()) == ["ground", "manifest.json", "tiles"]
