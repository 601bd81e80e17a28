# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One small world and one small dataset, the two campaigns, and a piece of a suburb, built once."""

import sys

import pytest

from maxcon.cli import main
from maxcon.lab.simulation import CampaignWorld, ProfileScanner, RotatingScanner, SimulatedWorld, SuburbWorld, simulate

SEED = 3
THIN_PROFILES = (
    ProfileScanner(turn_deg=45.0, line_rate=25.0, points_per_line=300),
    ProfileScanner(turn_deg=-45.0, line_rate=25.0, points_per_line=300),
)


@pytest.fixture(scope="session")
def world():
    return SimulatedWorld.build(SEED, before=30.0, after=20.0)


@pytest.fixture(scope="session")
def city(world):
    return world.mapping.caster.city


@pytest.fixture
def thin_profiles():
    return THIN_PROFILES


@pytest.fixture
def thinnest_profiles():
    """A profile scanner of so few points that its map is of no use, but written at once."""
    return (ProfileScanner(line_rate=2.0, points_per_line=30),)


@pytest.fixture
def simulate_command(monkeypatch, capsys):
    """Run `maxcon simulate` in this process; return its exit code and what it printed."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["maxcon", "simulate", *map(str, arguments)])
        try:
            main()
        except SystemExit as ended:
            return ended.code or 0, capsys.readouterr()
        return 0, capsys.readouterr()

    return call


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulated") / "dataset"
    return simulate(out, n_epochs=3, seed=SEED, before=30.0, after=20.0, mapping_scanners=THIN_PROFILES)


@pytest.fixture(scope="session")
def campaign():
    return CampaignWorld.build(SEED)


@pytest.fixture(scope="session")
def hard_campaign():
    return CampaignWorld.build(SEED, 1, is_hard=True)


@pytest.fixture(scope="session")
def suburb():
    return SuburbWorld.build(SEED, 60.0)


@pytest.fixture(scope="session")
def thin_scanner():
    """A VLP-16 with a tenth of the points."""
    return RotatingScanner(azimuth_step_deg=2.0)
