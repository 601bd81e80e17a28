# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The city: the same for the same seed, turned, with every class, and with cars that change."""

import numpy as np

from maxcon.lab.simulation import LasClass, build_city
from maxcon.lab.simulation.facades import relief
from maxcon.lab.simulation.furniture import boxes


def _areas_and_normals(city):
    corners = city.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    return 0.5 * doubled, cross / np.where(doubled > 0.0, doubled, 1.0)[:, None]


def test_same_seed_same_city():
    first, second, other = build_city(1), build_city(1), build_city(2)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.classes, second.classes)
    assert first.vertices.shape != other.vertices.shape or not np.array_equal(first.vertices, other.vertices)


def test_every_class_is_there(city):
    assert set(np.unique(city.classes)) == {int(member) for member in LasClass} - {LasClass.UNCLASSIFIED}


def test_arrays_fit_together(city):
    assert city.triangles.shape == (len(city.classes), 3)
    assert city.triangles.min() >= 0
    assert city.triangles.max() < len(city.vertices)
    assert np.isfinite(city.vertices).all()
    assert np.abs(city.vertices).max() < 400.0  # float32 is good to 0.03 mm there


def test_parked_cars_change_and_nothing_else(city):
    monday, tuesday = city.with_parked_cars(1), city.with_parked_cars(2)
    again = tuesday.with_parked_cars(1)
    np.testing.assert_array_equal(monday.vertices, again.vertices)
    assert (monday.classes == LasClass.VEHICLE).sum() != (tuesday.classes == LasClass.VEHICLE).sum()
    fixed = [one.corners[one.classes != LasClass.VEHICLE] for one in (monday, tuesday)]
    np.testing.assert_array_equal(*fixed)


def test_occupancy_zero_is_an_empty_street(city):
    assert not (city.with_parked_cars(1, occupancy=0.0).classes == LasClass.VEHICLE).any()


def test_cars_stand_at_the_kerbs(city):
    angle = city.street_angle
    across = np.array([-np.sin(angle), np.cos(angle)])
    cars = city.corners[city.classes == LasClass.VEHICLE].reshape(-1, 3)
    along = cars[:, :2] @ np.array([np.cos(angle), np.sin(angle)])
    beside_main_street = np.abs(cars[:, :2] @ across) < 20.0
    in_block = (along > -120.0) & (along < -20.0)
    offset = np.abs(cars[beside_main_street & in_block, :2] @ across)
    assert offset.min() > 2.3  # the lane stays free
    assert offset.max() < 5.4


def test_street_lines_follow_the_angle():
    city = build_city(0, street_angle_deg=31.0)
    main, cross = (line[1] - line[0] for line in city.street_lines[:2])
    assert np.isclose(np.degrees(np.arctan2(main[1], main[0])), 31.0)
    assert np.isclose(main @ cross, 0.0, atol=1e-9)


def test_no_facade_is_parallel_to_an_axis(city):
    areas, normals = _areas_and_normals(city)
    upright = (city.classes == LasClass.BUILDING) & (np.abs(normals[:, 2]) < 1e-6) & (areas > 0.5)
    assert upright.sum() > 1000
    assert np.abs(normals[upright, :2]).min() > 0.4


def test_relief_of_one_window():
    patch = relief(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, 2.0, 3.0]), np.pad([[0.2]], 1))
    cross = np.cross(patch.corners[:, 1] - patch.corners[:, 0], patch.corners[:, 2] - patch.corners[:, 0])
    areas = 0.5 * np.abs(cross).sum(axis=0)
    np.testing.assert_allclose(areas, [2 * 0.2, 9.0, 2 * 0.2])  # two reveals, the wall with its pane, lintel and sill
    assert np.isclose(patch.corners[:, :, 1].min(), -0.2)


def test_box_has_the_surface_of_a_box():
    corners = boxes([[0.0, 0.0, 0.0]], [[1.0, 2.0, 3.0]], LasClass.POLE).corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.isclose(0.5 * np.linalg.norm(cross, axis=1).sum(), 2 * (2 + 3 + 6))
