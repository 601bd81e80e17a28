"""What scanners measure, held against the triangles they hit; their layouts; scans from a vehicle that moves."""

from dataclasses import replace

import numpy as np
import pytest

from maxcon.lab.simulation import ScannerLayout
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.scanners import DeskewErrors, RosetteScanner, RotatingScanner, scan_moving

NONE = DeskewErrors(0.0, 0.0, 0.0)
NOISE_FREE = RotatingScanner(azimuth_step_deg=1.0, noise=0.0, dropout=0.0)


def _distances_to_hit_planes(returns, caster):
    """Signed distance of each point from the plane of the triangle it hit, and the cosine of incidence."""
    first_corners = caster.city.corners[returns.triangles, 0]
    normals = caster.normals[returns.triangles].astype(float)
    rays = returns.points - returns.origins
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distances = np.einsum("ij,ij->i", returns.points - first_corners, normals)
    return distances, np.einsum("ij,ij->i", rays, normals)


def _rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def epoch(world):
    return world.epochs(3)[0]


@pytest.mark.parametrize(("name", "n_columns", "elevations_deg"), [
    ("vlp-16", 1800, dict(enumerate(range(-15, 16, 2)))),
    ("vlp-32c", 1800, {0: -25.0, 1: -15.639, 20: 0.0, 30: 10.333, 31: 15.0}),
    ("hdl-64e", 2083, {0: -24.33, 1: -23.83, 32: -8.33, 63: 2.0}),
    ("os1-64", 1024, {0: -22.5, 63: 22.5}),
])  # fmt: skip
def test_layers_and_columns_by_name(name, n_columns, elevations_deg):
    scanner = ScannerLayout.parse(name).scanner()
    elevations = np.degrees(scanner.elevations)
    assert (np.diff(elevations) > 0.0).all()
    np.testing.assert_allclose(elevations[list(elevations_deg)], list(elevations_deg.values()), atol=1e-3)
    assert scanner.directions.shape == (n_columns * len(elevations), 3)
    np.testing.assert_allclose(np.linalg.norm(scanner.directions, axis=1), 1.0)


def _angles(layout, time=0.0):
    """Azimuth and elevation of the rays of a scan, degrees, and when they are fired, s."""
    rays = layout.scanner().rays(time)
    x, y, z = rays.directions.T
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(np.clip(z, -1.0, 1.0))), rays.offsets


@pytest.mark.parametrize(("layout", "n_rays", "azimuths", "elevations"), [
    (ScannerLayout.OS1_128, 128 * 1024, (-180.0, 180.0), (-22.5, 22.5)),
    (ScannerLayout.OS_DOME_128, 128 * 1024, (-180.0, 180.0), (0.0, 89.5)),
    (ScannerLayout.XT_32, 32 * 2000, (-180.0, 180.0), (-16.0, 15.0)),
    (ScannerLayout.PANDAR_128, 128 * 1800, (-180.0, 180.0), (-25.0, 15.0)),
    (ScannerLayout.MID_360, 20_000, (-180.0, 180.0), (-7.0, 52.0)),
    (ScannerLayout.AVIA, 24_000, (-35.2, 35.2), (-38.6, 38.6)),
    (ScannerLayout.TWO_VLP_16, 2 * 28_800, (-180.0, 180.0), (-40.0, 40.0)),
    (ScannerLayout.TWO_OS_DOME_128, 2 * 128 * 1024, (-180.0, 180.0), (-90.0, 90.0)),
])  # fmt: skip
def test_fields_of_view_and_rays_of_a_tenth_of_a_second(layout, n_rays, azimuths, elevations):
    azimuth, elevation, offsets = _angles(layout)
    assert len(azimuth) == n_rays
    for found, limits in ((azimuth, azimuths), (elevation, elevations)):
        assert limits[0] - 1e-6 <= found.min() <= limits[0] + 1.0
        assert limits[1] - 1.0 <= found.max() <= limits[1] + 1e-6
    assert -0.05 < offsets.min() < -0.0499 and 0.0499 < offsets.max() < 0.05


@pytest.mark.parametrize("layout", [ScannerLayout.MID_360, ScannerLayout.AVIA])
def test_scans_of_a_pattern_that_does_not_repeat_fill_the_gaps_of_others(layout):
    def seen(times):
        """Squares of 0.2 degrees with a ray."""
        angles = (np.column_stack(_angles(layout, time)[:2]) for time in times)
        return len(np.unique(np.floor(5.0 * np.concatenate(list(angles))), axis=0))

    assert seen([10.0]) == seen([10.0, 10.0]) and seen([10.0, 10.1]) > 1.5 * seen([10.0])
    assert seen([10.0, 10.1, 10.2, 10.3]) > 2.2 * seen([10.0])


