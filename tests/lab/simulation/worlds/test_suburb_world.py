# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A piece of a suburb on two days: what stays, what does not, and what scans see of it."""

import numpy as np
import pytest

from maxcon import Scan
from maxcon.lab.simulation import DeskewErrors, LasClass, MovingScanner, ScannerLayout


def _days(suburb):
    return suburb.mapping.caster.city, suburb.scan_caster.city


@pytest.mark.parametrize("las_class", [LasClass.GROUND, LasClass.BUILDING, LasClass.POLE])
def test_what_is_built_stays(suburb, las_class):
    first, second = (day.corners[day.classes == las_class] for day in _days(suburb))
    assert len(first) > 0
    np.testing.assert_array_equal(first, second)


def test_leaves_and_cars_do_not_stay(suburb):
    for las_class in (LasClass.HIGH_VEGETATION, LasClass.UNCLASSIFIED, LasClass.VEHICLE):
        first, second = (day.corners[day.classes == las_class].mean(axis=1) for day in _days(suburb))
        known = {tuple(center) for center in first.round(4).tolist()}
        stays = np.mean([tuple(center) in known for center in second.round(4).tolist()])
        assert stays < 0.7, las_class


def test_most_hedges_have_no_class(suburb):
    classes = np.bincount(suburb.mapping.caster.classes, minlength=256)
    assert classes[LasClass.UNCLASSIFIED] > classes[LasClass.MEDIUM_VEGETATION]


def test_the_ground_is_not_flat(suburb):
    ground = suburb.mapping.caster.city
    heights = ground.corners[ground.classes == LasClass.GROUND][..., 2]
    assert np.ptp(heights) > 1.0


def _scans(suburb, layout):
    for epoch in suburb.epochs(5):
        echoes = suburb.scan(epoch, MovingScanner(layout.scanner(), DeskewErrors()))
        yield (echoes.points - epoch.reference.position) @ epoch.reference.rotation


def test_the_share_of_points_with_a_normal_is_that_of_real_scans(suburb):
    shares = [np.any(Scan(points).normals != 0.0, axis=1).mean() for points in _scans(suburb, ScannerLayout.VLP_16)]
    assert 0.24 < np.mean(shares) < 0.50, shares


def test_ranges_are_those_of_real_scans(suburb):
    ranges = np.concatenate([np.linalg.norm(p, axis=1) for p in _scans(suburb, ScannerLayout.HDL_64E)])
    low, middle, high = np.percentile(ranges, [10, 50, 90])
    assert 3.0 < low < 6.0
    assert 5.5 < middle < 9.5
    assert 14.0 < high < 27.0


def test_all_epochs_lie_on_the_road(suburb):
    epochs = suburb.epochs(suburb.most_epochs)
    np.testing.assert_allclose(np.diff([epoch.time for epoch in epochs]), 0.1, atol=1e-6)
    along, _ = suburb.road.addresses(np.array([epoch.reference.position[:2] for epoch in epochs]))
    np.testing.assert_allclose(along[[0, -1]], [0.0, suburb.road.length], atol=0.5)
    assert (np.diff(along) > 0.0).all()
