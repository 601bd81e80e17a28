# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What examining a best cell makes of it: what stays in doubt, what the ground is worth, and which words say why."""

from dataclasses import replace

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan, Trust
from maxcon.estimate import Estimate, Status
from maxcon.refine import HEIGHT_SIGMA, TILT_SIGMA, validation
from maxcon.refine.ground import GroundFit
from maxcon.refine.validation import examine

HERE = Pose(0.2, -0.1, 1.6, 0.0, 0.0, 0.3)
ON_GROUND = replace(HERE, z=1.55, roll=0.01)
RISK = 0.01


def in_a_room(seen_walls=(0, 1, 2, 3), n_points=3000):
    """Four walls 5 m away, and a scan of some of them."""
    rng = np.random.default_rng(1)
    points, normals = [], []
    for azimuth in np.arange(4) * np.pi / 2:
        out, along = (np.array([np.cos(azimuth), np.sin(azimuth)]), np.array([-np.sin(azimuth), np.cos(azimuth)]))
        across, up = rng.uniform(-5.0, 5.0, (60_000, 1)), rng.uniform(0.0, 4.0, 60_000)
        points.append(np.column_stack([5.0 * out + across * along, up]))
        normals.append(np.tile([*-out, 0.0], (60_000, 1)))
    point_map = PointMap.from_points(np.concatenate(points), np.concatenate(normals), 0.06)
    seen = np.concatenate([points[number][: n_points // len(seen_walls)] for number in seen_walls])
    facing = np.concatenate([normals[number][: n_points // len(seen_walls)] for number in seen_walls])
    return Scan((seen - HERE.position) @ HERE.rotation, facing @ HERE.rotation), point_map


def found(status=Status.LOCALIZED, reason=""):
    return Estimate(HERE, 100.0, (0, 0, 0), status, 0.01 * np.eye(2), 0.9, 0.1, reason)


def ground(sigma_height=0.01, sigma_tilt=0.001):
    return GroundFit(ON_GROUND, -0.05, 0.01, 0.02, 100, 0.9, sigma_height, sigma_tilt)


@pytest.fixture
def asked(monkeypatch):
    """What the refinement was asked for."""
    calls, refine = [], validation.refine

    def recorded(scan, point_map, start, **sigmas):
        calls.append((start, sigmas))
        return refine(scan, point_map, start, **sigmas)

    monkeypatch.setattr(validation, "refine", recorded)
    return calls


def test_an_answer_in_doubt_is_laid_on_its_ground_and_not_refined(asked):
    scan, point_map = in_a_room()
    doubted = found(Status.AMBIGUOUS)
    for fit, pose in ((ground(), ON_GROUND), (None, HERE)):
        answer = examine(doubted, fit, scan, point_map, Trust(), RISK)
        assert (answer.pose, answer.status, answer.score) == (pose, Status.AMBIGUOUS, doubted.score)
        assert not np.isfinite(np.diag(answer.covariance)).any()
    assert asked == []


@pytest.mark.parametrize(
    ("fit", "height_sigma", "tilt_sigma"),
    [
        (None, HEIGHT_SIGMA, TILT_SIGMA),
        (ground(0.001, 0.0001), 0.03, 0.003),
        (ground(0.05, 0.0001), 0.05, 0.003),
        (ground(0.001, 0.02), 0.03, 0.02),
    ],
)
def test_the_ground_tells_height_and_tilt_no_better_than_map_and_walls_agree(asked, fit, height_sigma, tilt_sigma):
    scan, point_map = in_a_room()
    answer = examine(found(), fit, scan, point_map, Trust(), RISK)
    assert asked == [(HERE if fit is None else ON_GROUND, {"height_sigma": height_sigma, "tilt_sigma": tilt_sigma})]
    assert answer.is_localized
    assert answer.pose.position[:2] == pytest.approx(HERE.position[:2], abs=0.01)
    assert np.isfinite(answer.covariance).all() and np.isfinite(answer.protection_level).all()


def test_too_few_points_on_planes_are_told_by_number_and_what_was_said_before_stays():
    scan, point_map = in_a_room(n_points=800)
    strict = Trust(fewest_planes=10_000)
    answer = examine(found(reason="only 800 points"), None, scan, point_map, strict, RISK)
    assert (answer.status, answer.pose) == (Status.NOT_CONFIRMED, HERE)
    first, second = answer.reason.split("; ")
    assert first == "only 800 points"
    number, words = second.split(" ", 1)
    assert 100 < int(number) <= 800
    assert words == "points on planes of the map, 0.00 m from the best cell"
    assert not np.isfinite(answer.covariance).any(where=np.eye(6, dtype=bool))


def test_walls_that_are_not_there_are_named_unless_a_wider_search_confirmed_the_place():
    scan, point_map = in_a_room()
    beside, quarter = np.array(scan.points), len(scan) // 4
    for number, offset in ((0, 1.0), (2, -1.0)):  # two walls stand 1 m farther apart
        beside[number * quarter : (number + 1) * quarter] += HERE.rotation.T @ [offset, 0.0, 0.0]
    moved = Scan(beside, scan.normals)
    answer = examine(found(), None, moved, point_map, Trust(), RISK)
    assert answer.status is Status.WALLS_MISSING
    assert "wall" in answer.reason and "planes" not in answer.reason
    lenient = Trust(least_confirmed_share=0.0)
    assert examine(found(), None, moved, point_map, lenient, RISK).status is Status.WALLS_MISSING
    assert examine(found(), None, moved, point_map, lenient, RISK, is_confirmed=True).is_localized


def test_a_scan_without_walls_has_nothing_that_could_confirm_it():
    scan, point_map = in_a_room(n_points=36)
    lenient = Trust(fewest_planes=0, farthest_move=10.0)
    answer = examine(found(), None, scan, point_map, lenient, RISK)
    assert (answer.status, answer.reason) == (Status.WALLS_MISSING, "the scan has hardly any wall points")
