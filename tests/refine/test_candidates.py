"""Candidates of open spaces: adjusted from large cells, scored where they come to rest."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Count, Helmert, MaximumConsensus, Multiplicity, PointMap, Scan, SearchSpace, Status, Trust, Weighting
from maxcon.refine.adjustment import FROM_LARGE_CELLS, table_around
from maxcon.refine.candidates import Scoring, adjusted_candidate, coarse_sample, distinct, find_candidates, moments_at
from maxcon.search import coarse, reference
from walled_towns import CELL, TRUTH, beside, made, seen, twins, walls

SCORING = Scoring(Helmert(), Multiplicity.OCCUPIED, Weighting.COSINE)


@given(
    seed=st.integers(0, 2), x=st.floats(-0.2, 0.2), tilt=st.floats(-0.02, 0.02),
    multiplicity=st.sampled_from(list(Multiplicity)), weighting=st.sampled_from(list(Weighting)),
    is_signed=st.booleans(),
)  # fmt: skip
def test_moments_at_a_pose_are_those_of_the_definition(seed, x, tilt, multiplicity, weighting, is_signed):
    rng = np.random.default_rng(seed)
    points, directions = rng.uniform(-3.0, 3.0, (4000, 3)), rng.normal(size=(4000, 3))
    normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    point_map = PointMap.from_points(points, normals, 0.3, is_signed=is_signed)
    normals[::3] = 0.0
    pose = beside(x).translated([0.0, 0.0, -1.6])
    pose = type(pose)(pose.x, pose.y, pose.z, tilt, -tilt, pose.heading)
    scan = Scan((points[:300] - pose.position) @ pose.rotation, normals[:300] @ pose.rotation)
    found = moments_at(
        scan, point_map, table_around(scan, point_map, [pose]), pose.values, Scoring(Helmert(), multiplicity, weighting)
    )
    one_cell = SearchSpace(0.0, heading_half_width_deg=0.0)
    wanted = reference.voxels(scan, point_map, pose, one_cell, multiplicity=multiplicity, weighting=weighting)
    assert found == pytest.approx(wanted.moments[0, 0, 0], rel=2e-3, abs=1e-2)
    assert found[0] == wanted.moments[0, 0, 0, 0]


@pytest.mark.parametrize("objective", [Helmert(), Count()])
@pytest.mark.parametrize(("x", "y", "turn_deg"), [(11.0, -9.0, 9.0), (-11.5, 3.0, -9.5), (0.0, 0.0, 0.0)])
def test_the_best_candidate_lies_at_the_true_pose(objective, x, y, turn_deg):
    point_map, scan = made(3, 4)
    scoring = Scoring(objective, Multiplicity.OCCUPIED, Weighting.COSINE)
    found, rest = find_candidates(scan, point_map, beside(x, y, turn_deg=turn_deg), SearchSpace(), 0.68, scoring)
    assert math.hypot(found[0].pose.x - TRUTH.x, found[0].pose.y - TRUTH.y) < 0.03
    assert found[0].share > 0.3 and rest <= 0.68


def test_a_window_within_reach_of_the_adjustment_needs_no_large_cells(monkeypatch):
    point_map, scan = made(3, 4)
    monkeypatch.setattr("maxcon.refine.candidates.coarse.coarse_search", None)
    space = SearchSpace(0.5, heading_half_width_deg=1.5)
    (found,), rest = find_candidates(scan, point_map, beside(0.3, -0.3, turn_deg=1.0), space, 0.68, SCORING)
    assert (found.pose.x, found.pose.y) == pytest.approx((TRUTH.x, TRUTH.y), abs=0.02) and rest == 0.0


def test_twins_make_an_answer_ambiguous():
    point_map, scan = twins(30.0)
    answer = MaximumConsensus(SearchSpace(18.0)).localize(scan, point_map, beside(14.0))
    assert answer.status is Status.AMBIGUOUS and answer.runner_up > 0.9


def test_starts_at_one_place_are_one_candidate_that_keeps_its_height_and_no_match_is_none():
    point_map, scan = made(3, 4)
    near = [adjusted_candidate(scan.sample, point_map, beside(dx), FROM_LARGE_CELLS, SCORING) for dx in (-0.2, 0.2)]
    far = adjusted_candidate(scan.sample, point_map, beside(0.0, z=50.0), FROM_LARGE_CELLS, SCORING)
    assert distinct([*near, far]) == [max(near, key=lambda each: each.score)]
    start = beside(0.3, 0.2, turn_deg=0.8)
    assert abs(adjusted_candidate(scan.sample, point_map, start, FROM_LARGE_CELLS, SCORING).pose.z - TRUTH.z) < 0.03


def test_a_mirrored_scan_that_fits_a_street_with_like_sides_is_told():
    points, normals = walls(5, n_walls=12, reach=8.0)
    flip, is_on_both = np.array([1.0, -1.0, 1.0]), points[:, 0] < 5.0
    street = (
        np.concatenate([points, (points * flip)[is_on_both]]),
        np.concatenate([normals, (normals * flip)[is_on_both]]),
    )
    point_map, truth = PointMap.from_points(*street, CELL), replace(TRUTH, heading=0.02)
    scan = seen(*street, truth, 6)
    mirrored, prior = Scan(scan.points * flip, scan.normals * flip), truth.translated([1.0, -0.5, 0.0])
    assert MaximumConsensus(trust=Trust(largest_misfit=math.inf)).localize(mirrored, point_map, prior).is_localized
    told = MaximumConsensus().localize(mirrored, point_map, prior)
    assert told.status is Status.MISFIT and "mirror image" in told.reason
    assert MaximumConsensus().localize(scan, point_map, prior).is_localized


def test_the_coarse_sample_is_thin_and_without_the_ground():
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-25.0, 25.0, (20_000, 2)), rng.normal(-1.7, 0.02, 20_000)])
    wall = np.column_stack([np.full(5000, 8.0), rng.uniform(-8.0, 8.0, 5000), rng.uniform(-1.2, 4.0, 5000)])
    sample = coarse_sample(Scan(np.concatenate([ground, wall])))
    assert (sample[:, 2] > -1.5).all() and 12 < len(sample) < 60
    assert len(coarse_sample(Scan(wall))) == len(sample)  # a scan that shows no ground


def test_of_many_points_those_with_a_normal_are_searched_with_first_whatever_their_order():
    rng = np.random.default_rng(0)
    points = rng.uniform(-40.0, 40.0, (9000, 3)) * [1.0, 1.0, 0.1]
    normals, order = np.outer(np.arange(9000) < 100, [1.0, 0.0, 0.0]), rng.permutation(9000)
    found = set(map(tuple, coarse_sample(Scan(points, normals)).tolist()))
    assert len(found) == coarse.MOST_POINTS and len(found & set(map(tuple, points[:100].tolist()))) > 50
    assert found == set(map(tuple, coarse_sample(Scan(points[order], normals[order])).tolist()))
