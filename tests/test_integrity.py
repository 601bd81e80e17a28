"""Which answers are not to be trusted: where exactly trust ends, and on scenes where the reason is known."""

import math
from dataclasses import FrozenInstanceError, replace
from statistics import NormalDist

import numpy as np
import pytest

from maxcon import Count, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status, Trust, integrity
from maxcon.errors import OptionError
from maxcon.lab.distinctness import peak_ratio
from upright_walls import joined, scattered

SPACE = SearchSpace(1.2, 0.06, 1.0)
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def corner():
    """Two walls at right angles, dense: every scan point of them matches."""
    return joined(scattered((5.01, -6), (5.01, 6), 60_000, 0), scattered((6, 5.01), (-6, 5.01), 60_000, 1))


@pytest.fixture(scope="module")
def point_map(corner):
    return PointMap.from_points(*corner)


def scan_of(points, normals, n=3000, seed=2):
    chosen = np.random.default_rng(seed).permutation(len(points))[:n]
    return Scan(points[chosen], normals[chosen])


def test_a_corner_is_localized_and_tells_how_much_matches_and_its_second_best(corner, point_map):
    for search, most in (("exhaustive", 0.5), ("branch-and-bound", 0.8)):  # bounds prove what is asked for
        estimate = MaximumConsensus(SPACE, search=search).localize(scan_of(*corner), point_map, HERE)
        assert (estimate.status, estimate.reason) == (Status.LOCALIZED, "") and estimate.share > 0.9
        assert 0.0 <= estimate.runner_up < most


def test_few_matches(corner, point_map):
    scan = scan_of(*corner, n=300)
    elsewhere = np.random.default_rng(3).uniform(-40, 40, (20_000, 3)) + [0, 0, 100.0]
    mostly_new = Scan(np.concatenate([scan.points, elsewhere]), np.concatenate([scan.normals, 0 * elsewhere]))
    for trust, status in ((Trust(), Status.FEW_MATCHES), (Trust(least_share=0.0), Status.LOCALIZED)):
        assert MaximumConsensus(SPACE, trust=trust).localize(mostly_new, point_map, HERE).status is status


@pytest.mark.parametrize("objective", [None, Count()])
def test_a_facade_that_repeats_is_ambiguous(objective):
    """Pilasters every 0.9 m along a wall: moved by a period nearly all of them match again."""
    wide = scattered((40, 5.01), (-40, 5.01), 200_000, 4)
    sides = [scattered((x, 5.01), (x, 4.71), 3000, 10 + k) for k, x in enumerate(np.arange(-36.09, 36.1, 0.9))]
    point_map = PointMap.from_points(*joined(wide, *sides))
    scan = scan_of(*joined(wide, *sides), n=8000)
    method = MaximumConsensus(SPACE) if objective is None else MaximumConsensus(SPACE, objective)
    estimate = method.localize(scan, point_map, HERE)
    assert estimate.runner_up > 0.8 and estimate.status is Status.AMBIGUOUS
    sure = replace(method, trust=Trust(largest_runner_up=1.0))
    assert sure.localize(scan, point_map, HERE).status in (Status.LOCALIZED, Status.AMBIGUOUS)


def test_walls_that_are_missing_are_told(corner, point_map):
    """Two walls fit; a third one, askew, stands in the scan but not in the map."""
    scan = scan_of(*joined(corner, scattered((-2, 3), (-5, 0), 60_000, 7)), n=6000)
    estimate = MaximumConsensus(SPACE).localize(scan, point_map, HERE)
    assert (estimate.status, estimate.was_widened) == (Status.WALLS_MISSING, True)
    assert "wall points facing 135 degrees from +x (of 180) 0 lie on the map" in estimate.reason
    assert MaximumConsensus(SPACE, refinement=False).localize(scan, point_map, HERE).is_localized


