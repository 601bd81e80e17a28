"""Datasets on disk: readable, whole or absent, the same for the same seed, and true; `maxcon simulate`."""

from dataclasses import replace
from unittest.mock import ANY, Mock

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.errors import OptionError
from maxcon.io.trajectories import read_trajectory
from maxcon.lab import simulation
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import Carrier, ScannerLayout, simulate, simulate_campaign, simulate_suburb
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.scanners import ProfileScanner, RotatingScanner
from maxcon.lab.simulation.worlds import CampaignWorld, SuburbWorld
from maxcon.mapping.build import build_map
from written_maps import run

THINNEST = {
    "mapping_scanners": (ProfileScanner(line_rate=2.0, points_per_line=30),),
    "scanner": RotatingScanner(azimuth_step_deg=2.0),
}
"""Of so few points that the dataset is of no use, but written at once."""
PROFILES = {
    name: tuple(ProfileScanner(turn_deg=turn, line_rate=rate, points_per_line=n) for turn in (45.0, -45.0))
    for name, rate, n in (("campaign", 20.0, 120), ("suburb", 60.0, 600))
}
CAMPAIGN = {**THINNEST, "n_epochs": 7, "seed": 3, "n_rounds": 2, "mapping_scanners": PROFILES["campaign"]}
TWO_PRIORS = {"gnss": "prior_gnss.txt", "uniform": "prior_uniform.txt"}
PARTS = ["map clouds", "mapping", "scans", "reference", "prior gnss", "prior uniform"]
OF_CITY = ["map clouds", "mapping", "map sigma", "scans", "reference", "prior"]
HARD = "--campaign --hard --epochs 200 --every 0.5 --seed 4 --scanner os1-64"
AS_HARD = {"n_epochs": 200, "every": 0.5, "is_hard": True, "seed": 4, "scanner": ScannerLayout.OS1_64.scanner()}
SUBURB = {"n_epochs": 200, "scanner": ScannerLayout.VLP_32C.scanner(), "overwrite": True}


@pytest.fixture(scope="module")
def campaign_dataset(built_once, campaign):
    def make(folder):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(CampaignWorld, "build", lambda *_, **__: _in_rounds(campaign, 2))
            simulate_campaign(folder / "dataset", **CAMPAIGN)

    return Dataset.open(built_once("simulated_campaign", make) / "dataset")


@pytest.fixture(scope="module")
def suburb_dataset(built_once, suburb):
    def make(folder):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(SuburbWorld, "build", lambda *_: suburb)
            options = {"n_epochs": 3, "seed": 3, "road_length": 60.0, "mapping_scanners": PROFILES["suburb"]}
            simulate_suburb(folder / "dataset", **options)

    return Dataset.open(built_once("simulated_suburb", make) / "dataset")


def _in_rounds(world, n_rounds):
    """The world mapped in its first rounds."""
    return replace(world, mapping=replace(world.mapping, drives=world.mapping.drives[:n_rounds]))


@pytest.fixture
def built(monkeypatch, campaign, suburb):
    """The worlds are there already, mapped in one round: building them is not what is tested."""
    monkeypatch.setattr(CampaignWorld, "build", lambda *_, **__: _in_rounds(campaign, 1))
    monkeypatch.setattr(SuburbWorld, "build", lambda *_: suburb)


def _map_points(dataset):
    clouds = [laspy.read(path) for path in dataset.map_clouds]
    columns = ([np.asarray(getattr(each, name)) for each in clouds] for name in ("xyz", "classification", "gps_time"))
    return [np.concatenate(column) for column in columns]


def _scan(dataset, epoch):
    return np.fromfile(dataset.scans / f"{epoch:06d}.bin", dtype="<f4").reshape(-1, 4)


