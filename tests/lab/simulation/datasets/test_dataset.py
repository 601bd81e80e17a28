# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The dataset on disk: readable, whole or absent, the same for the same seed, and true."""

import subprocess
import sys

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from maxcon.errors import FileError, OptionError
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import LasClass, simulate


def _map_points(dataset):
    clouds = [laspy.read(path) for path in dataset.map_clouds]
    points = np.concatenate([cloud.xyz for cloud in clouds])
    classes = np.concatenate([np.asarray(cloud.classification) for cloud in clouds])
    times = np.concatenate([np.asarray(cloud.gps_time) for cloud in clouds])
    return points, classes, times


def _scan(dataset, epoch):
    return np.fromfile(dataset.scans / f"{epoch:06d}.bin", dtype="<f4").reshape(-1, 4)


def test_map_clouds_are_las_1_4_with_class_time_and_crs(dataset):
    assert len(dataset.map_clouds) > 1
    with laspy.open(dataset.map_clouds[0]) as cloud:
        assert str(cloud.header.version) == "1.4"
        assert cloud.header.point_format.id == 6
        assert cloud.header.parse_crs().to_epsg() == 25832
    points, classes, times = _map_points(dataset)
    assert {LasClass.GROUND, LasClass.BUILDING, LasClass.VEHICLE} <= set(classes)
    assert set(classes) <= {int(member) for member in LasClass}
    trajectory = read_trajectory(dataset.map_trajectory)
    origins = trajectory.positions_at(times)
    assert np.isfinite(origins).all()
    assert np.linalg.norm(points - origins, axis=1).max() < 60.2


def test_its_map_is_said_to_be_exact(dataset):
    assert dataset.map_sigma == 0.0
    assert "\nsigma = 0.0\n" in (dataset.folder / "dataset.toml").read_text()


def test_tiles_hold_what_their_names_say(dataset):
    for path in dataset.map_clouds:
        east, north = (int(part) for part in path.stem.split("_")[1:])
        with laspy.open(path) as cloud:
            assert (cloud.header.mins[:2] >= [east - 1e-3, north - 1e-3]).all()
            assert (cloud.header.maxs[:2] <= [east + 50.001, north + 50.001]).all()


def test_trajectories_have_one_pose_per_scan(dataset):
    times = np.loadtxt(dataset.scans / "times.txt")
    scans = sorted(dataset.scans.glob("*.bin"))
    reference, prior = read_trajectory(dataset.reference), read_trajectory(dataset.prior)
    assert len(scans) == 3
    np.testing.assert_array_equal(reference.times, times)
    np.testing.assert_array_equal(prior.times, times)
    errors = np.abs(prior.positions - reference.positions)
    assert 0.0 < errors[:, :2].max() <= 2.5
    assert errors[:, 2].max() <= 0.0101


def test_reference_poses_explain_the_scans(dataset):
    points, classes, _ = _map_points(dataset)
    reference = read_trajectory(dataset.reference)
    origin = reference.positions[0]
    tree = cKDTree(points[classes == LasClass.BUILDING] - origin)
    for epoch in range(len(reference)):
        scan = _scan(dataset, epoch).astype(float)
        near = scan[np.linalg.norm(scan[:, :3], axis=1) < 25.0, :3]
        above_cars = near[near[:, 2] > 0.7]
        pose = reference.pose(epoch).translated(-origin)
        right, _ = tree.query(pose.apply(above_cars))
        wrong, _ = tree.query(pose.translated([0.7, -0.7, 0.0]).apply(above_cars))
        assert np.median(right) < 0.2  # the thin map of the tests has points 0.3 m apart
        assert np.median(wrong) > 1.5 * np.median(right)


def test_dataset_opens_again(dataset):
    assert Dataset.open(dataset.folder) == dataset


def test_same_seed_same_files(dataset, tmp_path, thin_profiles):
    again = simulate(tmp_path / "again", n_epochs=3, seed=3, before=30.0, after=20.0, mapping_scanners=thin_profiles)
    texts = ["reference.txt", "prior.txt", "map/trajectory.txt", "scans/times.txt", "dataset.toml"]
    for name in [*texts, "scans/000000.bin", "scans/000002.bin"]:
        assert (dataset.folder / name).read_bytes() == (again.folder / name).read_bytes(), name
    assert [path.name for path in dataset.map_clouds] == [path.name for path in again.map_clouds]
    for first, second in zip(_map_points(dataset), _map_points(again), strict=True):
        np.testing.assert_array_equal(first, second)


def test_progress_counts_to_the_end(tmp_path, thin_profiles):
    seen = []
    simulate(
        tmp_path / "out",
        n_epochs=1,
        before=10.0,
        after=10.0,
        mapping_scanners=thin_profiles,
        progress=lambda done, total: seen.append((done, total)),
    )
    totals = {total for _, total in seen}
    assert [done for done, _ in seen] == list(range(1, totals.pop() + 1))
    assert not totals


@pytest.mark.parametrize("stop_at", [1, 10_000])
def test_a_failure_leaves_nothing(tmp_path, thin_profiles, stop_at):
    def fail(done, total):
        if done >= min(stop_at, total):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "out", n_epochs=1, before=10.0, after=10.0, mapping_scanners=thin_profiles, progress=fail)
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_kept(dataset):
    with pytest.raises(FileError, match="not to exist yet"):
        simulate(dataset.folder)
    assert dataset.reference.exists()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"n_epochs": 0}, "Expected at least one epoch, got n_epochs = 0"),
        ({"seed": -1}, "Expected a seed of 0 or more, got -1"),
        ({"before": 3.0}, "Expected a route of more than"),
    ],
)
def test_wrong_options_are_refused(tmp_path, wrong, words):
    with pytest.raises(OptionError, match=words):
        simulate(tmp_path / "out", **wrong)
    assert list(tmp_path.iterdir()) == []


def test_importing_is_light():
    heavy = "embreex trimesh laspy pyproj scipy numba"
    code = f"import sys, maxcon.lab.simulation; print(*[m for m in '{heavy}'.split() if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""
