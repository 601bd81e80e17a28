"""The coarse search leaves open what scoring every large cell by the definition would."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Helmert, Scan, SearchSpace
from maxcon.errors import SearchSpaceError
from maxcon.search import coarse, exhaustive
from maxcon.search.coarse import coarse_search, highest_cells
from walled_towns import TRUTH, beside, made, twins


@given(
    seed=st.integers(0, 3), x=st.floats(-5.0, 5.0), y=st.floats(-5.0, 5.0), turn_deg=st.floats(-180.0, 180.0),
    ratio=st.sampled_from([0.5, 0.7, 1.0]), n_threads=st.sampled_from([1, 3]),
)  # fmt: skip
def test_the_cells_that_are_found_are_those_of_the_definition(seed, x, y, turn_deg, ratio, n_threads):
    point_map, scan = made(seed)
    points, prior, level = scan.points[::7], beside(x, y, turn_deg=turn_deg), point_map.nearest_level(coarse.CELL)
    cells = SearchSpace(4.0, heading_half_width_deg=6.0).at(level.cell, coarse.STEP_DEG)
    grid = level.normals_around(prior.x, prior.y, 60.0, (-6.0, 12.0))
    scores, found = highest_cells(points, grid, prior, cells, ratio, 0.0, n_threads)
    plain = Scan(points, np.zeros_like(points))
    wanted = exhaustive(plain, level, prior, cells, weighting="one").score(Helmert())
    # Normals are kept in 127ths: scores differ by a hundredth, and near the ratio that may decide.
    assert scores == pytest.approx(wanted[tuple(found.T)], rel=0.03)
    assert (scores >= ratio * scores.max()).all()
    assert {tuple(cell) for cell in np.argwhere(wanted >= 1.06 * ratio * wanted.max())} <= set(map(tuple, found))


@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_heights_and_tilts_are_those_of_the_prior(tilt):
    point_map, scan = made(2)
    tilted = replace(TRUTH, roll=tilt)
    points = (scan.points[::5] @ TRUTH.rotation.T) @ tilted.rotation
    space = SearchSpace(2.0, heading_half_width_deg=2.0, height_half_width=1.0)
    first = coarse_search(points, point_map, tilted.translated([0.5, 0.3, 0.96]), space, 0.7).poses[0]
    assert (first.x, first.y, first.z) == pytest.approx((TRUTH.x, TRUTH.y, TRUTH.z), abs=0.5)
    assert first.roll == tilt


def test_the_true_place_comes_first_from_far_priors_and_at_any_heading():
    point_map, scan = made(3, 4)
    for prior, space in (
        (beside(11.0, -9.0, turn_deg=9.0), SearchSpace()),
        (beside(3.0, turn_deg=143.0), SearchSpace(5.0, heading_half_width_deg=180.0)),
        (beside(-40.0, 31.0, turn_deg=77.0), SearchSpace(60.0, heading_half_width_deg=180.0)),
    ):
        first = coarse_search(scan.points[::5], point_map, prior, space, 0.7).poses[0]
        assert math.hypot(first.x - TRUTH.x, first.y - TRUTH.y) < 0.7
        assert abs(math.remainder(first.heading - TRUTH.heading, math.tau)) < math.radians(2.1)


def test_both_twins_are_left_open():
    point_map, scan = twins(30.0)
    first, second = coarse_search(scan.points[::5], point_map, beside(14.0), SearchSpace(18.0), 0.7).poses[:2]
    assert sorted([first.x, second.x]) == pytest.approx([TRUTH.x, TRUTH.x + 30.0], abs=0.7)


def test_no_more_candidates_than_a_limit_are_followed_and_the_next_one_is_told(monkeypatch):
    monkeypatch.setattr(coarse, "MOST_CANDIDATES", 2)
    point_map, scan = made(1)
    found = coarse_search(scan.points[::5], point_map, beside(), SearchSpace(), 0.1)
    assert len(found.poses) == 2 and 0.1 < found.rest_ratio < 1.0


def test_where_nothing_scores_nothing_is_left_open():
    point_map, scan = made(1)
    for points, prior in ((scan.points, replace(TRUTH, z=60.0)), (scan.points[:0], TRUTH)):
        assert coarse_search(points, point_map, prior, SearchSpace(), 0.7).poses == []


@pytest.mark.parametrize(
    "space", [SearchSpace(1000.0, heading_half_width_deg=180.0), SearchSpace(1500.0, heading_half_width_deg=0.0)]
)
def test_a_kilometre_is_too_much(space):
    point_map, scan = made(1)
    with pytest.raises(SearchSpaceError, match=r"at most 67,108,864 cells of 0\.48 m .* 536,870,912 voxels .*Narrow"):
        coarse_search(scan.points, point_map, TRUTH, space, 0.7)


@pytest.mark.parametrize(("cell", "factor"), [(0.03, 16), (0.1, 4), (0.24, 2), (0.5, 1)])
def test_large_cells_are_of_half_a_metre_whatever_the_voxels_of_the_map(cell, factor):
    point_map, _ = made(3, 4, cell)
    assert point_map.nearest_level(coarse.CELL) is point_map.level(factor)


def test_sums_of_more_points_than_sixteen_bits_hold():
    (point_map, scan), space = made(2), SearchSpace(1.0, heading_half_width_deg=0.0)
    both = scan.points[:1500].repeat(2, axis=0), scan.points[:1500]
    many, few = (coarse_search(points, point_map, TRUTH, space, 0.9) for points in both)
    assert many.poses == few.poses