@pytest.mark.parametrize(("evidence", "status"), [
    ({}, Status.LOCALIZED),
    ({"is_determined": False}, Status.UNDETERMINED),
    ({"is_determined": False, "share": 0.0, "is_at_boundary": True, "runner_up": 1.0}, Status.UNDETERMINED),
    ({"share": 0.05}, Status.LOCALIZED),
    ({"share": 0.049}, Status.FEW_MATCHES),
    ({"share": 0.049, "is_at_boundary": True, "runner_up": 1.0}, Status.FEW_MATCHES),
    ({"is_at_boundary": True, "runner_up": 1.0}, Status.AT_RIM),
    ({"runner_up": 0.8}, Status.LOCALIZED),
    ({"runner_up": 0.801}, Status.AMBIGUOUS),
])  # fmt: skip
def test_what_a_best_cell_is_judged_by(evidence, status):
    good = {"is_determined": True, "share": 0.5, "is_at_boundary": False, "runner_up": 0.5}
    assert Trust().status_of_cell(**{**good, **evidence}) is status
    limit = evidence.get("runner_up", 0.5)  # what just reaches a limit is no doubt
    assert (Trust(largest_runner_up=limit).status_of_cell(**{**good, "runner_up": limit})) is Status.LOCALIZED


@pytest.mark.parametrize(("evidence", "status"), [
    ({}, Status.LOCALIZED), ({"n_planes": 50}, Status.LOCALIZED), ({"moved": 0.25}, Status.LOCALIZED),
    ({"wall_share": 0.05}, Status.LOCALIZED), ({"wall_share": 0.02, "is_confirmed": True}, Status.LOCALIZED),
    ({"n_planes": 49}, Status.NOT_CONFIRMED), ({"moved": 0.26}, Status.NOT_CONFIRMED),
    ({"wall_share": 0.049}, Status.WALLS_MISSING), ({"wall_share": 0.021, "is_confirmed": True}, Status.LOCALIZED),
    ({"wall_share": 0.019, "is_confirmed": True}, Status.WALLS_MISSING),
    ({"wall_share": None}, Status.WALLS_MISSING), ({"wall_share": None, "is_confirmed": True}, Status.LOCALIZED),
])  # fmt: skip
def test_what_a_refined_pose_is_judged_by(evidence, status):
    good = {"n_planes": 500, "moved": 0.05, "wall_share": 0.5, "is_confirmed": False}
    assert Trust().status_of_pose(**{**good, **evidence}) is status


@pytest.mark.parametrize("risk", [0.006, 0.01, 0.02, 0.1])
def test_the_protection_level_is_along_and_across_the_heading_and_of_two_directions_of_two_sides(risk):
    covariance = np.diag([0.04, 0.01, 9.0, 1.0, 1.0, 1.0]) ** 2
    factor = NormalDist().inv_cdf(1.0 - (risk - 0.005) / 4.0)  # of 1 % half is left
    along, across = integrity.protection_level(covariance, 0.0, risk)
    assert (along, across) == pytest.approx((0.04 * factor, 0.01 * factor))
    assert integrity.protection_level(covariance, math.pi / 2, risk) == pytest.approx((across, along))
    assert integrity.protection_level(covariance, 0.0, 0.005) == (math.inf, math.inf)


@pytest.mark.parametrize(("best", "others", "guard_radius", "highest"), [  # cells of 0.125 m
    ((1, 8, 8), [((1, 8, 9), 3.9), ((0, 8, 13), 3.0), ((2, 2, 2), 2.0)], 0.5, 3.0),  # next to it: its slope
    ((1, 8, 8), [((1, 8, 9), 3.9), ((0, 8, 13), 3.0), ((2, 2, 2), 2.0)], 0.7, 2.0),
    ((1, 8, 8), [((1, 8, 9), 3.9), ((0, 8, 13), 3.0), ((2, 2, 2), 2.0)], 5.0, 0.0),
    ((1, 8, 8), [((0, 8, 12), 3.0), ((0, 3, 8), 2.0)], 0.5, 2.0),  # 0.5 m away, not farther; and 0.625 m
    ((1, 8, 8), [((0, 8, 12), 3.0), ((0, 3, 8), 2.0)], 0.49, 3.0),
    ((1, 12, 3), [((1, 12, 7), 1.0), ((1, 3, 12), 3.0), ((1, 9, 3), 2.0)], 0.4, 3.0),  # rows are not columns
    ((1, 12, 3), [((1, 12, 7), 1.0), ((1, 9, 3), 2.0)], 0.4, 1.0),
    ((1, 12, 3), [((1, 12, 7), 1.0), ((1, 9, 3), 2.0)], 0.3, 2.0),
    ((1, 8, 8), [((1, 0, 0), 3.0), ((1, 15, 15), 2.0)], 0.5, 3.0),  # at the corner of the space
])  # fmt: skip
def test_the_second_best_lies_beyond_the_guard_radius_and_not_on_it(best, others, guard_radius, highest):
    space = SearchSpace(1.0, 0.125, 0.5)
    scores = np.zeros(space.shape)
    scores[best] = 4.0
    for cell, score in others:
        scores[cell] = score
    assert integrity.highest_beyond(scores, best, space, guard_radius) == highest
    assert peak_ratio(scores, best, space, guard_radius) == highest / 4.0
    assert peak_ratio(scores / 8.0, best, space, guard_radius) == highest / 4.0  # low scores like high ones