def _assert_same(one, other):
    """Two datasets have the same files, but for the dates in those of LAZ."""
    names = [sorted(path.relative_to(each.folder) for path in each.folder.rglob("*.*")) for each in (one, other)]
    assert names[0] == names[1]
    for name in names[0]:
        if name.suffix != ".laz":
            assert (one.folder / name).read_bytes() == (other.folder / name).read_bytes(), name
    for first, second in zip(_map_points(one), _map_points(other), strict=True):
        np.testing.assert_array_equal(first, second)


def test_map_clouds_are_las_1_4_with_class_time_and_crs_in_tiles(dataset):
    assert len(dataset.map_clouds) > 1
    for path in dataset.map_clouds:
        east, north = (int(part) for part in path.stem.split("_")[1:])
        with laspy.open(path) as cloud:
            assert (str(cloud.header.version), cloud.header.point_format.id) == ("1.4", 6)
            assert cloud.header.parse_crs().to_epsg() == 25832
            assert (cloud.header.mins[:2] >= [east - 1e-3, north - 1e-3]).all()
            assert (cloud.header.maxs[:2] <= [east + 50.001, north + 50.001]).all()
    points, classes, times = _map_points(dataset)
    assert {LasClass.GROUND, LasClass.BUILDING, LasClass.VEHICLE} <= set(classes) <= set(LasClass)
    origins = read_trajectory(dataset.map_trajectory).positions_at(times)
    assert np.linalg.norm(points - origins, axis=1).max() < 60.2


@pytest.mark.parametrize(("name", "words", "n_epochs", "priors", "sigma"), [
    ("dataset", "seed 3, 3 epochs.", 3, {"uniform": "prior.txt"}, 0.0),
    ("campaign_dataset", "campaign, seed 3, 2 rounds of mapping, 7 epochs.", 7, TWO_PRIORS, None),
    ("suburb_dataset", "suburb, seed 3, 3 epochs.", 3, TWO_PRIORS, None),
])  # fmt: skip
def test_it_says_what_it_is_and_has_a_pose_per_scan(request, name, words, n_epochs, priors, sigma):
    dataset = request.getfixturevalue(name)
    assert (dataset.folder / "dataset.toml").read_text().splitlines()[0].endswith(f": {words}")
    assert Dataset.open(dataset.folder) == dataset and dataset.vehicle_classes == (64,)
    assert dataset.map_sigma == sigma  # if None, its rounds say
    assert {name: path.name for name, path in dataset.priors.items()} == priors
    times = np.loadtxt(dataset.scans / "times.txt")
    assert len(sorted(dataset.scans.glob("*.bin"))) == len(times) == n_epochs
    reference = read_trajectory(dataset.reference)
    for path in (dataset.reference, *dataset.priors.values()):
        trajectory = read_trajectory(path)
        np.testing.assert_array_equal(trajectory.times, times)
        errors = np.abs(trajectory.positions - reference.positions)
        assert errors[:, :2].max() <= 2.7 and errors[:, 2].max() <= 0.0401


@pytest.mark.parametrize("name", ["dataset", "campaign_dataset"])
def test_reference_poses_explain_the_scans(request, name):
    dataset = request.getfixturevalue(name)
    points, classes, _ = _map_points(dataset)
    reference = read_trajectory(dataset.reference)
    origin = reference.positions[0]
    tree = cKDTree(points[classes == LasClass.BUILDING] - origin)
    right, wrong = [], []
    for number in range(len(reference)):
        scan = _scan(dataset, number).astype(float)
        above_cars = scan[(np.linalg.norm(scan[:, :3], axis=1) < 20.0) & (scan[:, 2] > 0.7), :3]
        pose = reference.pose(number).translated(-origin)
        for distances, offset in ((right, [0.0, 0.0, 0.0]), (wrong, [0.9, -0.9, 0.0])):
            distances.append(np.median(tree.query(pose.translated(offset).apply(above_cars))[0]))
    assert np.median(right) < 0.25  # the thin map of the tests has points 0.3 m apart
    assert np.median(wrong) > 1.5 * np.median(right)


