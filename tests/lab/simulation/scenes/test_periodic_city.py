# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Facades that repeat to the millimetre, and items of which a quarter goes."""

import numpy as np
import pytest

from maxcon.lab.simulation import CAMPAIGN_GRID, LasClass, StreetGrid
from maxcon.lab.simulation.city import build_periodic_city, periodic_front

CROSS = StreetGrid(u_lines=(0.0,), v_lines=(0.0,), carriageway=4.2, sidewalk=1.8, margin=60.0)


@pytest.fixture(scope="module")
def periodic_city():
    return build_periodic_city(1)


def _triangles(corners):
    """Triangles as a set: corners in order of their coordinates, rounded to the millimetre."""
    rows = np.round(corners.reshape(len(corners), -1), 3).astype(np.float32) + np.float32(0.0)
    return {tuple(row) for row in rows.tolist()}


def _wall(length):
    """The front without its roof, which is mitred at the corners."""
    corners = periodic_front(length).corners
    return corners[corners[..., 2].max(axis=1) <= 13.8 + 1e-9]


def test_relief_repeats_every_3_m():
    wall = _wall(27.0)
    inner = wall[(wall[..., 0].min(axis=1) > 2.9) & (wall[..., 0].max(axis=1) < 21.1)]
    assert len(inner) > 500
    for n_periods in (1, 2):
        assert _triangles(inner + np.array([3.0 * n_periods, 0.0, 0.0])) <= _triangles(wall)
    for shift in (1.0, 1.5, 2.0):
        assert len(_triangles(inner + np.array([shift, 0.0, 0.0])) & _triangles(wall)) < 0.2 * len(inner)


def test_relief_is_real():
    depths = np.unique(np.round(_wall(9.0)[..., 1], 3))
    np.testing.assert_allclose(depths, [-0.18, 0.0, 0.2])


def test_a_front_is_as_long_as_asked():
    for length in (9.0, 10.0):
        x = _wall(length)[..., 0]
        assert (x.min(), x.max()) == (0.0, length)


def test_facades_keep_the_period_along_the_whole_street(periodic_city):
    fabric = periodic_city.fabric
    fronts = fabric.corners[fabric.classes == LasClass.BUILDING]
    v = CAMPAIGN_GRID.v_lines[0] + CAMPAIGN_GRID.half_width
    on_line = np.abs(fronts[..., 1] - v + 0.2).max(axis=1) < 1e-6  # pilasters of one side of the first street
    edges = np.unique(np.round(fronts[on_line][..., 0], 6))
    phases = np.round(edges % 3.0, 6) % 3.0
    assert np.ptp(edges) > 300.0
    assert set(phases) == {0.0, 0.25, 2.75}


def test_the_fabric_knows_no_chance(periodic_city):
    other = build_periodic_city(2)
    np.testing.assert_array_equal(other.fabric.corners, periodic_city.fabric.corners)
    assert not np.array_equal(other.items[0].patch.corners, periodic_city.items[0].patch.corners)


def test_items_have_numbers_of_their_own_and_every_class(periodic_city):
    assert [item.number for item in periodic_city.items] == list(range(len(periodic_city.items)))
    classes = {int(value) for item in periodic_city.items for value in np.unique(item.patch.classes)}
    others = {LasClass.UNCLASSIFIED, LasClass.GROUND, LasClass.VEHICLE}
    assert classes == {int(member) for member in LasClass} - others


def test_a_quarter_of_the_items_goes_and_nothing_else():
    periodic_city = build_periodic_city(1, grid=CROSS)
    gone = periodic_city.draw_gone(5)
    assert len(gone) == round(0.25 * len(periodic_city.items))
    assert gone == periodic_city.draw_gone(5)
    assert gone != periodic_city.draw_gone(6)
    before, after = periodic_city.city(), periodic_city.city(gone)
    n_gone = sum(len(item.patch) for item in periodic_city.items if item.number in gone)
    assert len(before.triangles) - len(after.triangles) == n_gone
    assert _triangles(after.corners) < _triangles(before.corners)


def test_items_keep_no_period(periodic_city):
    middles = np.array([item.patch.corners.mean(axis=(0, 1))[0] for item in periodic_city.items])
    counts, _ = np.histogram(middles % 3.0, bins=6, range=(0.0, 3.0))
    assert counts.min() > 0.08 * len(middles)
    assert len(np.unique(np.round(middles, 3))) > 0.4 * len(middles)
