# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The sample of places: whole places, evenly chosen, the same in any order, and never too many points."""

import numpy as np
import pytest

from maxcon.mapping.build.place_sample import PLACE_EDGE, PlaceSample


def some_points(n=20_000, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-10.0, 10.0, (n, 3)) * [1.0, 1.0, 0.1], rng.uniform(0.0, 1000.0, n)


def sampled(points, times, most_points, n_parts=1):
    sample = PlaceSample(most_points)
    for part in np.array_split(np.arange(len(points)), n_parts):
        sample.add(points[part], times[part])
    return sample.records()


def cubes(points):
    return np.floor(points / PLACE_EDGE).astype(int)


def test_all_points_are_kept_while_they_are_few():
    points, times = some_points()
    records = sampled(points, times, len(points))
    assert len(records) == len(points)
    assert len(np.unique(records["place"])) == len(np.unique(cubes(points), axis=0))
    order = np.argsort(records["time"])
    inside = points - (cubes(points) + 0.5) * PLACE_EDGE
    np.testing.assert_allclose(records["inside"][order], inside[np.argsort(times)], atol=1e-6)


def test_records_come_place_by_place_in_the_order_of_time():
    records = sampled(*some_points(), 20_000, n_parts=7)
    steps = np.diff(records["place"].astype(object))
    assert (steps >= 0).all()
    assert (np.diff(records["time"])[steps == 0] >= 0.0).all()


@pytest.mark.parametrize("most_points", [12_000, 3_000, 700])
def test_of_many_points_those_of_some_places_are_kept_whole_and_evenly(most_points):
    points, times = some_points()
    records = sampled(points, times, most_points)
    assert 0.3 * most_points < len(records) <= most_points
    everything = sampled(points, times, len(points))
    kept = np.isin(everything["place"], records["place"])
    np.testing.assert_array_equal(everything[kept], records)
    at = points[np.isin(times, records["time"])]
    assert abs(at[:, :2].mean(axis=0)).max() < 15.0 / np.sqrt(len(np.unique(records["place"])))


@pytest.mark.parametrize("n_parts", [1, 3, 50])
def test_the_sample_depends_neither_on_parts_nor_on_their_order(n_parts):
    points, times = some_points()
    wanted = sampled(points, times, 3_000)
    order = np.random.default_rng(1).permutation(len(points))
    np.testing.assert_array_equal(sampled(points[order], times[order], 3_000, n_parts), wanted)


def test_points_without_times_are_left_out():
    points, times = some_points(100)
    sample = PlaceSample()
    sample.add(points, None)
    sample.add(points[:0], times[:0])
    sample.add(points, np.where(np.arange(100) < 40, np.nan, times))
    assert len(sample.records()) == 60