@pytest.mark.parametrize("name", ["least_share", "largest_runner_up", "least_wall_share", "least_confirmed_share"])
def test_ratios_are_from_0_to_1(name):
    for ratio in (0.0, 1.0):
        assert getattr(Trust(**{name: ratio}), name) == ratio
    for ratio in (-1e-9, 1.0 + 1e-9, math.nan):
        default = getattr(Trust(), name)
        with pytest.raises(OptionError, match=rf"`{name}` from 0 to 1, got {ratio}\. The default is {default}"):
            Trust(**{name: ratio})


@pytest.mark.parametrize("name", ["guard_radius", "fewest_planes", "farthest_move"])
def test_lengths_and_numbers_are_not_negative(name):
    assert getattr(Trust(**{name: 0}), name) == 0
    for value in (-1, math.inf, math.nan):
        with pytest.raises(OptionError, match=rf"`{name}` >= 0, got {value}\. The default is"):
            Trust(**{name: value})


def test_the_defaults_are_those_of_the_decisions():
    assert Trust() == Trust(0.05, 0.8, 0.5, 0.05, 0.02, 50, 0.25)
    assert pytest.approx(0.002739, abs=1e-6) == integrity.LEAST_EIGENVALUE_RATIO  # walls that are three degrees off
    with pytest.raises(FrozenInstanceError):
        Trust().least_share = 0.0


# --- what casts doubt ---
def with_normals(n, n_horizontal, n_upright):
    """Points of which some have a horizontal normal, some an upright one, and the others none."""
    normals = np.zeros((n, 3))
    normals[:n_horizontal, 0] = 1.0
    normals[n_horizontal : n_horizontal + n_upright, 2] = 1.0
    return Scan(np.arange(n)[:, None] * [1.0, 0.0, 0.0] + 1.0, normals)  # so far apart that the sample holds all


@pytest.mark.parametrize(("scan", "words"), [
    ((499, 400, 0), "only 499 points"),
    ((500, 400, 0), None),
    ((1000, 30, 70), None),  # 10 % with a normal, 3 % a horizontal one
    ((1000, 30, 69), "normals on 10 % of the points, horizontal ones on 3.0 %"),
    ((1000, 29, 71), "normals on 10 % of the points, horizontal ones on 2.9 %"),
    ((1000, 0, 900), "normals on 90 % of the points, none horizontal"),
    ((1000, 1, 500), "horizontal ones on 0.1 %"),
    ((1000, 95, 0), "horizontal ones on 9.5 %"),
    ((1000, 0, 0), "normals on 0 % of the points, none horizontal"),
])  # fmt: skip
def test_scans_that_are_just_ordinary_and_just_not(scan, words):
    reasons = integrity.reasons_to_doubt_scan(with_normals(*scan), HERE)
    assert len(reasons) == (words is not None)
    assert words is None or words in reasons[0]


def test_the_likely_cause_is_named_and_what_is_horizontal_is_said_by_the_prior():
    cause = "few walls around, single rings, or a sensor frame that is not z up?"
    words = "normals on 32 % of the points, horizontal ones on 2.0 %"
    assert integrity.reasons_to_doubt_scan(with_normals(1000, 20, 300), HERE) == [f"{words}: {cause}"]
    short = "only 30 points: is the scan cut, or are range limits too narrow?"
    assert integrity.reasons_to_doubt_scan(with_normals(30, 30, 0), HERE) == [short]
    lying = replace(HERE, pitch=math.radians(90.0))  # a sensor mounted on its nose
    assert integrity.reasons_to_doubt_scan(with_normals(1000, 500, 0), HERE) == []
    assert "none horizontal" in integrity.reasons_to_doubt_scan(with_normals(1000, 500, 0), lying)[0]
    assert integrity.reasons_to_doubt_scan(with_normals(1000, 0, 500), lying) == []


