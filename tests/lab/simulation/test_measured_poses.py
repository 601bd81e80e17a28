# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of priors, odometry and mapping trajectories: their spread, their memory and their bounds."""

import math
from itertools import pairwise

import numpy as np
import pytest

from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.simulation import (
    Drive,
    OdometryErrors,
    PriorErrors,
    draw_georeferencing_errors,
    draw_gnss_errors,
    drive_along,
    route_over_crossing,
)
from maxcon.lab.simulation.measured_poses import GNSS_BOUNDS

DRIVE = drive_along(route_over_crossing(0.3, 60.0, 40.0), 1, start_time=100.0)
TIMES = np.arange(100.0, DRIVE.times[-1], 0.1)
TRUE = DRIVE.poses(TIMES)


@pytest.fixture(scope="module")
def gnss_errors():
    return draw_gnss_errors(200_000, 0.1, 0)


def test_gnss_errors_have_their_spread_and_bounds(gnss_errors):
    x, y, z, roll, pitch, heading = gnss_errors.std(axis=0)
    np.testing.assert_allclose([x, y, z, np.degrees(heading)], [1.17, 1.17, 0.0146, 0.6], rtol=0.06)
    np.testing.assert_allclose(np.degrees([roll, pitch]), 0.05, rtol=0.06)
    worst = np.abs(gnss_errors).max(axis=0)
    assert ((worst <= GNSS_BOUNDS) & (worst > 0.95 * GNSS_BOUNDS)).all()
    assert worst[0] < 3.0  # the paper's search range
    assert np.abs(np.corrcoef(gnss_errors.T) - np.eye(6)).max() < 0.1


def test_gnss_errors_are_remembered_for_20_s(gnss_errors):
    heading = gnss_errors[:, 5]
    for wait in (1.0, 20.0, 40.0):
        lag = round(wait / 0.1)
        found = np.corrcoef(heading[:-lag], heading[lag:])[0, 1]
        assert found == pytest.approx(np.exp(-wait / 20.0), abs=0.06)
    assert np.abs(np.diff(gnss_errors[:, 0])).max() < 0.8  # no jumps, at the bounds neither


def test_what_follows_changes_no_gnss_error():
    np.testing.assert_array_equal(draw_gnss_errors(50, 0.1, 7), draw_gnss_errors(3001, 0.1, 7)[:50])
    assert not np.array_equal(draw_gnss_errors(50, 0.1, 8), draw_gnss_errors(50, 0.1, 7))


def test_priors_are_off_by_no_more_than_their_bounds():
    reference = Pose(10.0, 20.0, 2.0, 0.01, -0.01, 3.14)
    errors, rng = PriorErrors(), np.random.default_rng(0)
    off = np.array([errors.prior(reference, rng).values - reference.values for _ in range(500)])
    off[:, 3:] = np.degrees(wrap_angle(off[:, 3:]))
    bounds = np.array([2.5, 2.5, 0.01, 0.05, 0.05, 1.8])
    worst = np.abs(off).max(axis=0)
    assert ((worst > 0.9 * bounds) & (worst <= bounds + 1e-9)).all()


def _motions(poses):
    return [before.inverse @ after for before, after in pairwise(poses)]


def test_odometry_without_errors_measures_every_true_motion():
    odometry = OdometryErrors(0.0, 0.0, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    assert (odometry[0].x, odometry[0].y, odometry[0].z, odometry[0].heading) == (0.0, 0.0, 0.0, 0.0)
    for told, true in zip(_motions(odometry), _motions(TRUE), strict=True):
        np.testing.assert_allclose(told.position, true.position, atol=1e-9)
        np.testing.assert_allclose(told.rotation, true.rotation, atol=1e-9)


def test_scale_and_drift_of_odometry_are_as_large_as_said():
    scaled = OdometryErrors(0.01, 0.0, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    told, way = (sum(np.linalg.norm(motion.position) for motion in _motions(poses)) for poses in (scaled, TRUE))
    assert abs(told / way - 1.0) == pytest.approx(0.01, rel=1e-6)
    turned = OdometryErrors(0.0, 0.05, 0.0, 0.0, 0.0).draw(DRIVE, TIMES, 0)
    drift = math.remainder(turned[-1].heading - (TRUE[-1].heading - TRUE[0].heading), 2.0 * math.pi)
    assert abs(drift) == pytest.approx(math.radians(0.05) * (TIMES[-1] - TIMES[0]), rel=1e-6)


def test_noise_of_odometry_grows_with_the_root_of_the_way_and_tilts_stay():
    true = _motions(TRUE)
    told = _motions(OdometryErrors(0.0, 0.0, 0.1, 0.005, 0.02).draw(DRIVE, TIMES, 0))
    off = np.array([one.values - other.values for one, other in zip(told, true, strict=True)])
    off /= np.sqrt([[np.linalg.norm(motion.position)] for motion in true])
    np.testing.assert_allclose(off[:, [0, 5]].std(axis=0), [0.005, math.radians(0.1)], rtol=0.2)
    drawn = OdometryErrors().draw(DRIVE, TIMES, 0)
    tilts = [one.roll - other.roll for one, other in zip(drawn, TRUE, strict=True)]
    assert np.std(tilts) == pytest.approx(math.radians(0.02), rel=0.2)


def test_odometry_is_seeded_and_stands_still_with_the_vehicle():
    assert OdometryErrors().draw(DRIVE, TIMES, [3, 1]) == OdometryErrors().draw(DRIVE, TIMES, [3, 1])
    assert OdometryErrors().draw(DRIVE, TIMES, [3, 1]) != OdometryErrors().draw(DRIVE, TIMES, [4, 1])
    standing = Drive(np.array([0.0, 10.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    assert len(set(OdometryErrors(tilt_deg=0.0).draw(standing, np.arange(0.0, 10.0, 0.1), 0))) == 1


def test_georeferencing_errors_are_2_cm_smooth_and_forgotten_after_a_round():
    errors = draw_georeferencing_errors(1, 1000.0, 101_000.0)
    offsets = errors.at(np.arange(1000.0, 101_000.0, 10.0))
    np.testing.assert_allclose(offsets.std(axis=0), 0.02, rtol=0.08)
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=0.003)
    times = np.arange(1000.0, 100_000.0, 1.0)
    here, soon, late = (errors.at(times + wait).ravel() for wait in (0.0, 30.0, 170.0))
    assert np.abs(np.diff(errors.at(times), axis=0)).max() < 0.004
    assert abs(np.corrcoef(here, soon)[0, 1] - np.exp(-0.25)) < 0.05
    assert abs(np.corrcoef(here, late)[0, 1]) < 0.1


def test_georeferencing_errors_are_seeded_and_their_deviation_can_be_chosen():
    first, second, other = (draw_georeferencing_errors(seed, 0.0, 60.0).offsets for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, second)
    assert not np.allclose(first, other)
    assert (draw_georeferencing_errors(1, 0.0, 100.0, deviation=0.0).offsets == 0.0).all()
