"""A small simulated drive, and what a study made of it, once for all tests."""

import shutil

import pytest

from maxcon.lab.baselines import Icp, MultiStart
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import PriorErrors, simulate
from maxcon.lab.simulation.scanners import ProfileScanner
from maxcon.lab.study import Study, StudyMethod, choose_methods, run_study
from maxcon.search.space import SearchSpace

N_EPOCHS = 6
SMALL_SPACE = SearchSpace(1.2, 0.06, 1.0, 0.5)
METHODS = ("count-points", "helmert-points", "helmert-occupied", "icp-plane-1m")
MANY = StudyMethod("icp-plane-1m-5x5", MultiStart(Icp("plane", 1.0, thinning=3.0)), around_reference=True)
"""Of that name, but of fewer points."""


@pytest.fixture(scope="session")
def small_space():
    return SMALL_SPACE


@pytest.fixture(scope="session")
def methods():
    return [*choose_methods(METHODS, SMALL_SPACE), MANY]


@pytest.fixture(scope="session")
def _studied(built_once, methods):
    def make(folder):
        scanners = [ProfileScanner(turn_deg=turn, line_rate=50.0, points_per_line=480) for turn in (45.0, -45.0)]
        dataset = simulate(
            folder / "dataset", n_epochs=N_EPOCHS, seed=5, before=30.0, after=20.0, mapping_scanners=tuple(scanners),
            prior_errors=PriorErrors(offset=1.0, heading_deg=0.8),
        )  # fmt: skip
        run_study(dataset, folder / "study", methods, n_workers=1)

    return built_once("study", make)


@pytest.fixture(scope="session")
def simulated(_studied):
    return Dataset.open(_studied / "dataset")


@pytest.fixture(scope="session")
def study(_studied):
    return Study.open(_studied / "study")


@pytest.fixture
def copied(simulated, study, tmp_path):
    """A copy of the dataset to spoil, with its map built already."""
    folder = tmp_path / "dataset"
    shutil.copytree(simulated.folder, folder, ignore=shutil.ignore_patterns("*.laz"))
    shutil.copytree(study.folder / "maps" / "standard.map", folder / "city.map")
    lines = simulated.path.read_text().replace('clouds = "map/tile_*.laz"', 'path = "city.map"').splitlines()
    of_clouds = ("trajectory", "crs", "vehicle", "sigma")
    (folder / "dataset.toml").write_text("\n".join(line for line in lines if not line.startswith(of_clouds)) + "\n")
    return Dataset.open(folder)


@pytest.fixture
def tried(copied, tmp_path, small_space):
    """Run a study of the copied dataset in this process: of the best cell by Helmert's score, if nothing is said."""

    def run(methods=("helmert-occupied",), dataset=copied, **options):
        chosen = choose_methods(methods, small_space) if isinstance(methods[0], str) else methods
        return run_study(dataset, tmp_path / "study", chosen, **{"n_workers": 1, **options})

    return run
