# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A small simulated drive, and what a study made of it, once for all tests."""

import shutil

import pytest

from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import PriorErrors, ProfileScanner, simulate
from maxcon.lab.study import choose_methods, run_study
from maxcon.search.space import SearchSpace

N_EPOCHS = 6
SMALL_SPACE = SearchSpace(1.2, 0.06, 1.0, 0.5)
METHODS = ("count-points", "helmert-points", "helmert-occupied", "icp-plane-1m", "icp-plane-1m-5x5")


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    scanners = (
        ProfileScanner(turn_deg=45.0, line_rate=50.0, points_per_line=480),
        ProfileScanner(turn_deg=-45.0, line_rate=50.0, points_per_line=480),
    )
    out = tmp_path_factory.mktemp("study") / "dataset"
    return simulate(
        out, n_epochs=N_EPOCHS, seed=5, before=30.0, after=20.0, mapping_scanners=scanners,
        prior_errors=PriorErrors(offset=1.0, heading_deg=0.8),
    )  # fmt: skip


@pytest.fixture(scope="session")
def small_space():
    return SMALL_SPACE


@pytest.fixture(scope="session")
def methods():
    return choose_methods(METHODS, SMALL_SPACE)


@pytest.fixture(scope="session")
def study(simulated, methods, tmp_path_factory):
    return run_study(simulated, tmp_path_factory.mktemp("studies") / "study", methods, n_workers=1)


@pytest.fixture
def copied(simulated, study, tmp_path):
    """A copy of the dataset to spoil, with its map built already."""
    shutil.copytree(simulated.folder, tmp_path / "dataset", ignore=shutil.ignore_patterns("*.laz"))
    shutil.copytree(study.folder / "maps" / "standard.map", tmp_path / "dataset" / "city.map")
    description = (tmp_path / "dataset" / "dataset.toml").read_text()
    description = description.replace('clouds = "map/tile_*.laz"', 'path = "city.map"')
    lines = [
        line for line in description.splitlines() if not line.startswith(("trajectory", "crs", "vehicle", "sigma"))
    ]
    description = "\n".join(lines) + "\n"
    (tmp_path / "dataset" / "dataset.toml").write_text(description)
    return Dataset.open(tmp_path / "dataset")
