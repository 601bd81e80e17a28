# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Scans from a vehicle that moves: deskewed to the middle of the scan, wrong by what the errors say."""

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import DeskewErrors, Drive, MovingScanner, RotatingScanner

NONE = DeskewErrors(0.0, 0.0, 0.0)
NOISE_FREE = RotatingScanner(azimuth_step_deg=1.0, noise=0.0, dropout=0.0)


def _rng():
    return np.random.default_rng(5)


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
    moving = MovingScanner(scanner, NONE).scan(world.scan_caster, drive, 10.0, _rng())
    instant = scanner.scan(world.scan_caster, drive.poses([10.0])[0], 10.0, _rng())
    np.testing.assert_array_equal(moving.triangles, instant.triangles)
    np.testing.assert_allclose(moving.points, instant.points, atol=1e-4)  # float32 rays
    assert 9.95 < moving.times.min() < moving.times.max() < 10.05


def test_without_errors_the_points_lie_where_they_were_hit(world, start):
    drive = _driving(start, speed=10.0, turn_rate=0.3)
    echoes = MovingScanner(NOISE_FREE, NONE).scan(world.scan_caster, drive, 10.0, _rng())
    first_corners = world.scan_caster.city.corners[echoes.triangles, 0]
    normals = world.scan_caster.normals[echoes.triangles]
    assert np.abs(np.einsum("ij,ij->i", echoes.points - first_corners, normals)).max() < 1e-3
    origins, _ = drive.at(echoes.times)
    np.testing.assert_allclose(echoes.origins, origins, atol=1e-9)
    assert np.ptp(origins[:, :2], axis=0).max() > 0.5


def test_the_residual_is_what_the_errors_say(world, start):
    drive = _driving(start, speed=10.0)
    right, wrong = (
        MovingScanner(NOISE_FREE, errors).scan(world.scan_caster, drive, 10.0, _rng())
        for errors in (NONE, DeskewErrors(0.02, 0.0, 0.0))
    )
    shifts = wrong.points - right.points
    way = np.array([np.cos(start[1][2]), np.sin(start[1][2]), 0.0])
    speed_errors = shifts @ way / (10.0 * (right.times - 10.0))
    assert 0.0 < np.abs(speed_errors).max() <= 0.02
    np.testing.assert_allclose(speed_errors, speed_errors[0], atol=1e-9)
    np.testing.assert_allclose(shifts - np.outer(shifts @ way, way), 0.0, atol=1e-9)


def test_a_turn_rate_error_turns_points_by_their_time(world, start):
    drive, errors = _driving(start), DeskewErrors(0.0, 0.3, 0.0)
    right, wrong = (
        MovingScanner(NOISE_FREE, each).scan(world.scan_caster, drive, 10.0, _rng()) for each in (NONE, errors)
    )
    points, moved = ((echoes.points - start[0]) @ drive.poses([10.0])[0].rotation for echoes in (right, wrong))
    turns = np.arctan2(moved[:, 1], moved[:, 0]) - np.arctan2(points[:, 1], points[:, 0])
    rates = (turns + np.pi) % (2.0 * np.pi) - np.pi
    rates /= right.times - 10.0
    assert 0.0 < np.abs(rates).max() <= np.radians(0.3)
    np.testing.assert_allclose(rates, rates[0], atol=1e-8)


def test_errors_below_0_are_refused():
    with pytest.raises(OptionError, match="Expected bounds of deskew errors of 0 or more"):
        DeskewErrors(speed=-0.01)
