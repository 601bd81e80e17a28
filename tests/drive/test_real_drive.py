"""A real drive: a map of 7.8 million points, real scans, and priors that are metres and degrees wrong."""

import numpy as np
import pytest

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.drive.localize import localize_drive
from maxcon.io.raw_scan import DeskewedScans
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.evaluation import pose_error
from maxcon.mapping.build import MapOptions, build_map
from maxcon.search import exhaustive, reference


@pytest.fixture(scope="module")
def drive_folder(real_data):
    return real_data("kitti-0013")


def built(folder, out):
    """The manifest of the map that the clouds of a drive make, and the map."""
    options = MapOptions(trajectory=read_trajectory(folder / "map" / "trajectory.txt"))
    manifest = build_map(sorted((folder / "map").glob("*.laz")), out, options)
    return manifest, PointMap.open(out)


@pytest.fixture(scope="module")
def city(drive_folder, tmp_path_factory):
    return built(drive_folder, tmp_path_factory.mktemp("real") / "city.map")


def test_what_the_map_is_made_of(city):
    manifest, point_map = city
    counts = manifest.build["sources"]
    assert sum(source["n_points"] for source in counts) > 7_000_000
    assert sum(source["n_kept"] for source in counts) == manifest.n_points
    assert all(source["is_classified"] and source["n_dropped"]["2"] > 100_000 for source in counts)
    assert sum(source["n_without_side"] for source in counts) < 0.01 * manifest.n_points
    assert point_map.is_signed and "25832" in point_map.frame.crs
    assert 20 < len(manifest.tiles) < 200
    _, _, normals = point_map.all_voxels()
    assert normals.any(axis=1).mean() > 0.5  # the rest are bushes, and points alone


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
def test_the_search_equals_the_definition_on_a_real_scan(drive_folder, city, multiplicity, monkeypatch):
    _, point_map = city
    raw = open_scans(drive_folder / "scans").read(21, max_range=40.0)
    whole = Scan(raw.points)
    chosen = np.linspace(0, len(whole) - 1, 150).astype(int)
    scan = Scan(whole.points[chosen], whole.normals[chosen])
    pose = read_trajectory(drive_folder / "reference.txt").at(raw.time)
    prior = point_map.frame.pose_to_local(pose)
    space = SearchSpace(0.24, 0.06, 0.5, 0.5)
    near = point_map.tiles_within(prior.x, prior.y, 45.0)  # the definition asks for each voxel of a map
    voxels = [np.concatenate([getattr(tile, name) for tile in near]) for name in ("voxels", "counts", "normals")]
    monkeypatch.setattr(PointMap, "all_voxels", lambda _: voxels)
    wanted = reference.voxels(scan, point_map, prior, space, multiplicity=multiplicity)
    assert wanted.moments[..., 0].max() > 15
    for n_threads in (1, 2):
        found = exhaustive(scan, point_map, prior, space, multiplicity=multiplicity, n_threads=n_threads)
        assert (found.moments == wanted.moments).all()


def localized(folder, point_map, scans, prior_name):
    """Whether each epoch is right, and whether it is called localized, of scans with a prior."""
    prior, wanted = (read_trajectory(folder / f"{name}.txt") for name in (prior_name, "reference"))
    right, trusted, distances = [], [], []
    for epoch in localize_drive(point_map, scans, prior, MaximumConsensus()):
        pose = point_map.frame.pose_to_local(wanted.at(epoch.raw.time))
        error = pose_error(epoch.estimate.pose, pose)
        right.append(error.is_success)
        trusted.append(epoch.estimate.is_localized)
        distances.append(error.distance)
    return np.array(right), np.array(trusted), np.array(distances)


@pytest.mark.parametrize("prior", ["prior_perturbed", "prior_gnss"])
def test_every_epoch_of_the_main_road_is_right(drive_folder, city, prior):
    right, trusted, distances = localized(drive_folder, city[1], open_scans(drive_folder / "scans"), prior)
    assert len(right) == 70 and right.all()
    assert np.median(distances) < 0.08 and trusted.sum() >= 69


@pytest.fixture(scope="module")
def suburb(real_data, tmp_path_factory):
    folder = real_data("kitti360-suburb")
    return folder, built(folder, tmp_path_factory.mktemp("suburb") / "suburb.map")[1]


def test_every_epoch_of_the_suburb_is_right(suburb):
    folder, point_map = suburb
    right, trusted, distances = localized(folder, point_map, open_scans(folder / "scans"), "prior_perturbed")
    assert len(right) == 25 and right.all()
    assert trusted.sum() >= 24 and np.median(distances) < 0.06


def test_no_answer_from_scans_that_were_not_deskewed_is_called_localized_far_off(suburb):
    folder, point_map = suburb
    scans = open_scans(folder / "scans_raw", folder / "scans" / "times.txt")
    _, trusted, distances = localized(folder, point_map, scans, "prior_perturbed")
    assert distances[trusted].max() < 0.6


def test_scans_deskewed_here_are_as_good_as_those_that_others_deskewed(suburb):
    """The motion is that of the reference poses, five a half second: what an odometer would tell."""
    folder, point_map = suburb
    scans = open_scans(folder / "scans_raw", folder / "scans" / "times.txt")
    deskewed = DeskewedScans(scans, read_trajectory(folder / "reference.txt"), max_gap=1.0, turn_time=0.1)
    theirs = open_scans(folder / "scans")
    for i in (0, 12):
        ours = deskewed.read(i, 0.0, 200.0).points
        off = np.linalg.norm(ours - theirs.read(i, 0.0, 200.0).points, axis=1)
        before = np.linalg.norm(scans.read(i, 0.0, 200.0).points - theirs.read(i, 0.0, 200.0).points, axis=1)
        assert np.median(before) > 0.15 and np.median(off) < 0.03
    right, trusted, distances = localized(folder, point_map, deskewed, "prior_perturbed")
    assert right.all() and trusted.sum() >= 24
    assert np.median(distances) < 0.06