def test_both_scanners_of_a_vehicle_measure_from_where_they_are(world, epoch):
    scanner = replace(ScannerLayout.TWO_VLP_16.scanner(), noise=0.0)
    returns = world.scan(epoch, scanner)
    origins = (returns.origins - epoch.reference.position) @ epoch.reference.rotation
    np.testing.assert_allclose(np.unique(origins.round(6), axis=0), [[0.0, -0.6, 0.0], [0.0, 0.6, 0.0]], atol=1e-6)
    distances, _ = _distances_to_hit_planes(returns, world.scan_caster)
    assert np.abs(distances).max() < 1e-3


def test_a_noise_free_scan_lies_on_the_mesh(world, epoch):
    returns = world.scan(epoch, RotatingScanner(noise=0.0))
    distances, _ = _distances_to_hit_planes(returns, world.scan_caster)
    assert len(returns.points) > 20_000
    assert np.abs(distances).max() < 1e-3  # float32
    assert 0.0 <= returns.intensities.min() <= returns.intensities.max() <= 1.0
    points_sensor = (returns.points - epoch.reference.position) @ epoch.reference.rotation
    elevations = np.degrees(np.arcsin(points_sensor[:, 2] / np.linalg.norm(points_sensor, axis=1)))
    assert np.abs(elevations[:, None] - np.arange(-15.0, 16.0, 2.0)).min(axis=1).max() < 1e-3


def test_noise_dropouts_and_ranges_are_as_stated(world, epoch):
    returns = world.scan(epoch, RotatingScanner(noise=0.02, dropout=0.1, min_range=5.0, max_range=20.0))
    distances, cosines = _distances_to_hit_planes(returns, world.scan_caster)
    steep = np.abs(cosines) > 0.3
    along_ray = distances[steep] / cosines[steep]
    assert abs(along_ray.mean()) < 0.001 and np.isclose(along_ray.std(), 0.02, rtol=0.05)
    ranges = np.linalg.norm(returns.points - returns.origins, axis=1)
    assert 5.0 - 0.1 <= ranges.min() <= ranges.max() <= 20.0 + 0.1
    full = world.scan(epoch, RotatingScanner(dropout=0.0, min_range=5.0, max_range=20.0))
    assert np.isclose(len(returns.points) / len(full.points), 0.9, atol=0.02)


@pytest.fixture(scope="module")
def start(world):
    """Where the drive through the city begins: position and angles."""
    positions, angles = world.scan_drive.at([world.scan_drive.times[0]])
    return positions[0], angles[0]


def _driving(start, *, speed=0.0, turn_rate=0.0):
    """A drive that passes `start` at 10 s, straight on (m/s) and turning (rad/s)."""
    position, angles = start
    times = np.linspace(9.0, 11.0, 2001)
    away = times - 10.0
    way = np.array([np.cos(angles[2]), np.sin(angles[2]), 0.0])
    return Drive(times, position + speed * away[:, None] * way, angles + np.outer(away, [0.0, 0.0, turn_rate]))


def test_a_vehicle_that_stands_measures_an_instant_scan(world, start):
    drive, scanner = _driving(start), RotatingScanner(azimuth_step_deg=1.0)
    moving = scan_moving(scanner, world.scan_caster, drive, 10.0, _rng(5), NONE)
    instant = scanner.scan(world.scan_caster, drive.poses([10.0])[0], 10.0, _rng(5))
    np.testing.assert_array_equal(moving.triangles, instant.triangles)
    np.testing.assert_allclose(moving.points, instant.points, atol=1e-4)  # float32 rays
    assert 9.95 < moving.times.min() < moving.times.max() < 10.05


@pytest.mark.parametrize("scanner", [NOISE_FREE, RosetteScanner(noise=0.0, dropout=0.0)])
def test_without_errors_the_points_lie_where_they_were_hit(world, start, scanner):
    drive = _driving(start, speed=10.0, turn_rate=0.3)
    returns = scan_moving(scanner, world.scan_caster, drive, 10.0, _rng(5), NONE)
    distances, _ = _distances_to_hit_planes(returns, world.scan_caster)
    assert np.abs(distances).max() < 1e-3
    origins, _ = drive.at(returns.times)
    np.testing.assert_allclose(returns.origins, origins, atol=1e-9)
    assert np.ptp(origins[:, :2], axis=0).max() > 0.5


def test_the_residual_is_what_an_error_of_the_speed_says(world, start):
    drive = _driving(start, speed=10.0)
    right, wrong = (
        scan_moving(NOISE_FREE, world.scan_caster, drive, 10.0, _rng(5), errors)
        for errors in (NONE, DeskewErrors(0.02, 0.0, 0.0))
    )
    shifts = wrong.points - right.points
    way = np.array([np.cos(start[1][2]), np.sin(start[1][2]), 0.0])
    speed_errors = shifts @ way / (10.0 * (right.times - 10.0))
    assert 0.0 < np.abs(speed_errors).max() <= 0.02
    np.testing.assert_allclose(speed_errors, speed_errors[0], atol=1e-9)
    np.testing.assert_allclose(shifts - np.outer(shifts @ way, way), 0.0, atol=1e-9)
