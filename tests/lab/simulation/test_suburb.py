"""A road that winds and climbs, what is laid on it, and a piece of a suburb on two days."""

import numpy as np
import pytest

from maxcon import Scan
from maxcon.lab.simulation import ScannerLayout
from maxcon.lab.simulation.drive import drive_along
from maxcon.lab.simulation.furniture import LasClass, boxes
from maxcon.lab.simulation.suburb_ground import draw_road


@pytest.fixture(scope="module")
def road():
    return draw_road(460.0, [0, 0])


def test_addresses_are_found_again_and_laid_things_stand_on_the_ground(road):
    along, left = np.linspace(5.0, 455.0, 80), np.linspace(-20.0, 20.0, 80)
    np.testing.assert_allclose(road.addresses(road.places(along, left)), [along, left], atol=0.05)
    plank = boxes([[0.0, -0.1, 0.0]], [[0.2, 0.1, 1.0]], LasClass.UNCLASSIFIED)
    laid = road.laid(plank, 200.0, 5.0).corners.reshape(-1, 3)
    heights = laid[:, 2] - road.ground_heights(*road.addresses(laid[:, :2]))
    assert np.minimum(np.abs(heights), np.abs(heights - 1.0)).max() < 0.01


@pytest.mark.parametrize("is_back", [False, True])
def test_a_drive_follows_the_ground(road, is_back):
    drive = road.on_ground(drive_along(road.route(-1.2, 1, is_back=is_back), 2, height=2.0))
    along, left = road.addresses(drive.positions[:, :2])
    heights = drive.positions[:, 2] - road.ground_heights(along, left)
    assert np.abs(heights - 2.0).max() < 0.1
    steps = np.diff(drive.positions, axis=0)
    climb = steps[:, 2] / np.linalg.norm(steps[:, :2], axis=1)
    assert np.corrcoef(climb, -np.tan(drive.angles[1:, 1]))[0, 1] > 0.8
    side = np.where(is_back, -1.0, 1.0)
    rises = side * (road.ground_heights(along, left + 0.75) - road.ground_heights(along, left - 0.75)) / 1.5
    assert np.abs(drive.angles[:, 0] - np.arctan(rises)).max() < np.radians(1.0)


def _on_both_days(suburb, las_class):
    days = suburb.mapping.caster.city, suburb.scan_caster.city
    return [day.corners[day.classes == las_class] for day in days]


@pytest.mark.parametrize("las_class", [LasClass.GROUND, LasClass.BUILDING, LasClass.POLE])
def test_what_is_built_stays(suburb, las_class):
    first, second = _on_both_days(suburb, las_class)
    assert len(first) > 0
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("las_class", [LasClass.HIGH_VEGETATION, LasClass.UNCLASSIFIED, LasClass.VEHICLE])
def test_leaves_and_cars_do_not_stay(suburb, las_class):
    first, second = (corners.mean(axis=1).round(4).tolist() for corners in _on_both_days(suburb, las_class))
    known = set(map(tuple, first))
    assert np.mean([tuple(center) in known for center in second]) < 0.7


def _scans(suburb, layout):
    for epoch in suburb.epochs(5):
        points = suburb.scan(epoch, layout.scanner()).points
        yield (points - epoch.reference.position) @ epoch.reference.rotation


def test_ranges_and_the_ratio_of_points_with_a_normal_are_those_of_real_scans(suburb):
    ratios = [np.any(Scan(points).normals != 0.0, axis=1).mean() for points in _scans(suburb, ScannerLayout.VLP_16)]
    assert 0.24 < np.mean(ratios) < 0.50, ratios
    ranges = np.concatenate([np.linalg.norm(p, axis=1) for p in _scans(suburb, ScannerLayout.HDL_64E)])
    low, middle, high = np.percentile(ranges, [10, 50, 90])
    assert 3.0 < low < 6.0 and 5.5 < middle < 9.5
    assert 14.0 < high < 27.0


def test_all_epochs_lie_on_the_road(suburb):
    epochs = suburb.epochs(suburb.n_epochs_of_drive)
    np.testing.assert_allclose(np.diff([epoch.time for epoch in epochs]), 0.1, atol=1e-6)
    along, _ = suburb.road.addresses(np.array([epoch.reference.position[:2] for epoch in epochs]))
    np.testing.assert_allclose(along[[0, -1]], [0.0, suburb.road.length], atol=0.5)
    assert (np.diff(along) > 0.0).all()
