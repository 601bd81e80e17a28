"""Two walls and a floor: what lies between two visits is found, with a covariance that holds."""

import numpy as np
import pytest
from displaced_planes import CORNER, CORRIDOR, ORIGIN, moved, points_on

from maxcon.mapping.align.passes import Corrections, Pass, Passes
from maxcon.mapping.align.visits import PLACE_EDGE, PLACE_POINT, Places, Visit, match_visits, visits_of


def records_of(parts):
    """Records of passes, each of points seen within 5 s."""
    records = [np.empty(len(points), PLACE_POINT) for points in parts]
    for number, (record, points) in enumerate(zip(records, parts, strict=True)):
        record["time"] = 100.0 * number + np.linspace(0.0, 5.0, len(points))
        record["pass"], record["inside"] = number, points
    return np.concatenate(records)


def no_corrections(n_passes):
    passes = [
        Pass(f"pass {i + 1}", np.array([100.0 * i, 100.0 * i + 5.0]), np.zeros((2, 3)), 2, np.zeros(3))
        for i in range(n_passes)
    ]
    return Corrections.none(Passes("time", tuple(passes), np.zeros(n_passes, np.int64)), 10.0)


def constraint_between(planes, twist, seed):
    rng = np.random.default_rng(seed)
    first, second = (points_on(planes, 120, 0.01, rng) for _ in range(2))
    visits = visits_of(records_of([first, moved(second, twist)]))
    (constraint,) = match_visits(np.zeros(3), visits, no_corrections(2))
    return constraint


@pytest.mark.parametrize("seed", range(3))
def test_a_known_displacement_is_found(seed):
    rng = np.random.default_rng([seed, 1])
    twist = np.concatenate([rng.normal(0.0, 0.1, 3), rng.normal(0.0, np.radians(0.1), 3)])
    constraint = constraint_between(CORNER, twist, seed)
    assert constraint.fault == ""
    # the pose undoes the displacement: x -> R' (x - t)
    error = np.concatenate([constraint.pose.position + twist[:3], constraint.pose.values[3:] + twist[3:]])
    assert np.abs(error[:3]).max() < 0.004 and np.abs(error[3:]).max() < np.radians(0.03)
    sigmas = np.sqrt(np.diag(constraint.covariance))
    assert (np.abs(error) < 4.0 * sigmas).all() and (sigmas[:3] < 0.005).all()


def test_a_corridor_leaves_open_what_lies_along_it_and_other_places_are_no_ties():
    constraint = constraint_between(CORRIDOR, np.array([0.1, -0.07, 0.05, 0.0, 0.0, 0.001]), 0)
    assert constraint.fault == "" and np.sqrt(constraint.covariance[0, 0]) > 0.9
    assert np.sqrt(constraint.covariance[1, 1]) < 0.005
    assert constraint.pose.y == pytest.approx(0.07, abs=0.004)
    rng = np.random.default_rng(0)
    here = points_on(CORNER[:1], 120, 0.01, rng)
    there = points_on(CORNER[1:], 120, 0.01, rng) - [0.0, 2.0, -4.0]
    (constraint,) = match_visits(np.zeros(3), visits_of(records_of([here, there])), no_corrections(2))
    assert "too few points" in constraint.fault


def test_what_moved_meanwhile_does_not_pull():
    rng = np.random.default_rng(0)
    first, second = (points_on(CORNER, 120, 0.01, rng) for _ in range(2))
    car = (((0.0, 2.0, 1.2), (4.0, 0.0, 0.0), (0.0, 1.8, 0.0)), ((0.0, 2.0, 0.2), (4.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    parked = points_on(car, 400, 0.01, rng)
    parts = [np.concatenate([first, parked]), np.concatenate([second, parked + [0.3, 0.12, 0.05]])]
    (constraint,) = match_visits(np.zeros(3), visits_of(records_of(parts)), no_corrections(2))
    assert np.abs(constraint.pose.position).max() < 0.004


def test_pairs_of_many_visits_say_no_more_than_there_is():
    rng = np.random.default_rng(0)
    parts = [points_on(CORNER, 60, 0.01, rng) for _ in range(5)]
    visits = visits_of(records_of(parts))
    alone = match_visits(np.zeros(3), visits[:2], no_corrections(5))[0]
    constraints = match_visits(np.zeros(3), visits, no_corrections(5))
    assert len(constraints) == 10
    np.testing.assert_allclose(constraints[0].covariance, 2.5 * alone.covariance)


def test_visits_of_one_pass_are_told_apart_by_time():
    rng = np.random.default_rng(0)
    points = points_on(CORNER, 60, 0.01, rng)
    records = records_of([points])
    records["time"] = np.linspace(0.0, 50.0, len(records))
    assert len(visits_of(records)) == 3  # a long stop is three visits
    records["time"][len(records) // 2 :] += 15.0
    visits = visits_of(records)
    assert [round(visit.time) for visit in visits] == [6, 19, 46, 59]
    assert match_visits(np.zeros(3), visits, no_corrections(1)) == []  # less than a minute apart
    shuffled = visits_of(np.random.default_rng(1).permutation(records))
    again = Visit.from_arrays(Visit.to_arrays(visits))
    for one, other, read in zip(visits, shuffled, again, strict=True):
        np.testing.assert_array_equal(one.normals, other.normals)
        assert (one.pass_, one.time) == (read.pass_, read.time)
        np.testing.assert_array_equal(one.planes, read.planes)
        np.testing.assert_array_equal(one.points, read.points)


@pytest.mark.parametrize("where", ["in memory", "on disk"])
def test_points_come_back_from_their_squares(where, tmp_path, monkeypatch):
    """Of which two parts went into places."""
    if where == "on disk":
        monkeypatch.setattr("maxcon.mapping.build.tile_points.BUFFER_BYTES", 10_000)
    points = ORIGIN + np.random.default_rng(4).uniform([-60.0, -30.0, -2.0], [50.0, 70.0, 9.0], (3000, 3))
    places = Places(tmp_path, ORIGIN)
    for part in np.split(np.arange(3000), [1700]):
        places.add(points[part], part.astype(float), part % 7)
    places.buckets.complete()
    assert any(tmp_path.iterdir()) == (where == "on disk")
    squares = np.floor((points - ORIGIN)[:, :2] / PLACE_EDGE).astype(int)
    assert places.buckets.keys == sorted(set(map(tuple, squares.tolist())))
    for key in places.buckets.keys:
        mine = np.flatnonzero((squares == key).all(axis=1))
        found = places.points(key)
        assert found["time"].tolist() == mine.tolist()
        assert found["pass"].tolist() == (mine % 7).tolist()
        np.testing.assert_allclose(places.middle(key) + found["inside"], points[mine], atol=1e-5)
    whole = {key: places.points(key) for key in places.buckets.keys}
    monkeypatch.setattr("maxcon.mapping.align.visits.MOST_POINTS", 50)
    assert max(map(len, whole.values())) > 100
    for key, points in whole.items():  # of too many every nth
        assert np.array_equal(places.points(key), points[:: -(-len(points) // 50)])
