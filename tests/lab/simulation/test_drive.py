# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Speeds, waits and poses along a route."""

import math

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import drive_along, route_over_crossing


def test_drive_slows_down_at_the_crossing():
    route = route_over_crossing(0.5, 60.0, 40.0)
    drive = drive_along(route, 1, speed=8.0, slowest=0.2)
    speeds = np.diff(route.distances) / np.diff(drive.times)
    slowest = np.argmin(speeds)
    assert abs(route.distances[slowest] - route.stop_at) < 3.0
    assert speeds[slowest] < 2.0
    assert 6.0 < np.median(speeds[route.distances[1:] < route.stop_at - 20.0]) < 10.0


def test_drive_is_seeded_and_level():
    route = route_over_crossing(0.5, 60.0, 40.0)
    drive, again = drive_along(route, 1, height=2.0), drive_along(route, 1, height=2.0)
    np.testing.assert_array_equal(drive.angles, again.angles)
    assert np.abs(drive.positions[:, 2] - 2.0).max() <= 0.02
    assert 0.0 < np.degrees(np.abs(drive.angles[:, :2])).max() <= 0.8
    assert np.isclose(drive.angles[0, 2], 0.5, atol=1e-6)
    assert np.isclose(drive.angles[-1, 2], 0.5 + np.pi / 2.0, atol=1e-6)


def test_poses_at_times_lie_on_the_route():
    drive = drive_along(route_over_crossing(0.0, 60.0, 40.0), 1)
    (pose,) = drive.poses([drive.times[100]])
    np.testing.assert_allclose(pose.position, drive.positions[100])


@pytest.mark.parametrize(("speed", "slowest"), [(0.0, 0.5), (8.0, 0.0), (8.0, 1.5)])
def test_wrong_speeds_are_refused(speed, slowest):
    with pytest.raises(OptionError, match="Expected a speed above 0 m/s"):
        drive_along(route_over_crossing(0.0, 20.0, 20.0), 1, speed=speed, slowest=slowest)


def test_a_vehicle_waits_where_it_has_slowed_down():
    route = route_over_crossing(0.3, 40.0, 30.0)
    through, waiting = drive_along(route, 4), drive_along(route, 4, wait=10.0)
    assert waiting.times[-1] == pytest.approx(through.times[-1] + 10.0)
    stop = through.times[np.searchsorted(route.distances, route.stop_at)]
    there, _ = waiting.at(stop + np.linspace(0.0, 10.0, 5))
    np.testing.assert_allclose(there, np.tile(there[0], (5, 1)))
    for one, other in ((stop - 1.0, stop - 1.0), (stop + 1.0, stop + 11.0)):
        np.testing.assert_allclose(through.at([one]), waiting.at([other]))
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(OptionError, match="wait"):
            drive_along(route, 4, wait=wrong)
