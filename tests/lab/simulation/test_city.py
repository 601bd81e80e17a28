"""Streets and cities: seeded, turned, with every class; facades that repeat; cars and items that change."""

import numpy as np

from maxcon.lab.simulation.city import build_city, build_periodic_city
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.streets import CAMPAIGN_GRID, StreetGrid

CROSS = StreetGrid(u_lines=(0.0,), v_lines=(0.0,), carriageway=4.0, sidewalk=2.0, margin=30.0)
VEHICLES = LasClass.VEHICLE


def test_every_class_is_there_and_no_facade_is_parallel_to_an_axis(city):
    assert set(np.unique(city.classes)) == set(LasClass) - {LasClass.UNCLASSIFIED}
    assert np.abs(city.corners).max() < 400.0  # finite, and float32 is good to 0.03 mm there
    normals = np.cross(city.corners[:, 1] - city.corners[:, 0], city.corners[:, 2] - city.corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)  # twice the areas of triangles
    upright = (city.classes == LasClass.BUILDING) & (np.abs(normals[:, 2]) < 1e-6 * lengths) & (lengths > 1.0)
    assert upright.sum() > 1000
    assert (np.abs(normals[upright, :2]) / lengths[upright, None]).min() > 0.4


def test_parked_cars_change_and_nothing_else():
    city = build_city(1, CROSS._replace(margin=60.0))
    monday, tuesday = city.with_parked_cars(1), city.with_parked_cars(2)
    np.testing.assert_array_equal(monday.corners, tuesday.with_parked_cars(1).corners)
    assert not np.array_equal(monday.corners, tuesday.corners)
    np.testing.assert_array_equal(*(one.corners[one.classes != VEHICLES] for one in (monday, tuesday)))
    assert not (city.with_parked_cars(1, occupancy=0.0).classes == VEHICLES).any()


def _triangles(corners):
    """Triangles as a set: corners in order of their coordinates, rounded to the millimetre."""
    rows = np.round(corners.reshape(len(corners), -1), 3).astype(np.float32) + np.float32(0.0)
    return {tuple(row) for row in rows.tolist()}


def test_facades_keep_the_period_along_the_whole_street_whatever_the_seed():
    fabric = build_periodic_city(1).fabric
    fronts = fabric.corners[fabric.classes == LasClass.BUILDING]
    v = CAMPAIGN_GRID.v_lines[0] + CAMPAIGN_GRID.half_width
    on_line = np.abs(fronts[..., 1] - v + 0.2).max(axis=1) < 1e-6  # pilasters of one side of the first street
    edges = np.unique(np.round(fronts[on_line][..., 0], 6))
    assert np.ptp(edges) > 300.0 and set(np.round(edges % 3.0, 6) % 3.0) == {0.0, 0.25, 2.75}
    one, other = (build_periodic_city(seed, CROSS) for seed in (1, 2))
    np.testing.assert_array_equal(one.fabric.corners, other.fabric.corners)
    assert not np.array_equal(one.items[0].corners, other.items[0].corners)


def test_a_quarter_of_the_items_goes_and_nothing_else():
    city = build_periodic_city(1, CROSS._replace(margin=60.0))
    gone = city.draw_gone(5)
    assert len(gone) == round(0.25 * len(city.items)) and gone == city.draw_gone(5)
    assert gone != city.draw_gone(6)
    before, after = city.city(), city.city(gone)
    assert len(before) - len(after) == sum(len(city.items[number]) for number in gone)
    assert _triangles(after.corners) < _triangles(before.corners)
