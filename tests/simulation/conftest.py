# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One small world and one small dataset, built once."""

import pytest

from maxcon.simulation import ProfileScanner, SimulatedWorld, simulate

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
    return world.map_caster.city


@pytest.fixture
def thin_profiles():
    return THIN_PROFILES


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulated") / "dataset"
    return simulate(out, n_epochs=3, seed=SEED, before=30.0, after=20.0, mapping_scanners=THIN_PROFILES)
