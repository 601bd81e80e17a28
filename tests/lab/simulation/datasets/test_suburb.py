# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The suburb on disk: whole, the same for the same seed, and good enough to localize in."""

import laspy
import numpy as np
import pytest

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.errors import OptionError
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import LasClass, ProfileScanner, SuburbWorld, simulate_suburb
from maxcon.mapping.build import build_map

PROFILES = tuple(ProfileScanner(turn_deg=turn, line_rate=60.0, points_per_line=600) for turn in (45.0, -45.0))
THINNEST = (ProfileScanner(line_rate=2.0, points_per_line=30),)


def _scan(dataset, number):
    return np.fromfile(dataset.scans / f"{number:06d}.bin", dtype="<f4").reshape(-1, 4)


@pytest.fixture
def built(monkeypatch, suburb):
    """The world is there already: building it is not what is tested."""
    monkeypatch.setattr(SuburbWorld, "build", lambda *_: suburb)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, suburb):
    out = tmp_path_factory.mktemp("suburb") / "dataset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SuburbWorld, "build", lambda *_: suburb)
        return simulate_suburb(out, n_epochs=3, seed=3, road_length=60.0, mapping_scanners=PROFILES)


def test_it_says_what_it_is(dataset):
    assert ": suburb, seed 3, 3 epochs." in (dataset.folder / "dataset.toml").read_text().splitlines()[0]
    assert list(dataset.priors) == ["gnss", "uniform"]
    assert dataset.map_sigma is None  # its rounds say
    assert Dataset.open(dataset.folder) == dataset
    times = np.loadtxt(dataset.scans / "times.txt")
    for path in (dataset.reference, *dataset.priors.values()):
        np.testing.assert_array_equal(read_trajectory(path).times, times)


def test_the_map_has_classes_and_hedges_without_one(dataset):
    classes = np.concatenate([np.asarray(laspy.read(path).classification) for path in dataset.map_clouds])
    counts = np.bincount(classes, minlength=66)
    assert counts[LasClass.GROUND] > counts[LasClass.BUILDING] > 0
    assert counts[LasClass.UNCLASSIFIED] > 0.05 * len(classes)


def test_same_seed_same_files(tmp_path, thin_scanner, monkeypatch, suburb):
    options = {"n_epochs": 2, "seed": 3, "road_length": 60.0, "mapping_scanners": THINNEST}
    built_again = simulate_suburb(tmp_path / "again", **options, scanner=thin_scanner)
    monkeypatch.setattr(SuburbWorld, "build", lambda *_: suburb)
    first = simulate_suburb(tmp_path / "first", **options, scanner=thin_scanner)
    names = sorted(str(path.relative_to(first.folder)) for path in first.folder.rglob("*") if path.is_file())
    assert len(names) > 8
    for name in names:
        if not name.endswith(".laz"):
            assert (first.folder / name).read_bytes() == (built_again.folder / name).read_bytes(), name
    for one, other in zip(first.map_clouds, built_again.map_clouds, strict=True):
        np.testing.assert_array_equal(laspy.read(one).xyz, laspy.read(other).xyz)


@pytest.mark.usefixtures("built")
def test_fewer_epochs_are_the_same_scans(dataset, tmp_path):
    fewer = simulate_suburb(tmp_path / "fewer", n_epochs=2, seed=3, road_length=60.0, mapping_scanners=THINNEST)
    np.testing.assert_array_equal(_scan(fewer, 1), _scan(dataset, 2))
    for name in ("gnss", "uniform"):
        few, many = (read_trajectory(data.priors[name]) for data in (fewer, dataset))
        np.testing.assert_array_equal(few.positions, many.positions[[0, 2]])


def test_an_epoch_is_localized(dataset, tmp_path):
    build_map(dataset.map_clouds, tmp_path / "suburb.map", dataset.map_options())
    point_map = PointMap.open(tmp_path / "suburb.map")
    reference, priors = (read_trajectory(path) for path in (dataset.reference, dataset.priors["uniform"]))
    origin = -np.asarray(point_map.frame.origin)
    prior, wanted = (poses.pose(1).translated(origin) for poses in (priors, reference))
    estimate = MaximumConsensus(SearchSpace.paper()).localize(Scan(_scan(dataset, 1)[:, :3]), point_map, prior)
    assert np.hypot(estimate.pose.x - wanted.x, estimate.pose.y - wanted.y) < 0.15


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"n_epochs": 0}, "Expected 1 to 601 epochs of a suburb, got n_epochs = 0"),
        ({"n_epochs": 602}, "Expected 1 to 601 epochs"),
        ({"seed": -1}, "Expected a seed of 0 or more, got -1"),
        ({"n_epochs": 1, "road_length": 10.0}, "Expected a road of 60 to 2000 m"),
    ],
)
def test_wrong_options_are_refused(tmp_path, wrong, words):
    with pytest.raises(OptionError, match=words):
        simulate_suburb(tmp_path / "out", **wrong)
    assert list(tmp_path.iterdir()) == []
