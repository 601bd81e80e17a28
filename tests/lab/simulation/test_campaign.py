"""The campaign before it is written: rounds, epochs, priors, and what changed between the days."""

from dataclasses import replace

import numpy as np
import pytest

from maxcon.geometry import wrap_angle
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.scanners import ProfileScanner

THIN = (ProfileScanner(line_rate=1.0, points_per_line=90),)


@pytest.fixture(scope="module")
def everything(campaign):
    """All epochs of the round."""
    return campaign.epochs(3001)


def test_the_round_takes_300_s_and_ends_where_it_began(campaign, everything):
    drive = campaign.scan_drive
    assert drive.times[-1] - drive.times[0] == pytest.approx(300.0, abs=1e-6)
    assert np.linalg.norm(drive.positions[-1] - drive.positions[0]) < 0.7  # it wanders in its lane
    assert abs(wrap_angle(drive.angles[-1, 2] - drive.angles[0, 2])) < np.radians(3.0)
    times = np.array([epoch.time for epoch in everything])
    assert len(times) == 3001
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-6)
    places = np.array([epoch.reference.position for epoch in everything])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.7


@pytest.mark.parametrize(("name", "bound"), [("gnss_priors", 2.7), ("uniform_priors", 2.5)])
def test_priors_are_off_by_their_errors_whatever_the_number_of_epochs(campaign, everything, name, bound):
    priors = getattr(campaign, name)
    few, all_priors = campaign.epochs(4), priors(everything)
    assert priors(few) == [all_priors[epoch.tick] for epoch in few]
    off = np.array([prior.values - epoch.reference.values for prior, epoch in zip(all_priors, everything, strict=True)])
    assert 0.8 < np.abs(off[:, :2]).max() <= bound and np.abs(off[:, 2]).max() <= 0.04
    assert 0.2 < np.degrees(np.abs(wrap_angle(off[:, 5]))).max() <= 1.8 + 1e-9
    step = np.median(np.linalg.norm(np.diff(off[:, :2], axis=0), axis=1))
    assert step < 0.3 if name == "gnss_priors" else step > 1.0  # slowly, or at once


def test_rounds_are_off_by_2_cm_and_points_as_much_as_the_trajectory(campaign):
    mapping, errors = campaign.mapping, campaign.mapping.georeferencing
    pieces, true_mapping = mapping.pieces(THIN), replace(mapping, georeferencing=None)
    for true, placed in zip(true_mapping.returns(pieces), mapping.returns(pieces), strict=True):
        offsets = errors.at(true.times)
        np.testing.assert_allclose(placed.points - true.points, offsets, atol=1e-9)
        np.testing.assert_array_equal(placed.classes, true.classes)
        assert 0.0 < np.abs(offsets).max() < 0.1
    (times, poses), (_, true_poses) = mapping.poses(), true_mapping.poses()
    for k in range(0, len(times), 5000):
        np.testing.assert_allclose(poses[k].position - true_poses[k].position, errors.at([times[k]])[0], atol=1e-9)
    between = np.array([errors.at(drive.times[0] + np.arange(0.0, 160.0, 40.0)) for drive in mapping.drives])
    assert 0.012 < between.std(axis=0).mean() < 0.028


def test_the_car_comes_again_on_the_same_day_and_on_another(campaign):
    same, other = campaign.again(1), campaign.again(2, day=2)
    assert same.scan_caster is campaign.scan_caster
    assert other.scan_drive.times[0] - campaign.scan_drive.times[0] == pytest.approx(86_400.0)
    epochs = [world.epochs(5) for world in (campaign, same, other)]
    assert len({epoch[2].reference for epoch in epochs}) == 3
    cities = [world.scan_caster.city for world in (campaign, other)]
    cars = [city.corners[city.classes == LasClass.VEHICLE] for city in cities]
    assert cars[0].shape != cars[1].shape or (cars[0] != cars[1]).any()
    np.testing.assert_array_equal(*(city.corners[city.classes != LasClass.VEHICLE] for city in cities))
    again = campaign.again(0)
    assert again.epochs(5) == epochs[0]
    assert again.gnss_priors(epochs[0]) == campaign.gnss_priors(epochs[0]) != same.gnss_priors(epochs[0])
