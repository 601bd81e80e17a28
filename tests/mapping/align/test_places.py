# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Places: every point lies in its square, in the order in which it came, in memory or on disk."""

import numpy as np
import pytest

from maxcon.mapping.align import places as module
from maxcon.mapping.align.places import PLACE_EDGE, Places
from maxcon.mapping.build import spill

ORIGIN = np.array([550_000.0, 5_802_000.0, 60.0])


@pytest.fixture(params=["in memory", "on disk"])
def sorted_points(request, tmp_path, monkeypatch):
    """Points of which two parts went into places, with the places."""
    if request.param == "on disk":
        monkeypatch.setattr(spill, "BUFFER_BYTES", 10_000)
    points = ORIGIN + np.random.default_rng(4).uniform([-60.0, -30.0, -2.0], [50.0, 70.0, 9.0], (3000, 3))
    places = Places(tmp_path, ORIGIN)
    for part in np.split(np.arange(3000), [1700]):
        places.add(points[part], part.astype(float), part % 7)
    places.complete()
    assert any(tmp_path.iterdir()) == (request.param == "on disk")
    return points, places


def test_points_come_back_from_their_squares(sorted_points):
    points, places = sorted_points
    squares = np.floor((points - ORIGIN)[:, :2] / PLACE_EDGE).astype(int)
    assert places.keys == sorted(set(map(tuple, squares.tolist())))
    for key in places.keys:
        mine = np.flatnonzero((squares == key).all(axis=1))
        found = places.points(key)
        assert found["time"].tolist() == mine.tolist()
        assert found["round"].tolist() == (mine % 7).tolist()
        np.testing.assert_allclose(places.middle(key) + found["inside"], points[mine], atol=1e-5)


def test_of_too_many_points_every_nth_is_taken(sorted_points, monkeypatch):
    _, places = sorted_points
    whole = {key: places.points(key) for key in places.keys}
    monkeypatch.setattr(module, "MOST_POINTS", 50)
    assert max(map(len, whole.values())) > 100
    for key, points in whole.items():
        every = -(-len(points) // 50)
        assert np.array_equal(places.points(key), points[::every])
