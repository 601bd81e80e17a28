# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Two walls and a floor: what lies between two visits is found, with a covariance that holds."""

import numpy as np
import pytest

from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.matching import match_visits
from maxcon.mapping.align.places import PLACE_EDGE, PLACE_RECORD
from maxcon.mapping.align.rounds import Round, Rounds
from maxcon.mapping.align.visits import load_visits, save_visits, visits_of


def records_of(parts):
    """Records of rounds, each of points seen within 5 s."""
    records = [np.empty(len(points), PLACE_RECORD) for points in parts]
    for number, (record, points) in enumerate(zip(records, parts, strict=True)):
        record["time"] = 100.0 * number + np.linspace(0.0, 5.0, len(points))
        record["round"], record["inside"] = number, points
    return np.concatenate(records)


def no_corrections(n_rounds):
    rounds = [
        Round(f"round {i + 1}", np.array([100.0 * i, 100.0 * i + 5.0]), np.zeros((2, 3)), 2, np.zeros(3))
        for i in range(n_rounds)
    ]
    return Corrections.none(Rounds("time", tuple(rounds), np.zeros(n_rounds, np.int64)), 10.0)


def tie_between(scene, planes, twist, seed):
    rng = np.random.default_rng(seed)
    first, second = (scene.points_on(planes, 120, 0.01, rng) for _ in range(2))
    visits = visits_of(records_of([first, scene.moved(second, twist)]), PLACE_EDGE)
    (tie,) = match_visits(np.zeros(3), visits, no_corrections(2))
    return tie


@pytest.mark.parametrize("seed", range(6))
def test_a_known_displacement_is_found(scene, seed):
    rng = np.random.default_rng([seed, 1])
    twist = np.concatenate([rng.normal(0.0, 0.1, 3), rng.normal(0.0, np.radians(0.1), 3)])
    tie = tie_between(scene, scene.corner, twist, seed)
    assert tie.fault == ""
    # the pose undoes the displacement: x -> R' (x - t)
    error = np.concatenate([tie.pose.position + twist[:3], tie.pose.values[3:] + twist[3:]])
    assert np.abs(error[:3]).max() < 0.004
    assert np.abs(error[3:]).max() < np.radians(0.03)
    sigmas = np.sqrt(np.diag(tie.covariance))
    assert (np.abs(error) < 4.0 * sigmas).all()
    assert (sigmas[:3] < 0.005).all()


def test_a_corridor_leaves_open_what_lies_along_it(scene):
    tie = tie_between(scene, scene.corridor, np.array([0.1, -0.07, 0.05, 0.0, 0.0, 0.001]), 0)
    assert tie.fault == ""
    assert np.sqrt(tie.covariance[0, 0]) > 0.9
    assert np.sqrt(tie.covariance[1, 1]) < 0.005
    assert tie.pose.y == pytest.approx(0.07, abs=0.004)


def test_other_places_are_no_ties(scene):
    rng = np.random.default_rng(0)
    here = scene.points_on(scene.corner[:1], 120, 0.01, rng)
    there = scene.points_on(scene.corner[1:], 120, 0.01, rng) - [0.0, 2.0, -4.0]
    (tie,) = match_visits(np.zeros(3), visits_of(records_of([here, there]), PLACE_EDGE), no_corrections(2))
    assert "too few points" in tie.fault


def test_what_moved_meanwhile_does_not_pull(scene):
    rng = np.random.default_rng(0)
    first, second = (scene.points_on(scene.corner, 120, 0.01, rng) for _ in range(2))
    car = (((0.0, 2.0, 1.2), (4.0, 0.0, 0.0), (0.0, 1.8, 0.0)), ((0.0, 2.0, 0.2), (4.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    parked = scene.points_on(car, 400, 0.01, rng)
    parts = [np.concatenate([first, parked]), np.concatenate([second, parked + [0.3, 0.12, 0.05]])]
    (tie,) = match_visits(np.zeros(3), visits_of(records_of(parts), PLACE_EDGE), no_corrections(2))
    assert np.abs(tie.pose.position).max() < 0.004


def test_pairs_of_many_visits_say_no_more_than_there_is(scene):
    rng = np.random.default_rng(0)
    parts = [scene.points_on(scene.corner, 60, 0.01, rng) for _ in range(5)]
    visits = visits_of(records_of(parts), PLACE_EDGE)
    alone = match_visits(np.zeros(3), visits[:2], no_corrections(5))[0]
    ties = match_visits(np.zeros(3), visits, no_corrections(5))
    assert len(ties) == 10
    np.testing.assert_allclose(ties[0].covariance, 2.5 * alone.covariance)


def test_visits_of_one_round_are_told_apart_by_time(scene):
    rng = np.random.default_rng(0)
    points = scene.points_on(scene.corner, 60, 0.01, rng)
    records = records_of([points])
    records["time"] = np.linspace(0.0, 50.0, len(records))
    assert len(visits_of(records, PLACE_EDGE)) == 3  # a long stop is three visits
    records["time"][len(records) // 2 :] += 15.0
    visits = visits_of(records, PLACE_EDGE)
    assert [round(visit.time) for visit in visits] == [6, 19, 46, 59]
    assert match_visits(np.zeros(3), visits, no_corrections(1)) == []  # less than a minute apart
    shuffled = visits_of(np.random.default_rng(1).permutation(records), PLACE_EDGE)
    for one, other in zip(visits, shuffled, strict=True):
        np.testing.assert_array_equal(one.normals, other.normals)


def test_visits_are_read_as_they_were_written(scene, tmp_path):
    rng = np.random.default_rng(0)
    parts = [scene.points_on(scene.corner, 60, 0.01, rng) for _ in range(2)]
    visits = visits_of(records_of(parts), PLACE_EDGE)
    save_visits(tmp_path / "a.npz", visits)
    for one, other in zip(visits, load_visits(tmp_path / "a.npz"), strict=True):
        assert (one.round, one.time) == (other.round, other.time)
        np.testing.assert_array_equal(one.planes, other.planes)
        np.testing.assert_array_equal(one.points, other.points)
