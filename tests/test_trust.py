# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where exactly trust ends: limits met, and missed by a little. What scenes do with them: test_integrity."""

import math
from dataclasses import FrozenInstanceError
from statistics import NormalDist

import numpy as np
import pytest

from maxcon import Pose, Scan, SearchSpace, Trust
from maxcon.errors import OptionError
from maxcon.integrity import (
    FEWEST_POINTS,
    LEAST_EIGENVALUE_RATIO,
    along_and_across,
    highest_beyond,
    invert,
    peak_ratio,
    protection_level,
    reasons_to_doubt_answer,
    reasons_to_doubt_scan,
)

LEVEL = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("least", "most", "is_determined"),
    [
        (1.0, 10.0, True),  # a match in full, in the least determined direction
        (0.999, 10.0, False),
        (1.001, 1.0 / LEAST_EIGENVALUE_RATIO, True),
        (4.001 * LEAST_EIGENVALUE_RATIO * 1_000.0, 4_000.0, True),  # walls whose normals are 3 degrees off
        (3.999 * LEAST_EIGENVALUE_RATIO * 1_000.0, 4_000.0, False),
    ],
)
def test_what_determines_a_position(least, most, is_determined):
    found, cofactor = invert(np.diag([most, least]))
    assert found is is_determined
    np.testing.assert_allclose(cofactor, np.diag([1.0 / most, 1.0 / least]))


def test_what_is_singular_has_no_cofactor():
    for matrix in (np.diag([0.9e-6 * 1e9, 1e9]), np.zeros((2, 2)), np.full((2, 2), 7.0)):
        is_determined, cofactor = invert(matrix)
        assert not is_determined
        np.testing.assert_array_equal(cofactor, np.diag([np.inf, np.inf]))
    assert np.isfinite(invert(np.diag([1.1e-6 * 1e9, 1e9]))[1]).all()


def test_walls_that_are_three_degrees_off():
    assert pytest.approx(0.002739, abs=1e-6) == LEAST_EIGENVALUE_RATIO


@pytest.mark.parametrize("name", ["least_share", "largest_runner_up", "least_wall_share", "least_confirmed_share"])
def test_shares_are_from_0_to_1(name):
    for share in (0.0, 1.0):
        assert getattr(Trust(**{name: share}), name) == share
    for share in (-1e-9, 1.0 + 1e-9, math.nan):
        with pytest.raises(OptionError, match=rf"`{name}` from 0 to 1"):
            Trust(**{name: share})


@pytest.mark.parametrize("name", ["guard_radius", "fewest_planes", "farthest_move"])
def test_lengths_and_numbers_are_not_negative(name):
    assert getattr(Trust(**{name: 0}), name) == 0
    for value in (-1, math.inf, math.nan):
        with pytest.raises(OptionError, match=rf"`{name}` >= 0"):
            Trust(**{name: value})


def test_the_defaults_are_those_of_the_decisions():
    assert Trust() == Trust(0.05, 0.8, 0.5, 0.05, 0.02, 50, 0.25)
    with pytest.raises(FrozenInstanceError):
        Trust().least_share = 0.0


def _scan(n, n_horizontal, n_upright):
    """Points of which some have a horizontal normal, some an upright one."""
    normals = np.zeros((n, 3))
    normals[:n_horizontal, 0] = 1.0
    normals[n_horizontal : n_horizontal + n_upright, 2] = 1.0
    return Scan(np.ones((n, 3)), normals)


@pytest.mark.parametrize(
    ("scan", "words"),
    [
        ((499, 400, 0), "only 499 points"),
        ((500, 400, 0), None),
        ((1000, 30, 70), None),  # 10 % with a normal, 3 % a horizontal one
        ((1000, 30, 69), "normals on 10 % of the points, horizontal ones on 3.0 %"),
        ((1000, 29, 71), "normals on 10 % of the points, horizontal ones on 2.9 %"),
        ((1000, 0, 900), "normals on 90 % of the points, none horizontal"),
        ((1000, 1, 500), "horizontal ones on 0.1 %"),
        ((1000, 95, 0), "horizontal ones on 9.5 %"),
        ((1000, 0, 0), "normals on 0 % of the points, none horizontal"),
    ],
)
def test_scans_that_are_just_ordinary_and_just_not(scan, words):
    reasons = reasons_to_doubt_scan(_scan(*scan), LEVEL)
    assert len(reasons) == (words is not None)
    assert words is None or words in reasons[0]


def test_horizontal_is_within_30_degrees():
    def doubted(degrees):
        normal = [math.cos(math.radians(degrees)), 0.0, math.sin(math.radians(degrees))]
        return reasons_to_doubt_scan(Scan(np.ones((FEWEST_POINTS, 3)), [normal] * FEWEST_POINTS), LEVEL)

    assert not doubted(29.9)
    assert "none horizontal" in doubted(30.1)[0]


