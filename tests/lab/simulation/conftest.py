"""One small world and one small dataset, the two campaigns, and a piece of a suburb, built once."""

import pytest

from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.scanners import ProfileScanner, RotatingScanner
from maxcon.lab.simulation.worlds import CampaignWorld, SimulatedWorld, SuburbWorld

SEED = 3
THIN_PROFILES = tuple(ProfileScanner(turn_deg=turn, line_rate=25.0, points_per_line=300) for turn in (45.0, -45.0))


@pytest.fixture(scope="session")
def world():
    return SimulatedWorld.build(SEED, before=30.0, after=20.0)


@pytest.fixture(scope="session")
def city(world):
    return world.mapping.caster.city


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


@pytest.fixture(scope="session")
def small():
    """Options of the small dataset."""
    return {"n_epochs": 3, "seed": SEED, "before": 30.0, "after": 20.0, "mapping_scanners": THIN_PROFILES}


@pytest.fixture(scope="session")
def dataset(built_once, small):
    folder = built_once("simulated", lambda folder: simulate(folder / "dataset", **small))
    return Dataset.open(folder / "dataset")
