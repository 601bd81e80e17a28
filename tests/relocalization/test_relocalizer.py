"""A scan is found in a whole map, at any heading, on level ground and on a slope; or it is said why not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from maxcon import PointMap, Scan, Status, Trust
from maxcon.errors import MapError, OptionError
from maxcon.lab.evaluation import pose_error
from maxcon.relocalization import Relocalizer
from maxcon.relocalization.coarse_map import CoarseMap
from maxcon.relocalization.relocalizer import _words
from towns import HEIGHT, Town, walls


@pytest.fixture(scope="module")
def town():
    return Town(11)


@pytest.fixture(scope="module")
def relocalizer(town):
    return Relocalizer(town.map)


def assert_right(estimate, truth):
    error = pose_error(estimate.pose, truth)
    assert estimate.is_localized, (estimate.status, estimate.reason)
    assert error.distance < 0.1 and abs(math.degrees(error.heading)) < 0.3


@pytest.mark.parametrize(("x", "y", "heading_deg"), [(-12.0, 20.3, 171.0), (18.1, -9.2, -88.5)])
def test_a_scan_is_found_at_any_place_and_heading(town, relocalizer, x, y, heading_deg):
    truth = town.pose(x, y, math.radians(heading_deg))
    found = relocalizer.search(town.scan(truth, 1))
    assert_right(found.estimate, truth)
    assert found.estimate.pose.z == pytest.approx(HEIGHT, abs=0.05) and found.n_others == 0
    assert found.n_cells == relocalizer.n_cells > 180 * 80 * 80
    assert np.isfinite(found.estimate.covariance).all()


def test_it_is_so_on_a_slope():
    town = Town(12, slope=(0.05, -0.03))
    truth = town.pose(10.0, -14.0, 2.0)
    assert_right(Relocalizer(town.map).localize(town.scan(truth, 2)), truth)


def test_a_scanner_held_askew_is_found_by_the_tilt_of_its_scan(town, relocalizer):
    truth = replace(town.pose(-12.0, 20.3, 3.0), roll=math.radians(-26.0), pitch=math.radians(25.0))
    assert_right(relocalizer.localize(town.scan(truth, 1)), truth)


def test_threads_do_not_change_the_answer(town, relocalizer):
    scan = town.scan(town.pose(-5.0, 5.0, 1.0), 3)
    one, three = relocalizer.search(scan), Relocalizer(town.map, n_threads=3).search(scan)
    assert one.places == three.places and one.estimate.pose == three.estimate.pose
    assert (one.n_coarse, one.n_half, one.n_others) == (three.n_coarse, three.n_half, three.n_others)


def test_a_town_that_is_there_twice_is_ambiguous_and_says_so():
    (points, normals), apart = walls(13), np.array([150.0, 0.0, 0.0])
    once = Town(13)
    twice = PointMap.from_points(
        np.concatenate([points, points + apart]), np.tile(normals, (2, 1)), 0.12,
        ground=np.concatenate([once.ground, once.ground + apart]),
    )  # fmt: skip
    truth = once.pose(2.0, 9.0, 0.7)
    scan, everywhere = once.scan(truth, 4), Relocalizer(twice)
    found = everywhere.search(scan)
    assert found.estimate.status is Status.AMBIGUOUS and found.n_others == 1
    assert "1 other place of the map could not be excluded" in found.estimate.reason
    assert sorted(round(pose.x / 150.0) for pose in found.places[:2]) == [0, 1]
    assert_right(everywhere.within((10.0, 0.0), 30.0).localize(scan), truth)


def test_a_scan_of_another_town_is_not_localized(relocalizer):
    other = Town(14)
    assert not relocalizer.localize(other.scan(other.pose(6.0, -3.0, 0.4), 1)).is_localized


def test_where_no_place_matches_enough_it_ends_early_and_says_so(town, relocalizer):
    scan = town.scan(town.pose(6.0, -3.0, 0.4), 1)
    wide = np.where(np.abs(scan.points[:, 2:] + HEIGHT) < 0.2, 1.0, [1.9, 0.6, 3.1])
    found = relocalizer.search(Scan(scan.points * wide))
    assert (found.estimate.status, found.n_coarse) == (Status.NO_MATCH, 0)
    assert "no place of the map matches as many points" in found.estimate.reason


def test_in_a_circle_without_the_true_place_it_is_not_localized(town, relocalizer, monkeypatch):
    monkeypatch.setattr(CoarseMap, "__init__", lambda *_: pytest.fail("tiles are made anew"))
    with pytest.raises(OptionError, match="radius"):
        relocalizer.within((10.0, 0.0), -1.0)
    scan = town.scan(town.pose(20.0, 20.0, 0.4), 5)
    assert not relocalizer.within((-20.0, -20.0), 15.0).localize(scan).is_localized
    inside = relocalizer.within((15.0, 15.0), 15.0)
    assert inside.localize(scan).is_localized and inside.n_cells < 180 * math.pi * 16.0**2 / 0.96**2
    assert (relocalizer.area, relocalizer.coarse.area, inside.coarse.area) == (None, None, inside.area)
    scan = town.scan(town.pose(10.0, 0.0, 0.4), 6)  # at the boundary
    assert relocalizer.within((0.0, 0.0), 10.3).localize(scan).status is Status.AT_RIM


def test_the_words_say_what_is_left():
    more = "beyond 64 places others match nearly as many points"
    assert _words(1, has_more=False) == "1 other place of the map could not be excluded"
    assert _words(2, has_more=True) == f"2 other places of the map could not be excluded; {more}"
    assert _words(0, has_more=True) == more


@pytest.mark.parametrize("largest", [0.0, 1.0])
def test_any_share_may_be_asked_for(town, largest):
    truth = town.pose(0.4, 0.7, 2.2)
    estimate = Relocalizer(town.map, trust=Trust(largest_runner_up=largest)).localize(town.scan(truth, 8))
    assert pose_error(estimate.pose, truth).distance < 0.1
    assert estimate.is_localized == (largest > 0.0)


@pytest.mark.parametrize(
    "points", [np.empty((0, 3)), [[5.0, 0.0, 0.0]], np.random.default_rng(0).uniform(-1.0, 1.0, (500, 3)), None]
)
def test_a_scan_without_ground_or_of_bare_ground_matches_nothing(town, relocalizer, points):
    words = "the scan shows no ground around it"
    if points is None:
        points, words = town.ground[np.hypot(*town.ground[:, :2].T) < 25.0] - [0.0, 0.0, HEIGHT], "above the ground"
    found = relocalizer.search(Scan(points, np.tile([0.0, 0.0, 1.0], (len(points), 1))))
    assert (found.estimate.status, found.places) == (Status.NO_MATCH, ())
    assert words in found.estimate.reason


def test_maps_that_are_refused(town):
    with pytest.raises(MapError, match="ground"):
        Relocalizer(PointMap.from_points(*walls(0), 0.12))
    with pytest.raises(MapError, match=r"half a metre.*got 0.8 m"):
        Relocalizer(PointMap.from_points(town.walls, town.normals, 0.8, ground=town.ground))
    with pytest.raises(MapError, match="within 20 m"):
        Relocalizer(town.map, (500.0, 0.0), 20.0).localize(Scan(np.zeros((1, 3))))


@pytest.mark.parametrize("cell", [0.02, 0.06, 0.5])
def test_of_any_map_candidates_are_counted_again_in_cells_half_as_large(cell):
    low = [[0.1, 0.1, 0.0]]
    relocalizer = Relocalizer(PointMap.from_points(low, [[0.0, 0.0, 1.0]], cell, ground=low))
    assert relocalizer._half.cell == pytest.approx(0.5 * relocalizer.coarse.map.cell)


@pytest.mark.parametrize("options", [{"radius": 0.0}, {"radius": math.nan}, {"n_threads": 0}, {"risk": 1.0}])
def test_numbers_out_of_range_are_refused(town, options):
    with pytest.raises(OptionError, match=next(iter(options))):
        Relocalizer(town.map, (0.0, 0.0), **options)
