# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A coarse count before GICP: the window it searches, where it ends, what it says when nothing is there."""

import math

import pytest

from maxcon import Status
from maxcon.lab.baselines import CountThenGicp, Gicp


@pytest.fixture(scope="module", autouse=True)
def small_gicp():
    return pytest.importorskip("small_gicp")


@pytest.mark.parametrize(
    ("half_width", "heading", "cells", "turns_deg"),
    [(3.0, 2.0, (-4.0, 3.0), 2.0), (2.2, 1.5, (-4.0, 3.0), 2.0), (12.0, 0.0, (-13.0, 12.0), 0.0)],
)
def test_the_window_holds_either_boundary(half_width, heading, cells, turns_deg):
    space = CountThenGicp(half_width, heading).window
    assert (space.offsets[0], space.offsets[-1]) == cells
    assert math.degrees(space.headings[-1]) == pytest.approx(turns_deg)
    assert math.degrees(space.headings[0]) == pytest.approx(-turns_deg)


@pytest.mark.parametrize(("along", "across", "turn_deg"), [(9.0, -5.0, 8.0), (-11.5, 4.0, -9.0), (0.0, 0.0, 0.0)])
def test_it_ends_at_the_truth_from_where_gicp_alone_does_not(street, street_map, street_scan, along, across, turn_deg):
    prior = street.prior(along, across, turn_deg)
    fine = Gicp(3.0, thinning=0.3, target_edge=0.1, n_neighbours=15)
    found = CountThenGicp(12.0, 10.0, gicp=fine).localize(street_scan, street_map, prior)
    assert street.distance(found.pose) < 0.1
    alone = fine.localize(street_scan, street_map, prior)
    assert (street.distance(alone.pose) < 0.3) == (along == 0.0)


def test_its_word_is_that_of_gicp(same, street, street_map, street_scan):
    fine = Gicp(3.0, thinning=0.25, target_edge=0.25)
    method, prior = CountThenGicp(12.0, 10.0, gicp=fine), street.prior(9.0, -5.0, 8.0)
    assert method.localize(street_scan, street_map, prior).is_localized
    hasty = CountThenGicp(12.0, 10.0, gicp=Gicp(3.0, thinning=0.25, target_edge=0.25, max_iterations=1))
    assert hasty.localize(street_scan, street_map, prior).status == Status.NOT_CONVERGED


def test_other_priors_of_one_preparation_give_the_same(same, street, street_map, street_scan):
    method, prior = CountThenGicp(6.0, 5.0), street.prior(2.0, -1.0, 3.0)
    wanted = method.localize(street_scan, street_map, prior)
    aligner = method.prepare(street_scan, street_map, street.sensor, spread=5.0)
    found = aligner.align(prior)
    assert found.status == wanted.status
    assert math.dist(found.pose.position, wanted.pose.position) < 1e-6
    assert same(method.localize(street_scan, street_map, prior), wanted)
