# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A road that winds and climbs, and what is laid on it."""

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import LasClass, draw_road, drive_along
from maxcon.lab.simulation.furniture import boxes


@pytest.fixture(scope="module")
def road():
    return draw_road(460.0, [0, 0])


def test_it_winds_and_climbs(road):
    slopes = np.diff(road.heights) / np.diff(road.alongs)
    assert 0.03 < slopes.max() < 0.08
    assert -0.08 < slopes.min() < -0.03
    assert np.ptp(np.degrees(road.headings)) > 30.0
    steps = np.linalg.norm(np.diff(road.centers, axis=0), axis=1)
    radii = steps / np.maximum(np.abs(np.diff(road.headings)), 1e-9)
    assert radii.min() > 70.0


def test_the_carriageway_is_cambered_and_has_kerbs(road):
    along = np.linspace(0.0, 460.0, 100)
    middle, edges = (road.ground_heights(along, 0.0), [road.ground_heights(along, left) for left in (-3.0, 3.0)])
    np.testing.assert_allclose(middle - np.mean(edges, axis=0), 0.06)
    assert np.abs(edges[0] - edges[1]).max() > 0.05
    np.testing.assert_allclose(road.ground_heights(along, 3.12) - road.ground_heights(along, 3.1), 0.1, atol=5e-3)


def test_addresses_are_found_again(road):
    along, left = np.linspace(5.0, 455.0, 80), np.linspace(-20.0, 20.0, 80)
    found = road.addresses(road.places(along, left))
    np.testing.assert_allclose(found, [along, left], atol=0.05)


@pytest.mark.parametrize("is_back", [False, True])
def test_a_drive_follows_the_ground(road, is_back):
    drive = road.on_ground(drive_along(road.route(-1.2, 1, is_back=is_back), 2, height=2.0))
    along, left = road.addresses(drive.positions[:, :2])
    heights = drive.positions[:, 2] - road.ground_heights(along, left)
    assert np.abs(heights - 2.0).max() < 0.1
    climb = np.gradient(drive.positions[:, 2]) / np.gradient(
        np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(drive.positions[:, :2], axis=0), axis=1))])
    )
    assert np.corrcoef(climb, -np.tan(drive.angles[:, 1]))[0, 1] > 0.8
    side = np.where(is_back, -1.0, 1.0)
    rises = side * (road.ground_heights(along, left + 0.75) - road.ground_heights(along, left - 0.75)) / 1.5
    assert np.abs(drive.angles[:, 0] - np.arctan(rises)).max() < np.radians(1.0)


def test_laid_things_stand_on_the_ground(road):
    plank = boxes([[0.0, -0.1, 0.0]], [[0.2, 0.1, 1.0]], LasClass.UNCLASSIFIED)
    laid = road.laid(plank, 200.0, 5.0).corners.reshape(-1, 3)
    heights = laid[:, 2] - road.ground_heights(*road.addresses(laid[:, :2]))
    assert np.minimum(np.abs(heights), np.abs(heights - 1.0)).max() < 0.01


@pytest.mark.parametrize("length", [20.0, 5000.0])
def test_wrong_lengths_are_refused(length):
    with pytest.raises(OptionError, match="Expected a road of 60 to 2000 m"):
        draw_road(length, 0)
