# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The part of the map a scan can meet."""

import numpy as np
import pytest

from maxcon import Pose
from maxcon.lab.baselines.map_targets import Place


def at(x, y):
    return Pose(x, y, 1.7, 0.0, 0.0, 0.0)


def test_a_place_is_a_square_and_a_reach():
    points = np.array([[30.0, 0.0, 40.0], [1.0, 2.0, 3.0]])  # 50 m, and 5 m of drift
    assert Place.of_scan(points, at(39.9, -0.1), gate=1.0, spread=0.0) == Place(1, -1, 60.0)
    assert Place.of_scan(points, at(40.0, 0.0), gate=3.0, spread=2.5) == Place(2, 0, 80.0)
    assert Place(1, -1, 60.0).middle == (30.0, -10.0)
    assert Place(1, -1, 60.0).half_width == 70.0
    assert Place.of_scan(np.empty((0, 3)), at(0.0, 0.0), 1.0, 0.0) == Place(0, 0, 20.0)


@pytest.mark.parametrize(("x", "y"), [(0.1, 0.1), (19.9, 19.9), (7.0, 12.0)])
def test_all_that_a_sensor_in_the_square_reaches_is_there(x, y):
    place = Place.of_scan(np.array([[50.0, 0.0, 0.0]]), at(x, y), 1.0, 0.0)
    points = np.random.default_rng(0).uniform(-120.0, 120.0, (20_000, 3))
    is_reached = place.reaches(points)
    distance = np.hypot(points[:, 0] - x, points[:, 1] - y)
    assert is_reached[distance <= 56.0].all()
    assert not is_reached[distance > place.reach + 20.0 * np.sqrt(2.0)].any()
    assert (np.abs(points[is_reached, :2] - place.middle) <= place.half_width).all()


def test_a_place_is_rounded_at_its_corners():
    corner = np.array([[20.0 + 29.0, 20.0 + 29.0, 0.0], [20.0 + 28.0, 20.0 + 28.0, 99.0], [60.0, 10.0, 0.0]])
    assert Place(0, 0, 40.0).reaches(corner).tolist() == [False, True, True]
