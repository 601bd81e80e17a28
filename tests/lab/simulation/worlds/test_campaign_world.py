# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The campaign before it is written: rounds, epochs, priors, and what changed between the days."""

from itertools import pairwise

import numpy as np
import pytest
from maxcon.lab.simulation.world import map_echoes, map_pieces

from maxcon.errors import OptionError
from maxcon.geometry import wrap_angle
from maxcon.lab.simulation import CampaignWorld, GnssErrors, LasClass, PriorErrors, ProfileScanner

THIN = (ProfileScanner(line_rate=1.0, points_per_line=90),)


def test_the_round_takes_300_s_and_ends_where_it_began(campaign):
    drive = campaign.scan_drive
    assert drive.times[-1] - drive.times[0] == pytest.approx(300.0, abs=1e-6)
    gap = drive.positions[-1] - drive.positions[0]
    assert np.linalg.norm(gap) < 0.7  # it wanders in its lane
    assert abs(wrap_angle(drive.angles[-1, 2] - drive.angles[0, 2])) < np.radians(3.0)


def test_all_epochs_are_a_tenth_of_a_second_apart(campaign):
    epochs = campaign.epochs()
    assert len(epochs) == 3001
    times = np.array([epoch.time for epoch in epochs])
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-6)
    assert times[-1] - times[0] == pytest.approx(300.0, abs=1e-6)
    places = np.array([epoch.reference.position for epoch in epochs])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.7


@pytest.mark.parametrize("n_epochs", [1, 2, 7, 200, 3000])
def test_fewer_epochs_are_some_of_all_over_the_same_round(campaign, n_epochs):
    everything = {epoch.tick: epoch for epoch in campaign.epochs()}
    some = campaign.epochs(n_epochs)
    assert len({epoch.tick for epoch in some}) == n_epochs
    assert all(epoch == everything[epoch.tick] for epoch in some)
    ticks = np.array([epoch.tick for epoch in some])
    assert ticks[0] == 0
    if n_epochs > 1:
        assert ticks[-1] == 3000
        assert np.ptp(np.diff(ticks)) <= 1


def test_priors_at_a_time_do_not_depend_on_the_number_of_epochs(campaign):
    few, many = campaign.epochs(4), {epoch.tick: row for row, epoch in enumerate(campaign.epochs(3001))}
    for priors, errors in ((campaign.gnss_priors, GnssErrors()), (campaign.uniform_priors, PriorErrors())):
        of_all = priors(campaign.epochs(3001), errors)
        assert priors(few, errors) == [of_all[many[epoch.tick]] for epoch in few]


def test_priors_are_off_by_their_errors(campaign):
    epochs = campaign.epochs(100)
    for priors, bound in (
        (campaign.gnss_priors(epochs, GnssErrors()), 2.7),
        (campaign.uniform_priors(epochs, PriorErrors()), 2.5),
    ):
        offsets = np.array(
            [prior.position - epoch.reference.position for prior, epoch in zip(priors, epochs, strict=True)]
        )
        turns = [
            wrap_angle(prior.heading - epoch.reference.heading) for prior, epoch in zip(priors, epochs, strict=True)
        ]
        assert 0.8 < np.abs(offsets[:, :2]).max() <= bound
        assert np.abs(offsets[:, 2]).max() <= 0.04
        assert 0.2 < np.degrees(np.abs(turns)).max() <= 1.8


def test_gnss_errors_change_slowly_and_uniform_ones_at_once(campaign):
    epochs = campaign.epochs(3001)
    reference = np.array([epoch.reference.position for epoch in epochs])

    def steps(priors):
        return np.linalg.norm(np.diff([prior.position for prior in priors] - reference, axis=0)[:, :2], axis=1)

    assert np.median(steps(campaign.gnss_priors(epochs, GnssErrors()))) < 0.3
    assert np.median(steps(campaign.uniform_priors(epochs, PriorErrors()))) > 1.0


def test_five_rounds_of_differing_speed(campaign):
    drives = campaign.mapping.drives
    assert len(drives) == 5
    durations = np.array([drive.times[-1] - drive.times[0] for drive in drives])
    means = campaign.circuit.length / durations
    assert (means > 5.5).all()
    assert (means < 9.0).all()
    assert np.diff(np.sort(durations)).min() > 0.5
    assert all(late.times[0] > early.times[-1] for early, late in pairwise(drives))
    for drive in drives:
        positions, _ = drive.at(np.arange(drive.times[0], drive.times[-1], 0.5))
        speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) / 0.5
        assert np.percentile(speeds, 95) > 2.0 * np.percentile(speeds, 5)


