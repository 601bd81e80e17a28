# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the scanners measure, held against the triangles they hit."""

import sys

import numpy as np
import pytest

from maxcon.errors import MissingExtraError, OptionError
from maxcon.lab.simulation import LasClass, PriorErrors, ProfileScanner, RayCaster, RotatingScanner


def _distances_to_hit_planes(echoes, caster):
    """Signed distance of each point from the plane of the triangle it hit, and the cosine of incidence."""
    first_corners = caster.city.corners[echoes.triangles, 0]
    normals = caster.normals[echoes.triangles].astype(float)
    rays = echoes.points - echoes.origins
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distances = np.einsum("ij,ij->i", echoes.points - first_corners, normals)
    return distances, np.einsum("ij,ij->i", rays, normals)


@pytest.fixture(scope="module")
def epoch(world):
    return world.epochs(3, PriorErrors())[0]


def test_vlp16_layers():
    scanner = RotatingScanner()
    np.testing.assert_allclose(np.degrees(scanner.elevations), np.arange(-15.0, 16.0, 2.0))
    assert scanner.directions.shape == (28800, 3)
    np.testing.assert_allclose(np.linalg.norm(scanner.directions, axis=1), 1.0)
    np.testing.assert_allclose(scanner.directions[7], [np.cos(np.radians(1)), 0.0, np.sin(np.radians(-1))])


def test_noise_free_scan_lies_on_the_mesh(world, epoch):
    echoes = world.scan(epoch, RotatingScanner(noise=0.0))
    distances, _ = _distances_to_hit_planes(echoes, world.scan_caster)
    assert len(echoes.points) > 20_000
    assert np.abs(distances).max() < 1e-3  # float32
    points_sensor = (echoes.points - epoch.reference.position) @ epoch.reference.rotation
    np.testing.assert_allclose(epoch.reference.apply(points_sensor), echoes.points, atol=1e-9)
    elevations = np.degrees(np.arcsin(points_sensor[:, 2] / np.linalg.norm(points_sensor, axis=1)))
    layers = np.arange(-15.0, 16.0, 2.0)
    assert np.abs(elevations[:, None] - layers).min(axis=1).max() < 1e-3


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noise_has_the_stated_size(world, epoch, noise):
    echoes = world.scan(epoch, RotatingScanner(noise=noise))
    distances, cosines = _distances_to_hit_planes(echoes, world.scan_caster)
    steep = np.abs(cosines) > 0.3
    along_ray = distances[steep] / cosines[steep]
    assert abs(along_ray.mean()) < 0.001
    assert np.isclose(along_ray.std(), noise, rtol=0.05)


def test_dropouts_and_ranges(world, epoch):
    full = world.scan(epoch, RotatingScanner(noise=0.0, dropout=0.0))
    some = world.scan(epoch, RotatingScanner(noise=0.0, dropout=0.1))
    assert np.isclose(len(some.points) / len(full.points), 0.9, atol=0.01)
    near = world.scan(epoch, RotatingScanner(noise=0.0, min_range=5.0, max_range=20.0))
    ranges = np.linalg.norm(near.points - near.origins, axis=1)
    assert ranges.min() >= 5.0 - 1e-3
    assert ranges.max() <= 20.0 + 1e-3


def test_scans_are_seeded(world, epoch):
    first, second = (world.scan(epoch, RotatingScanner()) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    assert not np.array_equal(world.scan(epoch._replace(number=9), RotatingScanner()).points[:9], first.points[:9])


def test_intensities_are_between_0_and_1(world, epoch):
    intensities = world.scan(epoch, RotatingScanner()).intensities
    assert intensities.min() >= 0.0
    assert intensities.max() <= 1.0


def test_profiles_are_upright_and_turned(world):
    drive = world.mapping.drives[0]
    scanner = ProfileScanner(turn_deg=45.0, noise=0.0)
    assert np.allclose(scanner.directions @ np.array([-1.0, 1.0, 0.0]), 0.0)
    echoes = scanner.scan(world.mapping.caster, drive, 0, 20, np.random.default_rng(0))
    distances, _ = _distances_to_hit_planes(echoes, world.mapping.caster)
    assert np.abs(distances).max() < 1e-3
    positions, _ = drive.at(echoes.times)
    np.testing.assert_allclose(echoes.origins, positions, atol=1e-3)
    assert (np.diff(echoes.times) > 0.0).all()


def test_blind_part_hides_the_lane(world):
    drive = world.mapping.drives[0]
    echoes = ProfileScanner(blind_deg=45.0).scan(world.mapping.caster, drive, 0, 50, np.random.default_rng(0))
    rays = echoes.points - echoes.origins
    angle = np.degrees(np.arccos(-rays[:, 2] / np.linalg.norm(rays, axis=1)))
    assert angle.min() > 43.5  # less the tilt of the vehicle


def test_map_is_denser_where_the_drive_is_slower(world, thin_profiles):
    drive = world.mapping.drives[0]
    speeds = np.linalg.norm(np.diff(drive.positions, axis=0), axis=1) / np.diff(drive.times)
    slow, fast = np.argmin(speeds), np.argmax(speeds)
    counts = []
    for place in (slow, fast):
        centre = drive.positions[place]
        (scanner, _) = thin_profiles
        echoes = scanner.scan(world.mapping.caster, drive, 0, scanner.n_lines(drive), np.random.default_rng(0))
        counts.append((np.linalg.norm(echoes.origins - centre, axis=1) < 2.0).sum())
    assert counts[0] > 2.5 * counts[1]


def test_straight_street_is_weak_along_its_axis_and_the_crossing_is_not(world):
    city = world.mapping.caster.city
    axis = np.array([np.cos(city.street_angle), np.sin(city.street_angle)])
    drive = world.mapping.drives[0]
    u = drive.positions[:, :2] @ axis
    shares = []
    for place in (-55.0, -4.0):
        (pose,) = drive.poses([drive.times[np.argmin(np.abs(u - place))]])
        echoes = RotatingScanner().scan(world.mapping.caster, pose, 0.0, np.random.default_rng(0))
        normals = world.mapping.caster.normals[echoes.triangles[echoes.classes == LasClass.BUILDING], :2]
        along = (normals @ axis) ** 2
        shares.append(along.sum() / (normals**2).sum())
    assert 0.005 < shares[0] < 0.15
    assert shares[1] > 0.25


@pytest.mark.parametrize(
    "wrong",
    [
        {"noise": -0.1},
        {"dropout": 1.5},
        {"min_range": 5.0, "max_range": 2.0},
        {"n_layers": 0},
        {"azimuth_step_deg": 0.0},
    ],
)
def test_wrong_rotating_scanners_are_refused(wrong):
    with pytest.raises(OptionError, match=r"Expected .* got .* Leave them out"):
        RotatingScanner(**wrong)


@pytest.mark.parametrize("wrong", [{"line_rate": 0.0}, {"points_per_line": 0}, {"blind_deg": 180.0}, {"noise": -1.0}])
def test_wrong_profile_scanners_are_refused(wrong):
    with pytest.raises(OptionError, match=r"Expected .* got .* Leave them out"):
        ProfileScanner(**wrong)


def test_without_embreex_the_extra_is_named(city, monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    with pytest.raises(MissingExtraError, match=r"Run: pip install 'maxcon\[demo\]'"):
        RayCaster(city)
