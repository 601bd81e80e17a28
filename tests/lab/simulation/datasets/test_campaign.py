# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The campaign on disk: readable, whole or absent, the same for the same seed, and true."""

from dataclasses import replace

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.errors import FileError, OptionError
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import CampaignWorld, LasClass, ProfileScanner, simulate_campaign

THIN_PROFILES = tuple(ProfileScanner(turn_deg=turn, line_rate=20.0, points_per_line=120) for turn in (45.0, -45.0))
THINNEST = (ProfileScanner(line_rate=2.0, points_per_line=30),)


@pytest.fixture(scope="module")
def thin(thin_scanner):
    return {"n_epochs": 7, "seed": 3, "n_rounds": 2, "mapping_scanners": THIN_PROFILES, "scanner": thin_scanner}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, thin):
    return simulate_campaign(tmp_path_factory.mktemp("campaign") / "dataset", **thin)


@pytest.fixture
def built(monkeypatch, campaign):
    """The world is there already, with one round of mapping: building it is not what is tested."""
    world = replace(campaign, mapping=replace(campaign.mapping, drives=campaign.mapping.drives[:1]))
    monkeypatch.setattr(CampaignWorld, "build", lambda *_, **__: world)


def _scan(dataset, number):
    return np.fromfile(dataset.scans / f"{number:06d}.bin", dtype="<f4").reshape(-1, 4)


def test_it_says_what_it_is(dataset):
    text = (dataset.folder / "dataset.toml").read_text()
    assert ": campaign, seed 3, 2 rounds of mapping, 7 epochs." in text.splitlines()[0]
    assert dataset.vehicle_classes == (64,)
    assert dataset.map_sigma is None  # its rounds say
    assert {name: path.name for name, path in dataset.priors.items()} == {
        "gnss": "prior_gnss.txt",
        "uniform": "prior_uniform.txt",
    }
    assert dataset.prior == dataset.priors["gnss"]
    assert Dataset.open(dataset.folder) == dataset


def test_scans_reference_and_priors_go_together(dataset):
    times = np.loadtxt(dataset.scans / "times.txt")
    assert len(sorted(dataset.scans.glob("*.bin"))) == len(times) == 7
    np.testing.assert_allclose(np.diff(times), 50.0, atol=1e-6)
    for path in (dataset.reference, *dataset.priors.values()):
        np.testing.assert_array_equal(read_trajectory(path).times, times)


def test_the_map_is_the_union_of_the_rounds(dataset):
    times, classes, epsg = [], set(), set()
    for path in dataset.map_clouds:
        cloud = laspy.read(path)
        times.append(np.asarray(cloud.gps_time))
        classes |= set(np.unique(cloud.classification).tolist())
        epsg.add(cloud.header.parse_crs().to_epsg())
    assert epsg == {25832}
    assert classes == {int(member) for member in LasClass} - {LasClass.UNCLASSIFIED}
    ends = np.flatnonzero(np.diff(np.sort(np.concatenate(times))) > 30.0)
    assert len(ends) == 1  # the pause between two rounds
    trajectory = read_trajectory(dataset.map_trajectory)
    assert (np.diff(trajectory.times) > 30.0).sum() == 1


def test_reference_poses_explain_the_scans(dataset):
    reference = read_trajectory(dataset.reference)
    origin = reference.positions[0]
    clouds = [laspy.read(path) for path in dataset.map_clouds]
    points = np.concatenate([c.xyz[np.asarray(c.classification) == LasClass.BUILDING] for c in clouds])
    tree = cKDTree(points - origin)
    right, wrong = [], []
    for number in range(7):
        scan = _scan(dataset, number).astype(float)
        near = scan[(np.linalg.norm(scan[:, :3], axis=1) < 20.0) & (scan[:, 2] > 0.7), :3]
        pose = reference.pose(number).translated(-origin)
        for distances, offset in ((right, [0.0, 0.0, 0.0]), (wrong, [0.9, -0.9, 0.0])):
            distances.append(np.median(tree.query(pose.translated(offset).apply(near))[0]))
    assert np.median(right) < 0.25  # the thin map of the tests has points 0.3 m apart
    assert np.median(wrong) > 1.5 * np.median(right)


def test_same_seed_same_files(dataset, tmp_path, thin):
    again = simulate_campaign(tmp_path / "again", **thin)
    names = ["reference.txt", "prior_gnss.txt", "prior_uniform.txt", "map/trajectory.txt", "dataset.toml"]
    for name in [*names, "scans/times.txt", "scans/000000.bin", "scans/000006.bin"]:
        assert (dataset.folder / name).read_bytes() == (again.folder / name).read_bytes(), name
    for first, second in zip(dataset.map_clouds, again.map_clouds, strict=True):
        np.testing.assert_array_equal(laspy.read(first).xyz, laspy.read(second).xyz)