def test_rounds_lie_decimetres_apart(campaign):
    lanes = np.array(
        [drive.at(drive.times)[0][:: len(drive.times) // 50][:50, :2] for drive in campaign.mapping.drives]
    )
    nearest = [np.linalg.norm(campaign.circuit.points[:, None] - lane[None, :5], axis=2).min(axis=0) for lane in lanes]
    assert 0.02 < np.mean(nearest) < 0.3


def test_rounds_are_off_by_2_cm_and_points_as_much_as_the_trajectory(campaign):
    true = map_echoes(campaign.mapping.caster, map_pieces(campaign.mapping.drives, THIN), [campaign.seed, 5])
    for echoes, placed in zip(true, campaign.mapping.echoes(THIN), strict=True):
        offsets = campaign.mapping.georeferencing.at(echoes.times)
        np.testing.assert_allclose(placed.points - echoes.points, offsets, atol=1e-9)
        np.testing.assert_array_equal(placed.classes, echoes.classes)
        assert 0.0 < np.abs(offsets).max() < 0.1
    times, poses = campaign.mapping.poses()
    drives = campaign.mapping.drives
    rows = np.searchsorted(times, [drive.times[0] + 60.0 for drive in drives])
    for row, drive in zip(rows, drives, strict=True):
        (true_pose,) = drive.poses([times[row]])
        (offset,) = campaign.mapping.georeferencing.at([times[row]])
        np.testing.assert_allclose(poses[row].position - true_pose.position, offset, atol=1e-9)
    between = np.array(
        [campaign.mapping.georeferencing.at(drive.times[0] + np.arange(0.0, 160.0, 40.0)) for drive in drives]
    )
    assert 0.012 < between.std(axis=0).mean() < 0.028


def test_parked_cars_have_moved(campaign):
    days = [caster.city for caster in (campaign.mapping.caster, campaign.scan_caster)]
    cars = [city.corners[city.classes == LasClass.VEHICLE] for city in days]
    assert min(len(car) for car in cars) > 50_000  # 100 and more triangles each
    assert len(np.intersect1d(cars[0][:, 0, 0], cars[1][:, 0, 0])) == 0
    rest = [city.corners[city.classes != LasClass.VEHICLE] for city in days]
    np.testing.assert_array_equal(*rest)


def test_no_car_is_in_the_way(campaign):
    city = campaign.scan_caster.city
    cars = city.corners[city.classes == LasClass.VEHICLE].mean(axis=1)[:, :2]
    for place in campaign.circuit.points[::100]:
        assert np.linalg.norm(cars - place, axis=1).min() > 0.9


def test_a_scan_is_the_same_whichever_others_are_taken(campaign, thin_scanner):
    first, second = campaign.epochs(3)[1], campaign.epochs(3001)[1500]
    scans = [campaign.scan(epoch, thin_scanner) for epoch in (first, second)]
    np.testing.assert_array_equal(scans[0].points, scans[1].points)
    other = campaign.scan(campaign.epochs(3001)[1501], thin_scanner)
    assert not np.array_equal(other.points[:20], scans[0].points[:20])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"seed": -1}, "Expected a seed of 0 or more, got -1"),
        ({"seed": 1, "n_rounds": 0}, "Expected at least one round of mapping, got 0"),
    ],
)
def test_wrong_worlds_are_refused(wrong, words):
    with pytest.raises(OptionError, match=words):
        CampaignWorld.build(**wrong)


def test_the_car_comes_again_on_the_same_day_and_on_another(campaign):
    same, other = campaign.again(1), campaign.again(2, day=2)
    assert same.scan_caster is campaign.scan_caster
    assert other.scan_drive.times[0] - campaign.scan_drive.times[0] == pytest.approx(86_400.0)
    epochs = [world.epochs(5) for world in (campaign, same, other)]
    assert len({epoch[2].reference for epoch in epochs}) == 3
    cars = [world.scan_caster.city.corners[world.scan_caster.city.car_numbers >= 0] for world in (campaign, other)]
    assert cars[0].shape != cars[1].shape or (cars[0] != cars[1]).any()
    fixed = [world.scan_caster.city.corners[world.scan_caster.city.car_numbers < 0] for world in (campaign, other)]
    np.testing.assert_array_equal(*fixed)
    again = campaign.again(0)
    assert again.epochs(5) == epochs[0]
    assert again.gnss_priors(epochs[0], GnssErrors()) == campaign.gnss_priors(epochs[0], GnssErrors())
    assert same.gnss_priors(epochs[0], GnssErrors()) != campaign.gnss_priors(epochs[0], GnssErrors())
    for number, day in ((-1, 1), (0, 0)):
        with pytest.raises(OptionError, match="number of a drive"):
            campaign.again(number, day)


def test_every_triangle_of_a_car_has_its_number(campaign):
    city = campaign.scan_caster.city
    np.testing.assert_array_equal(city.car_numbers >= 0, city.classes == LasClass.VEHICLE)
    assert set(np.unique(city.car_numbers)) == set(range(-1, city.car_numbers.max() + 1))
    first = city.corners[city.car_numbers == 0].reshape(-1, 3)
    assert np.ptp(first[:, :2], axis=0).max() < 6.0
