# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Odometry that drifts: exact without errors, smooth, and off by what it says."""

import math
from itertools import pairwise

import numpy as np
import pytest

from maxcon import Trajectory
from maxcon.drive.motion import Motion
from maxcon.errors import OptionError
from maxcon.lab.simulation import OdometryErrors, drive_along, route_over_crossing

EXACT = OdometryErrors(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def drive():
    return drive_along(route_over_crossing(0.3, 60.0, 40.0), 1, start_time=100.0)


@pytest.fixture(scope="module")
def times(drive):
    return np.arange(100.0, drive.times[-1], 0.1)


def motions(poses):
    return [Motion.between(before, after, 0.1).pose for before, after in pairwise(poses)]


def test_without_errors_every_motion_is_the_true_one(drive, times):
    odometry = EXACT.draw(drive, times, 0)
    assert (odometry[0].x, odometry[0].y, odometry[0].z, odometry[0].heading) == (0.0, 0.0, 0.0, 0.0)
    for told, true in zip(motions(odometry), motions(drive.poses(times)), strict=True):
        np.testing.assert_allclose(told.position, true.position, atol=1e-9)
        np.testing.assert_allclose(told.rotation, true.rotation, atol=1e-9)


def test_the_scale_and_the_drift_are_as_large_as_said(drive, times):
    true = drive.poses(times)
    way = np.sum([np.linalg.norm(motion.position) for motion in motions(true)])
    scaled = OdometryErrors(0.01, 0.0, 0.0, 0.0, 0.0).draw(drive, times, 0)
    told = np.sum([np.linalg.norm(motion.position) for motion in motions(scaled)])
    assert abs(told / way - 1.0) == pytest.approx(0.01, rel=1e-6)
    turned = OdometryErrors(0.0, 0.05, 0.0, 0.0, 0.0).draw(drive, times, 0)
    gained = np.unwrap([pose.heading for pose in turned])[-1] - (true[-1].heading - true[0].heading)
    drift = math.remainder(gained, 2.0 * math.pi)
    assert abs(drift) == pytest.approx(math.radians(0.05) * (times[-1] - times[0]), rel=1e-6)


def test_noise_grows_with_the_root_of_the_way_and_tilts_stay(drive, times):
    true = motions(drive.poses(times))
    walking = motions(OdometryErrors(0.0, 0.0, 0.1, 0.005, 0.02).draw(drive, times, 0))
    roots = np.sqrt([np.linalg.norm(motion.position) for motion in true])
    off = np.array([told.x - exact.x for told, exact in zip(walking, true, strict=True)]) / roots
    turns = np.array([told.heading - exact.heading for told, exact in zip(walking, true, strict=True)]) / roots
    assert np.std(off) == pytest.approx(0.005, rel=0.2)
    assert np.std(turns) == pytest.approx(math.radians(0.1), rel=0.2)
    tilts = [
        (told.roll - exact.roll)
        for told, exact in zip(OdometryErrors().draw(drive, times, 0), drive.poses(times), strict=True)
    ]
    assert np.std(tilts) == pytest.approx(math.radians(0.02), rel=0.2)


def test_the_same_seed_gives_the_same_odometry(drive, times):
    assert OdometryErrors().draw(drive, times, [3, 1]) == OdometryErrors().draw(drive, times, [3, 1])
    assert OdometryErrors().draw(drive, times, [3, 1]) != OdometryErrors().draw(drive, times, [4, 1])


def test_standing_still_it_stands_still():
    from maxcon.lab.simulation import Drive

    standing = Drive(np.array([0.0, 10.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    odometry = OdometryErrors(tilt_deg=0.0).draw(standing, np.arange(0.0, 10.0, 0.1), 0)
    assert len(set(odometry)) == 1
    assert isinstance(Trajectory.from_poses(np.arange(len(odometry)), odometry), Trajectory)


def test_errors_are_not_negative():
    with pytest.raises(OptionError, match=r"Expected `scale` of odometry errors to be a number >= 0, got -0\.01"):
        OdometryErrors(scale=-0.01)
