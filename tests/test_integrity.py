# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which answers are not to be trusted, on scenes where the reason is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from maxcon import Count, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status, Trust
from maxcon.errors import OptionError
from maxcon.geometry import rotation_matrices
from maxcon.integrity import peak_ratio, protection_level, reasons_to_doubt_answer, reasons_to_doubt_scan
from maxcon.scan.normal_kernels import count_normals

SPACE = SearchSpace(1.2, 0.06, 1.0)
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def wall(start, end, n, seed, height=3.0):
    """Points on an upright wall, and its normal to the left of the way from start to end."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(0.0, 1.0, n)[:, None]
    ground = np.asarray(start) * (1.0 - along) + np.asarray(end) * along
    way = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    normals = np.tile([-way[1], way[0], 0.0], (n, 1))
    return np.column_stack([ground, rng.uniform(0.0, height, n)]), normals


def joined(*walls):
    return tuple(np.concatenate(parts) for parts in zip(*walls, strict=True))


@pytest.fixture(scope="module")
def corner():
    """Two walls at right angles, dense: every scan point of them matches."""
    return joined(wall((5.01, -6), (5.01, 6), 60_000, 0), wall((6, 5.01), (-6, 5.01), 60_000, 1))


def scan_of(points, normals, n=3000, seed=2):
    chosen = np.random.default_rng(seed).permutation(len(points))[:n]
    return Scan(points[chosen], normals[chosen])


def test_a_corner_is_localized_and_tells_its_share_and_runner_up(corner):
    for search, most in (("exhaustive", 0.5), ("branch-and-bound", 0.8)):  # bounds prove what is asked for
        method = MaximumConsensus(SPACE, search=search)
        estimate = method.localize(scan_of(*corner), PointMap.from_points(*corner), HERE)
        assert estimate.status is Status.LOCALIZED
        assert estimate.share > 0.9
        assert 0.0 <= estimate.runner_up < most


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
def test_the_share_counts_scan_points_whatever_the_multiplicity(corner, multiplicity):
    """Half of the scan lies where the map has nothing; a count of map points must not hide it."""
    points, normals = corner
    scan = scan_of(*corner)
    stray = Scan(np.concatenate([scan.points, scan.points + [0, 0, 50.0]]), np.tile(scan.normals, (2, 1)))
    method = MaximumConsensus(SPACE, multiplicity=multiplicity)
    point_map = PointMap.from_points(points, normals)
    share = method.localize(scan, point_map, HERE).share
    assert method.localize(stray, point_map, HERE).share == pytest.approx(share / 2, rel=0.02)


def test_few_matches(corner):
    scan = scan_of(*corner, n=300)
    elsewhere = np.random.default_rng(3).uniform(-40, 40, (20_000, 3)) + [0, 0, 100.0]
    mostly_new = Scan(np.concatenate([scan.points, elsewhere]), np.concatenate([scan.normals, 0 * elsewhere]))
    point_map = PointMap.from_points(*corner)
    assert MaximumConsensus(SPACE).localize(mostly_new, point_map, HERE).status is Status.FEW_MATCHES
    trusting = MaximumConsensus(SPACE, trust=Trust(least_share=0.0))
    assert trusting.localize(mostly_new, point_map, HERE).status is Status.LOCALIZED


@pytest.mark.parametrize("objective", [None, Count()])
def test_a_facade_that_repeats_is_ambiguous(objective):
    """Pilasters every 0.9 m along a wall: moved by a period nearly all of them match again."""
    wide = wall((40, 5.01), (-40, 5.01), 200_000, 4)
    sides = [wall((x, 5.01), (x, 4.71), 3000, 10 + k) for k, x in enumerate(np.arange(-36.09, 36.1, 0.9))]
    point_map = PointMap.from_points(*joined(wide, *sides))
    scan = scan_of(*joined(wide, *sides), n=8000)
    method = MaximumConsensus(SPACE) if objective is None else MaximumConsensus(SPACE, objective)
    estimate = method.localize(scan, point_map, HERE)
    assert estimate.runner_up > 0.8
    assert estimate.status is Status.AMBIGUOUS
    sure = replace(method, trust=Trust(largest_runner_up=1.0))
    assert sure.localize(scan, point_map, HERE).status in (Status.LOCALIZED, Status.AMBIGUOUS)


@pytest.mark.parametrize("turn_deg", [-1.6, 1.6])
def test_a_heading_beyond_the_space_is_at_the_rim(corner, turn_deg):
    prior = replace(HERE, heading=math.radians(turn_deg))
    method, point_map = MaximumConsensus(SPACE, wider=0.0), PointMap.from_points(*corner)
    estimate = method.localize(scan_of(*corner), point_map, prior)
    assert estimate.cell[0] in (0, SPACE.shape[0] - 1)
    assert estimate.status is Status.AT_RIM


def test_the_outermost_heading_may_be_the_answer(corner):
    prior = replace(HERE, heading=math.radians(1.0))
    estimate = MaximumConsensus(SPACE).localize(scan_of(*corner), PointMap.from_points(*corner), prior)
    assert estimate.cell[0] == 0
    assert estimate.status is Status.LOCALIZED


def test_an_offset_at_the_rim_is_told(corner):
    prior = replace(HERE, x=1.2)
    estimate = MaximumConsensus(SPACE, wider=0.0).localize(scan_of(*corner), PointMap.from_points(*corner), prior)
    assert estimate.status is Status.AT_RIM


def test_walls_that_are_missing_are_told(corner):
    """Two walls fit; a third one, askew, stands in the scan but not in the map."""
    points, normals = joined(corner, wall((-2, 3), (-5, 0), 60_000, 7))
    scan, point_map = scan_of(points, normals, n=6000), PointMap.from_points(*corner)
    estimate = MaximumConsensus(SPACE).localize(scan, point_map, HERE)
    assert (estimate.status, estimate.was_widened) == (Status.WALLS_MISSING, True)
    assert "wall points facing 135 degrees from +x (of 180) 0 lie on the map" in estimate.reason
    assert MaximumConsensus(SPACE, refinement=False).localize(scan, point_map, HERE).is_localized


@pytest.mark.parametrize(
    ("evidence", "status"),
    [
        ({}, Status.LOCALIZED),
        ({"is_determined": False}, Status.UNDETERMINED),
        ({"is_determined": False, "share": 0.0, "is_at_boundary": True, "runner_up": 1.0}, Status.UNDETERMINED),
        ({"share": 0.05}, Status.LOCALIZED),
        ({"share": 0.049}, Status.FEW_MATCHES),
        ({"share": 0.049, "is_at_boundary": True, "runner_up": 1.0}, Status.FEW_MATCHES),
        ({"is_at_boundary": True, "runner_up": 1.0}, Status.AT_RIM),
        ({"runner_up": 0.8}, Status.LOCALIZED),
        ({"runner_up": 0.801}, Status.AMBIGUOUS),
    ],
)
def test_what_a_best_cell_is_judged_by(evidence, status):
    good = {"is_determined": True, "share": 0.5, "is_at_boundary": False, "runner_up": 0.5}
    assert Trust().status_of_cell(**{**good, **evidence}) is status


def test_with_a_largest_runner_up_of_one_a_place_as_good_is_no_doubt():
    judged = [
        Trust(largest_runner_up=1.0).status_of_cell(is_determined=True, share=0.5, is_at_boundary=False, runner_up=each)
        for each in (1.0, 1.001)
    ]
    assert judged == [Status.LOCALIZED, Status.AMBIGUOUS]


@pytest.mark.parametrize(
    ("evidence", "status"),
    [
        ({}, Status.LOCALIZED),
        ({"n_planes": 50}, Status.LOCALIZED),
        ({"moved": 0.25}, Status.LOCALIZED),
        ({"wall_share": 0.05}, Status.LOCALIZED),
        ({"wall_share": 0.02, "is_confirmed": True}, Status.LOCALIZED),
        ({"n_planes": 49}, Status.NOT_CONFIRMED),
        ({"moved": 0.26}, Status.NOT_CONFIRMED),
        ({"wall_share": 0.049}, Status.WALLS_MISSING),
        ({"wall_share": 0.021, "is_confirmed": True}, Status.LOCALIZED),
        ({"wall_share": 0.019, "is_confirmed": True}, Status.WALLS_MISSING),
        ({"wall_share": None}, Status.WALLS_MISSING),
        ({"wall_share": None, "is_confirmed": True}, Status.LOCALIZED),
    ],
)
def test_what_a_refined_pose_is_judged_by(evidence, status):
    good = {"n_planes": 500, "moved": 0.05, "wall_share": 0.5, "is_confirmed": False}
    assert Trust().status_of_pose(**{**good, **evidence}) is status


def test_the_protection_level_is_along_and_across_the_heading():
    covariance = np.diag([0.04, 0.01, 9.0, 1.0, 1.0, 1.0]) ** 2
    along, across = protection_level(covariance, 0.0, 0.01)
    assert along == pytest.approx(4.0 * across)
    assert across / 0.01 == pytest.approx(3.02, abs=0.01)  # 0.5 % of 1 % is left, for two directions of two sides
    assert protection_level(covariance, math.pi / 2, 0.01) == pytest.approx((across, along))
    assert protection_level(covariance, 0.0, 0.02)[0] < along
    assert protection_level(covariance, 0.0, 0.005) == (math.inf, math.inf)


def test_the_runner_up_by_hand():
    space = SearchSpace(0.6, 0.06, 0.5)
    scores = np.zeros(space.shape)
    scores[1, 10, 10] = 8.0  # the best cell
    scores[1, 10, 11] = 7.9  # its slope, next to it
    scores[0, 10, 18] = 6.0  # another peak, 0.48 m away, at another heading
    scores[2, 2, 2] = 4.0  # a lower one, farther away
    assert peak_ratio(scores, (1, 10, 10), space, 0.3) == 6.0 / 8.0
    assert peak_ratio(scores, (1, 10, 10), space, 0.5) == 4.0 / 8.0
    assert peak_ratio(scores, (1, 10, 10), space, 5.0) == 0.0
    with np.errstate(all="raise"):
        assert peak_ratio(scores, (1, 0, 0), space, 0.3) == math.inf
        assert peak_ratio(np.zeros(space.shape), (1, 0, 0), space, 0.3) == math.inf


def test_a_slope_is_no_runner_up():
    """Cells beyond the guard radius that only lead up to the peak are no place of their own."""
    space = SearchSpace(0.6, 0.06, 0.0)
    y, x = np.mgrid[:20, :20]
    scores = 20.0 - np.hypot(y - 10, x - 10)[None]
    assert peak_ratio(scores, (0, 10, 10), space, 0.3) == 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"least_share": -0.1}, "`least_share` from 0 to 1, got -0.1. The default is 0.05"),
        ({"largest_runner_up": 1.5}, "`largest_runner_up` from 0 to 1, got 1.5. The default is 0.8"),
        ({"least_share": math.nan}, "`least_share` from 0 to 1, got nan"),
        ({"guard_radius": math.inf}, "`guard_radius` >= 0, got inf. The default is 0.5"),
    ],
)
def test_what_trust_cannot_be(options, words):
    with pytest.raises(OptionError, match=words):
        Trust(**options)


# --- what casts doubt ---------------------------------------------------------------------------------


def a_scan(n, share_upright, share_level):
    """Points of which some have a horizontal normal, some an upright one, and the others none."""
    normals = np.zeros((n, 3))
    n_upright, n_level = round(share_upright * n), round(share_level * n)
    normals[:n_upright] = [-1.0, 0.0, 0.0]
    normals[n_upright : n_upright + n_level] = [0.0, 0.0, 1.0]
    return Scan(np.random.default_rng(0).uniform(1.0, 9.0, (n, 3)), normals)


def test_an_ordinary_scan_is_not_doubted():
    assert reasons_to_doubt_scan(a_scan(1000, 0.1, 0.1), HERE) == []


def test_the_likely_cause_is_named():
    cause = "few walls around, single rings, or a sensor frame that is not z up?"
    for upright, level, words in (
        (0.0, 0.03, "normals on 3 % of the points, none horizontal"),
        (0.02, 0.3, "normals on 32 % of the points, horizontal ones on 2.0 %"),
        (0.05, 0.0, "normals on 5 % of the points, horizontal ones on 5.0 %"),
        (0.0, 0.0, "normals on 0 % of the points, none horizontal"),
    ):
        assert reasons_to_doubt_scan(a_scan(1000, upright, level), HERE) == [f"{words}: {cause}"]
    assert reasons_to_doubt_scan(a_scan(30, 1.0, 0.0), HERE) == [
        "only 30 points: is the scan cut, or are range limits too narrow?"
    ]


def test_what_is_horizontal_is_said_by_the_roll_and_pitch_of_the_prior():
    lying = replace(HERE, pitch=math.radians(90.0))  # a sensor mounted on its nose
    assert reasons_to_doubt_scan(a_scan(1000, 0.5, 0.0), HERE) == []
    assert "none horizontal" in reasons_to_doubt_scan(a_scan(1000, 0.5, 0.0), lying)[0]
    assert reasons_to_doubt_scan(a_scan(1000, 0.0, 0.5), lying) == []


def test_few_matches_along_a_direction_are_named_with_it():
    assert reasons_to_doubt_answer(np.array([300.0, 200.0, 0.0, 50.0])) == []
    (words,) = reasons_to_doubt_answer(np.array([300.0, 200.0, 0.0, 4.25]))
    assert words == "only 4.2 full matches fix the position along 90 degrees from +x (of 180)"
    c, s = math.cos(math.radians(31.0)), math.sin(math.radians(31.0))
    (words,) = reasons_to_doubt_answer(
        np.array([300.0, 100 * s * s + 2 * c * c, (2.0 - 100.0) * s * c, 100 * c * c + 2 * s * s])
    )
    assert "only 2.0 full matches fix the position along 31 degrees" in words
    assert reasons_to_doubt_answer(np.zeros(4)) == []


@pytest.mark.parametrize("search", ["exhaustive", "branch-and-bound"])
def test_a_scan_without_normals_says_so_beside_its_answer(corner, search):
    points, normals = corner
    bare = Scan(scan_of(points, normals).points, np.zeros((3000, 3)))
    estimate = MaximumConsensus(SPACE, search=search).localize(bare, PointMap.from_points(*corner), HERE)
    assert estimate.status is Status.LOCALIZED
    assert estimate.reason.startswith("normals on 0 % of the points, none horizontal")
    assert (
        MaximumConsensus(SPACE, search=search)
        .localize(scan_of(points, normals), PointMap.from_points(*corner), HERE)
        .reason
        == ""
    )
    nowhere = MaximumConsensus(SPACE, search=search).localize(
        bare, PointMap.from_points(*corner), replace(HERE, z=500.0)
    )
    assert nowhere.status is Status.NO_MATCH
    assert nowhere.reason == estimate.reason


@pytest.mark.parametrize("seed", range(3))
def test_normals_are_counted_as_they_are(seed):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(1000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(1000) < 0.3] = 0.0
    up = rotation_matrices(0.1, -0.2, 0.0)[2]
    is_horizontal = normals.any(axis=1) & (np.abs(normals @ up) < 0.5)
    assert count_normals(normals, up, 0.5) == (normals.any(axis=1).sum(), is_horizontal.sum())