@pytest.mark.usefixtures("built")
def test_fewer_epochs_are_the_same_scans(dataset, tmp_path, thin):
    fewer = simulate_campaign(tmp_path / "fewer", **{**thin, "n_epochs": 3, "mapping_scanners": THINNEST})
    np.testing.assert_array_equal(_scan(fewer, 1), _scan(dataset, 3))
    for name in ("gnss", "uniform"):
        few, many = (read_trajectory(data.priors[name]) for data in (fewer, dataset))
        np.testing.assert_array_equal(few.positions, many.positions[[0, 3, 6]])


@pytest.mark.usefixtures("built")
def test_successive_epochs_and_the_odometry_of_the_whole_round(dataset, tmp_path, thin):
    options = {**thin, "n_epochs": 3, "mapping_scanners": THINNEST}
    successive = simulate_campaign(tmp_path / "successive", **options, every=0.2)
    times = np.loadtxt(successive.scans / "times.txt")
    np.testing.assert_allclose(np.diff(times), 0.2, atol=1e-6)
    np.testing.assert_array_equal(_scan(successive, 0), _scan(dataset, 0))
    assert successive.odometry.name == dataset.odometry.name == "odometry.txt"
    told, same = read_trajectory(successive.odometry), read_trajectory(dataset.odometry)
    np.testing.assert_array_equal(told.positions, same.positions)
    assert len(told) == 3001 and np.isin(np.round(times, 6), np.round(told.times, 6)).all()
    reference = read_trajectory(dataset.reference)
    first, second = reference.times[1:3]
    moved = [np.linalg.norm(each.at(second).position - each.at(first).position) for each in (told, reference)]
    assert 0.0 < abs(moved[0] / moved[1] - 1.0) < 0.05


@pytest.mark.usefixtures("built")
def test_hard_is_said(tmp_path, thin_scanner):
    out = tmp_path / "hard"
    simulate_campaign(out, n_epochs=1, is_hard=True, n_rounds=2, mapping_scanners=THINNEST, scanner=thin_scanner)
    assert ": hard campaign, seed 0, 2 rounds of mapping, 1 epochs." in (out / "dataset.toml").read_text()


@pytest.mark.usefixtures("built")
def test_progress_counts_to_the_end(tmp_path, thin_scanner):
    seen = []
    simulate_campaign(
        tmp_path / "out",
        n_epochs=2,
        mapping_scanners=THINNEST,
        scanner=thin_scanner,
        progress=lambda done, total: seen.append((done, total)),
    )
    (total,) = {total for _, total in seen}
    assert [done for done, _ in seen] == list(range(1, total + 1))


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize("stop_at", [1, 10_000])
def test_a_failure_leaves_nothing(tmp_path, thin_scanner, stop_at):
    def fail(done, total):
        if done >= min(stop_at, total):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_campaign(tmp_path / "out", n_epochs=1, mapping_scanners=THINNEST, scanner=thin_scanner, progress=fail)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("built")
def test_only_a_dataset_is_overwritten(dataset, tmp_path, thin_scanner):
    with pytest.raises(FileError, match="not to exist yet"):
        simulate_campaign(dataset.folder)
    assert dataset.reference.exists()
    thinnest = {"n_epochs": 1, "mapping_scanners": THINNEST, "scanner": thin_scanner}
    simulate_campaign(tmp_path / "out", **thinnest)
    simulate_campaign(tmp_path / "out", **thinnest, overwrite=True)
    (tmp_path / "out" / "thesis.tex").touch()
    with pytest.raises(FileError, match=r"holds thesis\.tex"):
        simulate_campaign(tmp_path / "out", **thinnest, overwrite=True)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"n_epochs": 0}, r"Expected 1 to 3001 epochs of a campaign, got n_epochs = 0\."),
        ({"n_epochs": 3002}, r"got n_epochs = 3002\. A round has no more: .* Take another seed for more\."),
        ({"n_epochs": 10, "every": 0.25}, r"Expected `every` to be a multiple of 0\.1 s .* got 0\.25 s"),
        ({"n_epochs": 1000, "every": 0.5}, r"with which 1000 epochs fit into the round of 300 s, got 0\.5 s"),
        ({"n_epochs": 2, "every": 0.0}, r"got 0\.0 s"),
        ({"seed": -1}, "Expected a seed of 0 or more, got -1"),
        ({"n_rounds": 0}, "Expected at least one round of mapping, got 0"),
    ],
)
def test_wrong_options_are_refused(tmp_path, wrong, words):
    with pytest.raises(OptionError, match=words):
        simulate_campaign(tmp_path / "out", **wrong)
    assert list(tmp_path.iterdir()) == []