@pytest.mark.parametrize(("azimuth_deg", "least"), [(0.0, 9.9), (30.0, 9.9), (31.0, 2.0), (90.0, 4.25), (135.0, 9.9)])
def test_few_matches_along_a_direction_are_named_with_it(azimuth_deg, least):
    azimuth = math.radians(azimuth_deg)
    weak, strong = (np.array([math.cos(a), math.sin(a)]) for a in (azimuth, azimuth + math.pi / 2))
    (xx, xy), (_, yy) = least * np.outer(weak, weak) + 50.0 * np.outer(strong, strong)
    (reason,) = integrity.reasons_to_doubt_answer(np.array([100.0, xx, xy, yy]))
    assert reason == f"only {least:.1f} full matches fix the position along {azimuth_deg:.0f} degrees from +x (of 180)"
    for none, enough in ((0.0, 50.0), (50.0, 10.0)):  # nothing along a direction is told by its status
        assert integrity.reasons_to_doubt_answer(np.array([99.0, none, 0.0, enough])) == []


@pytest.mark.parametrize("search", ["exhaustive", "branch-and-bound"])
def test_a_scan_without_normals_says_so_beside_its_answer(corner, point_map, search):
    bare = Scan(scan_of(*corner).points, np.zeros((3000, 3)))
    method = MaximumConsensus(SPACE, search=search)
    estimate = method.localize(bare, point_map, HERE)
    assert estimate.status is Status.LOCALIZED
    assert estimate.reason.startswith("normals on 0 % of the points, none horizontal")
    nowhere = method.localize(bare, point_map, replace(HERE, z=500.0))
    assert (nowhere.status, nowhere.reason) == (Status.NO_MATCH, estimate.reason)


# --- where trust ends ---
@pytest.mark.parametrize(("least", "most", "is_determined"), [
    (1.0, 10.0, True),  # a match in full, in the least determined direction
    (0.999, 10.0, False),
    (1.001, 1.0 / integrity.LEAST_EIGENVALUE_RATIO, True),
    (4.001 * integrity.LEAST_EIGENVALUE_RATIO * 1_000.0, 4_000.0, True),  # walls whose normals are 3 degrees off
    (3.999 * integrity.LEAST_EIGENVALUE_RATIO * 1_000.0, 4_000.0, False),
])  # fmt: skip
def test_what_determines_a_position(least, most, is_determined):
    found, cofactor = integrity.invert(np.diag([most, least]))
    assert found is is_determined
    np.testing.assert_allclose(cofactor, np.diag([1.0 / most, 1.0 / least]))


def test_what_is_singular_has_no_cofactor():
    for matrix in (np.diag([0.9e-6 * 1e9, 1e9]), np.zeros((2, 2)), np.full((2, 2), 7.0)):
        is_determined, cofactor = integrity.invert(matrix)
        assert not is_determined
        np.testing.assert_array_equal(cofactor, np.diag([np.inf, np.inf]))
    assert np.isfinite(integrity.invert(np.diag([1.1e-6 * 1e9, 1e9]))[1]).all()


def test_errors_along_and_across_a_heading():
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = [[5.0, 4.0], [4.0, 5.0]]  # 9 along 45 degrees, 1 across
    for degrees, wanted in ((45.0, np.diag([9.0, 1.0])), (-45.0, np.diag([1.0, 9.0])), (90.0, [[5.0, -4], [-4, 5.0]])):
        found = integrity.along_and_across(covariance, math.radians(degrees))
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_horizontal_is_within_30_degrees():
    def doubted(degrees):
        normal, n = [math.cos(math.radians(degrees)), 0.0, math.sin(math.radians(degrees))], integrity.FEWEST_POINTS
        return integrity.reasons_to_doubt_scan(Scan(np.ones((n, 3)), [normal] * n), HERE)

    assert not doubted(29.9) and "none horizontal" in doubted(30.1)[0]