@pytest.mark.parametrize(
    ("azimuth_deg", "words"), [(0.0, "along 0 degrees"), (30.0, "along 30 degrees"), (135.0, "along 135 degrees")]
)
def test_the_direction_that_few_matches_fix_is_named(azimuth_deg, words):
    azimuth = math.radians(azimuth_deg)
    weak, strong = (np.array([math.cos(a), math.sin(a)]) for a in (azimuth, azimuth + math.pi / 2))
    matrix = 9.9 * np.outer(weak, weak) + 50.0 * np.outer(strong, strong)
    (reason,) = reasons_to_doubt_answer(np.array([100.0, matrix[0, 0], matrix[0, 1], matrix[1, 1]]))
    assert "only 9.9 full matches" in reason
    assert words in reason


@pytest.mark.parametrize(("smallest", "n"), [(0.0, 0), (0.1, 1), (9.9, 1), (10.0, 0)])
def test_so_many_matches_are_enough(smallest, n):
    assert len(reasons_to_doubt_answer(np.array([99.0, smallest, 0.0, 50.0]))) == n


@pytest.mark.parametrize("risk", [0.006, 0.01, 0.1])
def test_the_level_of_a_risk_is_that_of_two_directions_of_two_sides(risk):
    covariance = np.diag([4.0, 9.0, 1.0, 1.0, 1.0, 1.0])
    factor = NormalDist().inv_cdf(1.0 - (risk - 0.005) / 4.0)
    assert protection_level(covariance, 0.0, risk) == pytest.approx((2.0 * factor, 3.0 * factor))
    assert protection_level(covariance, 0.0, 0.005) == (math.inf, math.inf)


def test_errors_along_and_across_a_heading():
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = [[5.0, 4.0], [4.0, 5.0]]  # 9 along 45 degrees, 1 across
    np.testing.assert_allclose(along_and_across(covariance, math.radians(45.0)), np.diag([9.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(along_and_across(covariance, math.radians(-45.0)), np.diag([1.0, 9.0]), atol=1e-12)
    np.testing.assert_allclose(along_and_across(covariance, math.radians(90.0)), [[5.0, -4.0], [-4.0, 5.0]])


def test_beyond_the_guard_radius_and_not_on_it():
    space = SearchSpace(1.0, 0.125, 0.0, 0.5)
    scores = np.full(space.shape, -1.0)
    scores[0, 8, 8] = 4.0
    scores[0, 8, 12], scores[0, 3, 8] = 3.0, 2.0  # half a metre away, and 0.625 m
    assert highest_beyond(scores, (0, 8, 8), space, 0.5) == 2.0
    assert highest_beyond(scores, (0, 8, 8), space, 0.49) == 3.0
    assert highest_beyond(scores, (0, 8, 8), space, 5.0) == 0.0
    assert peak_ratio(scores, (0, 8, 8), space, 0.5) == 0.5


def test_rows_are_not_columns():
    space = SearchSpace(1.0, 0.125, 0.0, 0.5)
    scores = np.zeros(space.shape)
    scores[0, 12, 3] = 4.0
    scores[0, 12, 7], scores[0, 3, 12], scores[0, 9, 3] = 1.0, 3.0, 2.0  # 0.5, 1.6 and 0.375 m away
    assert highest_beyond(scores, (0, 12, 3), space, 0.4) == 3.0
    scores[0, 3, 12] = 0.0
    assert highest_beyond(scores, (0, 12, 3), space, 0.4) == 1.0
    assert highest_beyond(scores, (0, 12, 3), space, 0.3) == 2.0
    assert peak_ratio(scores, (0, 12, 3), space, 0.4) == 0.25


def test_low_scores_are_compared_like_high_ones():
    space = SearchSpace(1.0, 0.125, 0.0, 0.5)
    scores = np.zeros(space.shape)
    scores[0, 8, 8], scores[0, 0, 8] = 0.5, 0.125
    assert peak_ratio(scores, (0, 8, 8), space, 0.5) == 0.25


def test_evidence_is_told_by_name():
    with pytest.raises(TypeError, match="positional argument"):
        Trust().status_of_cell(True, 0.5, False, 0.5)
    with pytest.raises(TypeError, match="positional argument"):
        Trust().status_of_pose(500, 0.05, 0.5, False)


def test_a_place_at_the_corner_of_the_space_counts():
    space = SearchSpace(1.0, 0.125, 0.0, 0.5)
    scores = np.zeros(space.shape)
    scores[0, 8, 8], scores[0, 0, 0], scores[0, 15, 15] = 4.0, 3.0, 2.0
    assert peak_ratio(scores, (0, 8, 8), space, 0.5) == 0.75
    scores[0, 1, 1] = 3.5  # the corner is its slope now
    assert peak_ratio(scores, (0, 8, 8), space, 0.5) == 0.875
    assert peak_ratio(scores, (0, 8, 8), space, 1.3) == 0.0  # beyond lies the slope alone