def test_same_seed_same_files(dataset, small, tmp_path):
    _assert_same(dataset, simulate(tmp_path / "city", **small))


@pytest.mark.usefixtures("built")
def test_fewer_epochs_are_the_same_scans(campaign_dataset, suburb_dataset, tmp_path):
    fewer = simulate_campaign(tmp_path / "campaign", **{**CAMPAIGN, **THINNEST, "n_epochs": 3})
    profiles = THINNEST["mapping_scanners"]
    few = simulate_suburb(tmp_path / "suburb", n_epochs=2, seed=3, road_length=60.0, mapping_scanners=profiles)
    for some, whole, rows in ((fewer, campaign_dataset, [0, 3, 6]), (few, suburb_dataset, [0, 2])):
        np.testing.assert_array_equal(_scan(some, 1), _scan(whole, rows[1]))
        for name in ("gnss", "uniform"):
            priors = [read_trajectory(each.priors[name]).positions for each in (some, whole)]
            np.testing.assert_array_equal(priors[0], priors[1][rows])


@pytest.mark.usefixtures("built")
def test_successive_epochs_and_the_odometry_of_the_whole_round(campaign_dataset, tmp_path):
    successive = simulate_campaign(tmp_path / "out", **{**CAMPAIGN, **THINNEST, "n_epochs": 3}, every=0.2)
    times = np.loadtxt(successive.scans / "times.txt")
    np.testing.assert_allclose(np.diff(times), 0.2, atol=1e-6)
    np.testing.assert_array_equal(_scan(successive, 0), _scan(campaign_dataset, 0))
    assert successive.odometry.name == campaign_dataset.odometry.name == "odometry.txt"
    told, same = read_trajectory(successive.odometry), read_trajectory(campaign_dataset.odometry)
    np.testing.assert_array_equal(told.positions, same.positions)
    assert len(told) == 3001 and np.isin(np.round(times, 6), np.round(told.times, 6)).all()
    reference = read_trajectory(campaign_dataset.reference)
    first, second = reference.times[1:3]
    moved = [np.linalg.norm(each.at(second).position - each.at(first).position) for each in (told, reference)]
    assert 0.0 < abs(moved[0] / moved[1] - 1.0) < 0.05


@pytest.mark.usefixtures("built")
def test_a_hard_campaign_says_so_and_is_overwritten_if_asked(tmp_path):
    options = {**THINNEST, "n_epochs": 1, "is_hard": True, "n_rounds": 2}
    simulate_campaign(tmp_path / "out", **options)
    assert ": hard campaign, seed 0, 2 rounds of mapping, 1 epochs." in (tmp_path / "out/dataset.toml").read_text()
    simulate_campaign(tmp_path / "out", **options, overwrite=True)


def _localized(dataset, folder, numbers, prior, method):
    """Prior, answer and reference of epochs, in the frame of the map that is built in a folder."""
    build_map(dataset.map_clouds, folder / "built.map", dataset.map_options())
    point_map = PointMap.open(folder / "built.map")
    for number in numbers:
        poses = (read_trajectory(path).pose(number) for path in (dataset.priors[prior], dataset.reference))
        start, wanted = map(point_map.frame.pose_to_local, poses)
        yield start, method.localize(Scan(_scan(dataset, number)[:, :3]), point_map, start), wanted


def test_an_epoch_of_the_suburb_is_localized(suburb_dataset, tmp_path):
    method = MaximumConsensus(SearchSpace.paper())
    ((_, estimate, wanted),) = _localized(suburb_dataset, tmp_path, [1], "uniform", method)
    assert np.hypot(estimate.pose.x - wanted.x, estimate.pose.y - wanted.y) < 0.15


