# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A coarse count before GICP: the window it searches, where it ends, what it says when nothing is there."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from maxcon import Scan, Status
from maxcon.errors import OptionError
from maxcon.lab.baselines import CountThenGicp, Gicp


@pytest.fixture(scope="module", autouse=True)
def small_gicp():
    return pytest.importorskip("small_gicp")


@pytest.mark.parametrize(
    ("half_width", "heading", "cells", "turns_deg"),
    [(3.0, 2.0, (-4.0, 3.0), 2.0), (2.2, 1.5, (-4.0, 3.0), 2.0), (12.0, 0.0, (-13.0, 12.0), 0.0)],
)
def test_the_window_holds_either_rim(half_width, heading, cells, turns_deg):
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


def test_nothing_there_is_no_match(street, street_map, street_scan):
    far = replace(street.sensor, x=street.sensor.x + 5000.0)
    found = CountThenGicp().localize(street_scan, street_map, far)
    assert (found.status, found.pose) == (Status.NO_MATCH, far)
    empty = CountThenGicp().localize(Scan(np.empty((0, 3))), street_map, street.sensor)
    assert (empty.status, empty.pose) == (Status.NO_MATCH, street.sensor)


def test_pickled_it_is_the_same_method():
    method = CountThenGicp(12.0, 10.0, gicp=Gicp(1.0))
    assert pickle.loads(pickle.dumps(method)) == method


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"half_width": 0.0}, "`half_width` > 0 m, got 0.0. The default is 3"),
        ({"heading_half_width_deg": -1.0}, "`heading_half_width_deg` >= 0 degrees"),
        ({"voxel": math.nan}, "`voxel` > 0 m"),
        ({"heading_step_deg": 0.0}, "`heading_step_deg` > 0 degrees"),
        ({"thinning": -0.1}, "`thinning` >= 0 m"),
    ],
)
def test_options_out_of_range(options, words):
    with pytest.raises(OptionError, match=words):
        CountThenGicp(**options)
