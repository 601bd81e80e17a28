"""Tests of the fit: right answers pass, distorted scans and shifted maps are noticed, named and measured."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Trust
from maxcon.estimate import Status
from maxcon.refine import fit, patterns, refine
from maxcon.refine.adjustment import table_around
from upright_walls import joined, scattered
from walled_towns import TRUTH, beside, made, seen, walls

SPACE = SearchSpace(1.0, heading_half_width_deg=2.0)
SEEDS = st.integers(0, 3)
TOO_LARGE, LONG, STRETCHED, STRETCHED_AHEAD, TWISTED, _, LEFT, AHEAD = patterns.PATTERNS
SIZES = {TOO_LARGE: 0.012, LONG: 0.15, STRETCHED: 1.0, STRETCHED_AHEAD: 1.0, TWISTED: 0.03, LEFT: 0.3, AHEAD: 0.3}


def fitted(scan, point_map, pose=TRUTH):
    """The fit at the pose that a scan is refined to."""
    refined = refine(scan, point_map, pose)
    return fit.fit_of(refined, scan.sample, point_map, table_around(scan.sample, point_map, [pose]))


def off(pose):
    """How far a pose lies from the truth in x and y, m."""
    return math.hypot(pose.x - TRUTH.x, pose.y - TRUTH.y)


def distorted(scan, pattern, size):
    return Scan(scan.points + size * pattern.direction(scan.points), scan.normals)


@given(seed=SEEDS, noise=st.floats(0.0, 0.08), every=st.integers(1, 4))
@settings(max_examples=15)
def test_a_right_answer_passes_with_noise_and_with_few_points(seed, noise, every):
    point_map, scan = made(seed)
    noisy = scan.points + np.random.default_rng(seed).normal(0.0, noise, (len(scan), 3))
    found = fitted(Scan(noisy[::every], scan.normals[::every]), point_map)
    assert (found.misfit, found.words) == (0.0, "") and np.sqrt(np.diag(found.covariance)[:2]).max() < 0.015


@given(seed=SEEDS, pattern=st.sampled_from([TOO_LARGE, LONG]), sign=st.sampled_from([-1.0, 1.0]))
@settings(max_examples=15)
def test_a_narrow_view_is_less_certain_by_what_usual_patterns_move_it_as_nothing_opposite_holds_it(seed, pattern, sign):
    point_map, scan = made(seed)
    is_ahead = np.abs(np.arctan2(scan.points[:, 1], scan.points[:, 0])) < math.radians(60.0)
    narrow = Scan(scan.points[is_ahead], scan.normals[is_ahead])
    biased = distorted(narrow, pattern, sign * pattern.usual)
    around, ahead, biased = (fitted(each, point_map) for each in (scan, narrow, biased))
    assert np.trace(ahead.covariance[:2, :2]) > 4.0 * np.trace(around.covariance[:2, :2])
    moved = biased.refined.pose.less(ahead.refined.pose)[:2]
    assert moved @ np.linalg.solve(biased.covariance[:2, :2], moved) < 9.0


@pytest.mark.parametrize(("sigma", "size", "expected"), [
    (1e6, 0.0, 0.02**2), (1e-9, 0.0, 0.0), (0.02, 0.0, 0.02**2 / 2.0), (1e-9, 0.03, 0.03**2), (1e6, 0.03, 0.02**2),
])  # fmt: skip
def test_what_a_scan_tells_of_a_pattern_bounds_what_it_adds_to_the_covariance(sigma, size, expected):
    shifts, sizes = np.zeros((6, 8)), np.zeros(8)
    shifts[0, 1], sizes[1] = -1.0, size  # ranges too long by 1 m move the pose back by 1 m
    added = patterns.Effects(sizes, np.full(8, sigma), shifts).unseen()
    assert added[0, 0] == pytest.approx(expected, abs=1e-9) and np.count_nonzero(added) <= 1


@given(seed=SEEDS, pattern=st.sampled_from(list(SIZES)), sign=st.sampled_from([-1.0, 1.0]))
@settings(max_examples=15)
def test_each_pattern_is_noticed_and_the_pose_is_that_of_the_scan_without_it(seed, pattern, sign):
    point_map, scan = made(seed)
    found = fitted(distorted(scan, pattern, sign * SIZES[pattern]), point_map)
    assert found.words
    if found.misfit < 1.0:
        assert pattern.is_of_scan and off(found.refined.pose) < 0.05


@pytest.mark.parametrize(("seed", "stretch", "twist"), [(3, 1.0, 0.04), (1, -1.2, 0.04)])
def test_a_scan_taken_in_a_bend_is_stretched_and_twisted_and_both_are_corrected(seed, stretch, twist):
    point_map, scan = made(seed)
    found = fitted(distorted(distorted(scan, STRETCHED, stretch), TWISTED, twist), point_map)
    assert found.misfit < 1.0 and off(found.refined.pose) < 0.05
    assert abs(found.refined.pose.heading - TRUTH.heading) < math.radians(0.1)
    assert all(word in found.words for word in ("stretched", "twisted"))


@pytest.mark.parametrize("axis", [0, 1])
def test_walls_ahead_without_normals_where_those_aside_have_some_are_those_of_sweeps_put_together(axis):
    point_map, scan = made(1)
    blurred = np.where(np.abs(scan.normals[:, axis : axis + 1]) > 0.6, 0.0, scan.normals)
    found = fitted(Scan(scan.points, blurred), point_map)
    assert (found.misfit > 1.0) == ("are sweeps put together without their motion?" in found.words) == (axis == 0)


@pytest.mark.parametrize("pattern", [STRETCHED, STRETCHED_AHEAD, TWISTED])
def test_a_turn_that_begins_on_the_other_side_is_tried_where_it_moves_one_side_of_the_scan_alike(pattern):
    point_map, scan = made(1)
    size, points = 0.02, scan.points
    refined = refine(scan, point_map, TRUTH)
    partners = patterns.Partners.of(refined, point_map, table_around(scan.sample, point_map, [TRUTH]))
    found = patterns.Corrected(pattern, size, scan, refined, partners, gain=0.1, significance=9.0)
    here = refined.pose.apply(points - size * pattern.direction(points))
    sides = []
    for other, same_size, move in patterns._of_other_side(found):
        assert other is not pattern and same_size == size
        there = Pose(*(refined.pose.values + move).tolist()).apply(points - size * other.direction(points))
        is_alike = np.abs(here - there).max(axis=1) < 0.002
        sides.append([bool(is_alike[side].all()) for side in (points[:, 1] > 0.0, points[:, 1] < 0.0)])
    assert sorted(sides) == [[False, True], [True, False]]


@pytest.mark.parametrize(("pattern", "size", "words"), [
    (TOO_LARGE, 0.01, "the scan looks +0.99 %"), (LONG, 0.12, "the scan has ranges that look +0.1"),
    (STRETCHED, 0.9, "the scan looks stretched along the way by +0.9 m a turn (corrected): deskew it (--deskew)"),
    (TWISTED, 0.03, "the scan looks twisted by +1.7 degrees a turn (corrected): deskew it (--deskew)"),
    (LEFT, 0.3, "the scan has what is to the left +0.3"), (AHEAD, 0.3, "the scan has what is ahead +0.3"),
])  # fmt: skip
def test_the_strongest_pattern_is_named_with_its_size(pattern, size, words):
    point_map, scan = made(1)
    assert words in fitted(distorted(scan, pattern, size), point_map).words


@pytest.mark.parametrize(("pattern", "size"), [(STRETCHED, 0.5), (STRETCHED, 1.5), (TWISTED, 0.03), (LONG, 0.15)])
def test_a_scan_is_corrected_and_a_third_of_the_shift_widens_the_covariance(pattern, size):
    point_map, scan = made(1)
    changed = distorted(scan, pattern, size)
    as_it_is, found = refine(changed, point_map, TRUTH).pose, fitted(changed, point_map)
    assert found.misfit < 1.0 and "(corrected)" in found.words
    assert off(found.refined.pose) < min(0.03, 0.7 * off(as_it_is))
    shift = found.refined.pose.values - as_it_is.values
    added = np.diag(found.covariance - 0.33**2 * np.outer(shift, shift))
    assert (added > -1e-12).all() and np.sqrt(added[:2]).max() < 0.015  # what patterns in their usual sizes add


def test_the_covariance_is_small_where_the_corrected_heading_lies_beyond_the_half_turn():
    turn = Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi - TRUTH.heading + 0.003)
    turned = PointMap.from_points(*(each @ turn.rotation.T for each in walls(1)), made(1)[0].cell)
    changed = distorted(made(1)[1], TWISTED, 0.03)
    as_it_is, found = refine(changed, turned, turn @ TRUTH).pose, fitted(changed, turned, turn @ TRUTH)
    assert as_it_is.heading > 0.0 > found.refined.pose.heading
    assert math.sqrt(found.covariance[5, 5]) < 0.01


def test_what_the_map_may_have_as_well_is_not_corrected_and_widens_the_covariance():
    point_map, scan = made(1)
    changed = distorted(scan, LEFT, 0.1)
    found = fitted(changed, point_map)
    assert 0.0 < found.misfit < 1.0 and "what is to the left +0.1" in found.words
    assert found.refined.pose == refine(changed, point_map, TRUTH).pose
    assert math.sqrt(found.covariance[1, 1]) == pytest.approx(abs(found.refined.pose.y - TRUTH.y), abs=0.02)


def test_two_explanations_from_near_places_widen_the_covariance_from_far_ones_the_scan_is_refused(monkeypatch):
    point_map, scan = made(1)
    changed = distorted(scan, STRETCHED, 0.9)
    alone = fitted(changed, point_map)
    monkeypatch.setattr(patterns, "RIVALLING", -1.0)
    monkeypatch.setattr(patterns, "APART", 0.0)
    both = fitted(changed, point_map)
    assert both.misfit == alone.misfit < 1.0
    assert np.trace((both.covariance - alone.covariance)[:2, :2]) > 0.01**2
    monkeypatch.setattr(fit, "COVERED", 0.0)
    refused = fitted(changed, point_map)
    assert refused.misfit > 1.0
    assert "it may as well be that, seen from another place, the scan " in refused.words


def test_a_large_pattern_that_the_scan_does_not_have_leaves_it_unexplained(monkeypatch):
    point_map, scan = made(1)
    monkeypatch.setattr(patterns, "LEAST_GAIN", 10.0)
    found = fitted(distorted(scan, STRETCHED, 1.2), point_map)
    assert found.misfit > 1.0
    assert "residuals stay unexplained where the scan looks stretched along the way" in found.words


def test_a_pattern_that_the_pose_takes_up_is_not_seen_in_a_scan_without_any_noise():
    ways = (((10.0, -8.0), (10.0, 8.0)), ((10.0, 8.0), (-8.0, 8.0)))
    points, normals = joined(*(scattered(*way, 20_000, seed, (0.0, 4.0)) for seed, way in enumerate(ways)))
    corner = PointMap.from_points(points, normals, cell=0.06)
    found = fitted(Scan(points - [1.0, 2.0, 1.8]), corner, Pose(1.0, 2.0, 1.8, 0.0, 0.0, 0.0))
    assert (found.misfit, found.words) == (0.0, "")


def test_away_from_the_right_pose_patches_lie_beside_the_map():
    point_map, scan = made(1)
    refined, table = refine(scan, point_map, TRUTH), table_around(scan.sample, point_map, [TRUTH])
    elsewhere = replace(refined, pose=beside(0.25, 0.2), residuals=np.full_like(refined.residuals, np.inf))
    found = fit.fit_of(elsewhere, scan.sample, point_map, table)
    assert found.misfit > 1.0 and "patches of surface lie beside those of the map" in found.words


@pytest.mark.parametrize(("noise", "apart", "is_loose"), [(0.0, False, True), (0.08, False, False), (0.0, True, False)])
def test_points_near_the_map_that_are_not_close_are_told_unless_surfaces_are_thick_or_no_points_are_neighbours(
    noise, apart, is_loose
):
    point_map, scan = made(1)
    order = np.lexsort(np.round(scan.points.T / 2.0))
    points, normals = scan.points[order], scan.normals[order]
    points = points + np.random.default_rng(0).normal(0.0, noise, (len(points), 1)) * normals
    refined = refine(Scan(points, normals), point_map, TRUTH)
    chance = np.random.default_rng(1).uniform(-0.15, 0.15, len(refined.points))
    if apart:
        refined = replace(refined, points=refined.points[::-1] * [1.0, 1.0, 1e4], normals=refined.normals[::-1])
    found = fit._loose(replace(refined, residuals=chance), point_map)
    assert bool(found) is is_loose and not fit._loose(refined, point_map)
    if is_loose:
        (misfit, words), *_ = found
        assert misfit > 1.0 and "% lie within 0.05 m of them" in words


def street(*sides):
    """Points and normals of facades 7 m to the left (1) and to the right (-1) of a way along x, with piers."""
    along, up = (grid.ravel() for grid in np.meshgrid(np.arange(-15.0, 15.0, 0.05), np.arange(0.1, 4.0, 0.08)))
    out, high = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 1.2, 0.05), np.arange(0.1, 4.0, 0.08)))
    points, normals = [], []
    for side in sides:
        points.append(np.column_stack([along, np.full(len(along), 7.0 * side), up]))
        normals.append(np.tile([0.0, -side, 0.0], (len(along), 1)))
        for x in (-12.0, -5.0, 1.0, 9.0):
            points.append(np.column_stack([np.full(len(out), x + 0.7 * side), side * (7.0 - out), high]))
            normals.append(np.tile([-math.copysign(1.0, x), 0.0, 0.0], (len(out), 1)))
    return np.concatenate(points), np.concatenate(normals)


@pytest.mark.parametrize(("side", "words"), [(1.0, "to the left"), (-1.0, "to the right")])
def test_walls_of_one_side_are_told_if_they_lie_beside_those_of_the_map_not_if_the_map_has_none(side, words):
    here = Pose(0.3, -0.4, 1.6, 0.0, 0.0, 0.05)
    scan, point_map = seen(*street(1.0, -1.0), here, seed=1), PointMap.from_points(*street(1.0, -1.0), 0.06)
    for out, is_part, is_told in ((1.2, False, True), (-1.2, False, True), (1.2, True, True), (-1.2, True, False)):
        is_moved = side * scan.points[:, 1:2] > 0.0
        if is_part:  # 1.2 m nearer it may be a scaffold: beyond its end the wall is found
            is_moved &= scan.points[:, :1] > -9.0
        moved = scan.points + is_moved * [0.0, out * side, 0.0]
        moved[::5] -= is_moved[::5] * [0.0, 2.5 * side, 0.0]  # what is far from all walls of the map tells nothing
        found = fitted(Scan(moved, scan.normals), point_map, here)
        told = words in found.words and "lie 1.2 m beside the map" in found.words
        assert (told, found.misfit > 1.0) == (is_told, is_told), (out, is_part, found.words)
    without = fitted(scan, PointMap.from_points(*street(-side), 0.06), here)
    assert (without.misfit, without.words) == (0.0, "")


def test_a_scan_that_looks_to_one_side_is_not_tested_for_what_arises_during_a_turn():
    point_map, scan = made(1)
    ahead = np.abs(np.arctan2(scan.points[:, 1], scan.points[:, 0])) < math.radians(60.0)
    part = Scan(scan.points[ahead], scan.normals[ahead])
    assert "a turn" not in fitted(distorted(part, STRETCHED, 1.0), point_map).words


def test_an_answer_that_does_not_fit_is_refused_unless_it_is_asked_for():
    point_map, scan = made(1)
    shifted = distorted(scan, LEFT, 0.3)
    refused = MaximumConsensus(SPACE, wider=0.0).localize(shifted, point_map, beside(0.2, 0.1))
    assert refused.status is Status.MISFIT and "what is to the left" in refused.reason
    trusting = MaximumConsensus(SPACE, wider=0.0, trust=Trust(largest_misfit=math.inf))
    assert trusting.localize(shifted, point_map, beside(0.2, 0.1)).is_localized


def test_the_answer_of_a_scan_that_was_not_deskewed_is_that_of_the_middle_of_its_turn():
    point_map, scan = made(1)
    answer = MaximumConsensus(SPACE).localize(distorted(scan, STRETCHED, 1.0), point_map, beside(0.2, 0.1))
    assert answer.is_localized and off(answer.pose) < 0.03
    assert "by +1.0 m a turn (corrected): deskew it (--deskew)" in answer.reason