def test_a_walk_is_the_same_for_the_same_seed_and_is_localized_from_level_priors(tmp_path):
    scanner = ScannerLayout.MID_360.scanner()
    options = {"n_epochs": 2, "seed": 3, "before": 20.0, "after": 15.0, "carrier": Carrier.HAND, "scanner": scanner}
    dataset = simulate(tmp_path / "walk", **options, mapping_scanners=PROFILES["suburb"])
    again = simulate(tmp_path / "again", **options, mapping_scanners=THINNEST["mapping_scanners"])
    np.testing.assert_array_equal(_scan(dataset, 1), _scan(again, 1))
    assert dataset.prior.read_bytes() == again.prior.read_bytes()
    assert list(dataset.priors) == ["level"]
    answers = []
    for prior, estimate, wanted in _localized(dataset, tmp_path, range(2), "level", MaximumConsensus(widest=0.0)):
        assert (prior.roll, prior.pitch) == pytest.approx((0.0, 0.0), abs=1e-9)
        answers.append((estimate.is_localized, np.abs(estimate.pose.less(wanted)).max() < 0.05))
    assert answers == 2 * [(True, True)]  # tilted by 13 and 22 degrees


@pytest.mark.parametrize(("make", "wrong", "words"), [
    (simulate, {"n_epochs": 0}, "Expected at least one epoch, got n_epochs = 0"),
    (simulate, {"seed": -1}, "Expected a seed of 0 or more, got -1"),
    (simulate, {"before": 3.0}, "Expected a route of more than"),
    (simulate_campaign, {"n_rounds": 0}, "Expected at least one round of mapping, got 0"),
    (simulate_campaign, {"n_epochs": 0}, r"Expected 1 to 3001 epochs of a campaign, got n_epochs = 0\."),
    (simulate_campaign, {"n_epochs": 10, "every": 0.25}, r"`every` to be a multiple of 0\.1 s .* got 0\.25 s"),
    (simulate_suburb, {"n_epochs": 0}, "Expected 1 to 601 epochs of a suburb, got n_epochs = 0"),
    (simulate_suburb, {"n_epochs": 1, "road_length": 10.0}, "Expected a road of 60 to 2000 m"),
])  # fmt: skip
def test_wrong_options_are_refused(tmp_path, make, wrong, words):
    with pytest.raises(OptionError, match=words):
        make(tmp_path / "out", **wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "dataset_name", "options", "asked", "parts"), [
    ("simulate", "dataset", "--changed 0.3", {"n_epochs": 40, "carrier": "car", "changed": 0.3}, OF_CITY),
    ("simulate_campaign", "campaign_dataset", HARD, AS_HARD, [*PARTS, "odometry"]),
    ("simulate_suburb", "suburb_dataset", "--scene suburb --scanner vlp-32c --overwrite", SUBURB, PARTS),
])  # fmt: skip
def test_options_go_on_and_parts_are_said(request, monkeypatch, tmp_path, name, dataset_name, options, asked, parts):
    dataset = request.getfixturevalue(dataset_name)
    simulate_it = Mock(return_value=dataset)
    monkeypatch.setattr(simulation, name, simulate_it)
    first, *lines = run("simulate", tmp_path / "out", *options.split()).splitlines()
    simulate_it.assert_called_once_with(tmp_path / "out", progress=ANY, **{"seed": 0, "overwrite": False} | asked)
    assert first == str(dataset.folder) and [line[:13].strip() for line in lines] == parts
    assert all(f" {dataset.folder}/" in line for line in lines if not line.startswith("map sigma"))


def test_the_help_names_every_scanner():
    said = "".join(run("simulate", "--help").split())  # lines may end within a name
    assert [layout.value for layout in ScannerLayout if layout.value not in said] == []


def test_a_walk_is_through_the_city_alone(tmp_path):
    for other in (["--campaign"], ["--scene", "suburb"]):
        with pytest.raises(OptionError, match=r"Expected either .* or --carrier hand, got both"):
            run("simulate", tmp_path / "out", "--carrier", "hand", *other)
