"""Validation of a best cell: what stays in doubt, what the ground is worth, which walls are missing, and the words."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan, Trust
from maxcon.estimate import Estimate, Status
from maxcon.refine import GroundFit, Refined, WallShare, adjustment, least_wall_share, refine, validate
from maxcon.refine.adjustment import HEIGHT_SIGMA, PASSES, TILT_SIGMA
from upright_walls import joined, scattered

HERE = Pose(0.2, -0.1, 1.6, 0.0, 0.0, 0.3)
ON_GROUND = replace(HERE, z=1.55, roll=0.01)
RISK = 0.01


def wall(azimuth_deg, distance, n, rng):
    """Points of a wall that faces the origin, seen at an azimuth; and its normals."""
    c, s = math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))
    middle, along = distance * np.array([c, s]), 6.0 * np.array([-s, c])
    return scattered(middle - along, middle + along, n, rng, (-1.0, 4.0))


@pytest.fixture(scope="module")
def room():
    """Four walls 5 m away, of 60,000 points each."""
    rng = np.random.default_rng(1)
    points, normals = joined(*(wall(azimuth, 5.0, 60_000, rng) for azimuth in (0, 90, 180, 270)))
    return points, normals, PointMap.from_points(points, normals, 0.06)


def seen(room, n_points):
    """A scan of some points of each wall, wall by wall."""
    rows = (np.arange(4)[:, None] * 60_000 + np.arange(n_points // 4)).ravel()
    return Scan((room[0][rows] - HERE.position) @ HERE.rotation, room[1][rows] @ HERE.rotation)


def found(status=Status.LOCALIZED, reason=""):
    return Estimate(HERE, 100.0, (0, 0, 0), status, 0.01 * np.eye(2), 0.9, 0.1, reason)


def ground(sigma_height=0.01, sigma_tilt=0.001):
    return GroundFit(ON_GROUND, -0.05, 0.01, 0.02, 100, 0.9, sigma_height, sigma_tilt)


@pytest.fixture
def asked(monkeypatch):
    """The refinement, which remembers what it was asked for."""
    watched = Mock(wraps=refine)
    monkeypatch.setattr(adjustment, "refine", watched)
    return watched


def test_an_answer_in_doubt_gets_the_height_and_tilt_of_its_ground_and_is_not_refined(asked, room):
    doubted = found(Status.AMBIGUOUS)
    for fit, pose in ((ground(), ON_GROUND), (None, HERE)):
        answer = validate(doubted, fit, seen(room, 3000), room[2], Trust(), RISK)
        assert (answer.pose, answer.status, answer.score) == (pose, Status.AMBIGUOUS, doubted.score)
        assert not np.isfinite(np.diag(answer.covariance)).any()
    asked.assert_not_called()


@pytest.mark.parametrize(("fit", "height_sigma", "tilt_sigma"), [
    (None, HEIGHT_SIGMA, TILT_SIGMA),
    (ground(0.001, 0.0001), 0.01, 0.003),
    (ground(0.05, 0.0001), 0.05, 0.003),
    (ground(0.001, 0.02), 0.01, 0.02),
])  # fmt: skip
def test_the_ground_tells_no_more_than_map_and_walls_agree_on(asked, room, fit, height_sigma, tilt_sigma):
    answer = validate(found(), fit, seen(room, 3000), room[2], Trust(), RISK)
    asked.assert_called_once()
    told = dict(asked.call_args.kwargs)
    assert asked.call_args.args[2] == (HERE if fit is None else ON_GROUND)
    assert (told.pop("height_sigma"), told.pop("tilt_sigma"), told.pop("passes")) == (height_sigma, tilt_sigma, PASSES)
    assert list(told) == ["table"] and answer.is_localized
    assert answer.pose.position[:2] == pytest.approx(HERE.position[:2], abs=0.01)
    assert np.isfinite(answer.covariance).all() and np.isfinite(answer.protection_level).all()


def test_too_few_points_on_planes_are_told_by_number_and_what_was_said_before_stays(room):
    strict = Trust(fewest_planes=10_000)
    answer = validate(found(reason="only 800 points"), None, seen(room, 800), room[2], strict, RISK)
    assert (answer.status, answer.pose) == (Status.NOT_CONFIRMED, HERE)
    first, second = answer.reason.split("; ")
    number, words = second.split(" ", 1)
    assert (first, words) == ("only 800 points", "points on planes of the map, 0.00 m from the best cell")
    assert 100 < int(number) <= 800
    assert not np.isfinite(answer.covariance).any(where=np.eye(6, dtype=bool))


def test_walls_that_are_not_there_are_named_unless_a_wider_search_confirmed_the_place(room):
    scan = seen(room, 3000)
    beside, quarter = np.array(scan.points), len(scan) // 4
    for number, offset in ((0, 3.0), (2, -3.0)):  # two walls stand 3 m farther apart
        beside[number * quarter : (number + 1) * quarter] += HERE.rotation.T @ [offset, 0.0, 0.0]
    moved, lenient = Scan(beside, scan.normals), Trust(least_confirmed_share=0.0)
    answer = validate(found(), None, moved, room[2], Trust(), RISK)
    assert answer.status is Status.WALLS_MISSING
    assert "wall" in answer.reason and "planes" not in answer.reason
    assert validate(found(), None, moved, room[2], lenient, RISK).status is Status.WALLS_MISSING
    assert validate(found(), None, moved, room[2], lenient, RISK, is_confirmed=True).is_localized


def test_a_scan_without_walls_has_nothing_that_could_confirm_it(room):
    lenient = Trust(fewest_planes=0, farthest_move=10.0)
    answer = validate(found(), None, seen(room, 36), room[2], lenient, RISK)
    assert (answer.status, answer.reason) == (Status.WALLS_MISSING, "the scan has hardly any wall points")


@pytest.mark.parametrize(("height", "fit", "status"), [
    (-1.0, None, Status.LOCALIZED), (0.0, None, Status.NOT_CONFIRMED), (0.0, ground(), Status.LOCALIZED),
])  # fmt: skip
def test_without_a_ground_fit_a_scan_that_lies_below_the_ground_is_refused(room, height, fit, status):
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-8.0, 8.0, 0.1)]))
    floor = np.column_stack([x, y, np.full(len(x), height)])
    grounded = PointMap.from_points(room[0], room[1], 0.06, ground=floor)
    answer = validate(found(), fit, seen(room, 8000), grounded, Trust(), RISK)
    assert answer.status is status
    assert ("below the map's ground: is roll or pitch wrong?" in answer.reason) is (status is Status.NOT_CONFIRMED)


def test_the_orientation_bin_with_the_lowest_share_is_given():
    rng = np.random.default_rng(0)
    here = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    along, across = [wall(75, 5.0, 30_000, rng), wall(255, 7.0, 30_000, rng)], wall(165, 9.0, 30_000, rng)
    point_map = PointMap.from_points(*joined(*along, across))
    few = wall(15, 3.0, 12, rng)
    assert least_wall_share(refine(Scan(*joined(*along, across, few)), point_map, here)).share > 0.95
    missing = least_wall_share(refine(Scan(*joined(*along, wall(165, 4.0, 30_000, rng))), point_map, here))
    assert (missing.n_found, missing.azimuth) == (0, pytest.approx(math.radians(165)))
    assert missing.words == f"of {missing.n_points} wall points facing 165 degrees from +x (of 180) 0 lie on the map"
    bare = Scan(across[0], np.zeros_like(across[1]))
    assert least_wall_share(refine(bare, point_map, here)) is None


@pytest.mark.parametrize(("vertical", "residual", "n_points", "wanted"), [
    (0.0, 0.0, 19, None), (0.0, 0.0, 20, WallShare(math.radians(15), 20, 20)),
    (0.0, 0.079, 30, WallShare(math.radians(15), 30, 30)), (0.0, 0.081, 30, WallShare(math.radians(15), 30, 0)),
    (0.49, 0.0, 30, WallShare(math.radians(15), 30, 30)), (0.51, 0.0, 30, None),
])  # fmt: skip
def test_what_a_wall_point_is_and_when_it_is_found(vertical, residual, n_points, wanted):
    normals = np.tile([math.sqrt(1.0 - vertical**2), 0.0, vertical], (n_points, 1))
    nothing = np.zeros((n_points, 4))
    refined = Refined(
        Pose(0, 0, 0, 0, 0, 0), normals, normals, nothing, np.full(n_points, residual), nothing[:, 0], np.eye(6),
        np.ones(6), moved=0.0, turned=0.0,
    )  # fmt: skip
    assert least_wall_share(refined) == wanted


def test_few_points_are_drawn_to_a_half():
    assert (WallShare(0.0, 20, 2).share, WallShare(0.0, 20, 20).share) == (4 / 24, 22 / 24)
