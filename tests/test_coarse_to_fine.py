# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coarse to fine finds the best small cell of a wide space, and says what it knows of the other places."""

import math
from dataclasses import replace

import numpy as np
import pytest

from maxcon import Count, Helmert, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status
from maxcon.coarse_to_fine import COARSE, MANY_CELLS
from maxcon.errors import SearchSpaceError
from maxcon.search import branch_and_bound

CELL = 0.06
TRUTH = Pose(1.23, -0.87, 1.6, 0.0, 0.0, 0.4)


def walls(seed, n_walls=26, reach=22.0):
    """Points and normals of short walls along and across, facing the origin, up to 4 m high."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for number in range(n_walls):
        start, length = rng.uniform(-reach, reach, 2), rng.uniform(2.0, 7.0)
        run = np.array([1.0, 0.0]) if number % 2 else np.array([0.0, 1.0])
        along, up = (
            grid.ravel() for grid in np.meshgrid(np.arange(0.0, length, 0.04), np.arange(0.1, 4.0, 0.1))
        )
        on_wall = np.column_stack([start + along[:, None] * run, up])
        normal = np.array([run[1], run[0], 0.0])
        normal *= -np.sign(normal[:2] @ (start + 0.5 * length * run)) or 1.0
        points.append(on_wall + rng.normal(0.0, 0.005, on_wall.shape))
        normals.append(np.tile(normal, (len(on_wall), 1)))
    return np.concatenate(points), np.concatenate(normals)


def seen(points, normals, truth, seed, n_points=4000):
    """A scan of some of the points, with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    which = rng.choice(len(points), n_points, replace=False)
    noisy = points[which] + rng.normal(0.0, 0.01, (n_points, 3))
    return Scan((noisy - truth.position) @ truth.rotation, normals[which] @ truth.rotation)


@pytest.fixture(scope="module")
def town():
    points, normals = walls(3)
    return PointMap.from_points(points, normals, CELL), seen(points, normals, TRUTH, 4)


def places(method, scan, point_map, prior, space):
    return method.cell_search.places(scan, point_map, prior, space)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("objective", [Helmert(), Count()])
def test_it_finds_the_best_small_cell_of_the_whole_space(seed, objective):
    rng = np.random.default_rng(seed)
    points, normals = walls(seed)
    point_map, scan = PointMap.from_points(points, normals, CELL), seen(points, normals, TRUTH, seed)
    prior = replace(
        TRUTH,
        x=TRUTH.x + rng.uniform(-2.8, 2.8),
        y=TRUTH.y + rng.uniform(-2.8, 2.8),
        heading=TRUTH.heading + 0.02,
    )
    method, space = MaximumConsensus(objective=objective), SearchSpace(3.0, heading_half_width_deg=2.0)
    best = places(method, scan, point_map, prior, space)[0]
    cells = space.at(CELL)
    wanted = branch_and_bound(scan.thinned(method.thinning), point_map, prior, cells, objective)
    expected = cells.pose(wanted.cell, prior)
    assert best.score == pytest.approx(wanted.score, rel=1e-9)
    assert best.pose.position == pytest.approx(expected.position, abs=1e-9)
    assert best.pose.heading == pytest.approx(expected.heading, abs=1e-9)


@pytest.mark.parametrize(("x", "y", "turn_deg"), [(11.0, -9.0, 9.0), (-11.5, 3.0, -9.5), (0.0, 0.0, 0.0)])
def test_far_priors_are_no_matter(town, x, y, turn_deg):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + x, y=TRUTH.y + y, heading=TRUTH.heading + math.radians(turn_deg))
    answer = MaximumConsensus().localize(scan, point_map, prior)
    assert answer.is_localized
    assert answer.cell is None
    assert math.hypot(answer.pose.x - TRUTH.x, answer.pose.y - TRUTH.y) < 0.02
    assert answer.pose.heading == pytest.approx(TRUTH.heading, abs=1e-3)
    assert answer.runner_up < 0.8


@pytest.mark.parametrize(("cell", "factor"), [(0.03, 16), (0.1, 4), (0.24, 2), (0.5, 1)])
def test_large_cells_are_of_half_a_metre_whatever_the_voxels_of_the_map(cell, factor):
    points, normals = walls(3)
    point_map, scan = PointMap.from_points(points, normals, cell), seen(points, normals, TRUTH, 4)
    assert COARSE.of(point_map) is point_map.level(factor)
    answer = MaximumConsensus().localize(scan, point_map, replace(TRUTH, x=TRUTH.x + 9.0, y=TRUTH.y - 8.0))
    assert answer.is_localized
    assert math.hypot(answer.pose.x - TRUTH.x, answer.pose.y - TRUTH.y) < 0.02


def test_any_heading(town):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + 3.0, heading=TRUTH.heading + 2.5)
    method = MaximumConsensus(SearchSpace(5.0, heading_half_width_deg=180.0))
    answer = method.localize(scan, point_map, prior)
    assert answer.is_localized
    assert math.remainder(answer.pose.heading - TRUTH.heading, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_sixty_metres_at_any_heading_find_what_twelve_and_ten_degrees_do(seed):
    rng = np.random.default_rng(seed)
    points, normals = walls(seed)
    point_map, scan = PointMap.from_points(points, normals, CELL), seen(points, normals, TRUTH, seed)
    x, y = rng.uniform(-11.0, 11.0, 2)
    prior = replace(TRUTH, x=TRUTH.x + x, y=TRUTH.y + y, heading=TRUTH.heading + rng.uniform(-0.15, 0.15))
    wide = SearchSpace(60.0, heading_half_width_deg=180.0)
    assert COARSE.cells(wide, point_map).n_cells > MANY_CELLS > COARSE.cells(SearchSpace(), point_map).n_cells
    found, *_ = places(MaximumConsensus(), scan, point_map, prior, wide)
    wanted, *_ = places(MaximumConsensus(), scan, point_map, prior, SearchSpace())
    assert found.score == pytest.approx(wanted.score, rel=1e-9)
    assert found.pose.position == pytest.approx(wanted.pose.position, abs=1e-9)
    assert math.remainder(found.pose.heading - wanted.pose.heading, 2.0 * math.pi) == pytest.approx(
        0.0, abs=1e-9
    )


def test_twins_farther_apart_than_wide_cells_make_it_ambiguous():
    points, normals = walls(5, n_walls=12, reach=8.0)
    twin = points + [69.6, 0.0, 0.0]  # whole voxels
    point_map = PointMap.from_points(np.concatenate([points, twin]), np.concatenate([normals, normals]), CELL)
    scan = seen(points, normals, TRUTH, 6)
    method = MaximumConsensus(SearchSpace(60.0, heading_half_width_deg=180.0))
    assert method.localize(scan, point_map, replace(TRUTH, x=TRUTH.x + 33.0)).status is Status.AMBIGUOUS


def test_a_twin_makes_it_ambiguous_and_both_are_places():
    points, normals = walls(5, n_walls=12, reach=8.0)
    twin = points + [30.0, 0.0, 0.0]
    point_map = PointMap.from_points(np.concatenate([points, twin]), np.concatenate([normals, normals]), CELL)
    scan = seen(points, normals, TRUTH, 6)
    prior = replace(TRUTH, x=TRUTH.x + 14.0)
    method, space = MaximumConsensus(SearchSpace(18.0)), SearchSpace(18.0)
    found = places(method, scan, point_map, prior, space)
    assert [each.pose.x for each in found[:2]] == pytest.approx([TRUTH.x, TRUTH.x + 30.0], abs=0.1) or [
        each.pose.x for each in found[:2]
    ] == pytest.approx([TRUTH.x + 30.0, TRUTH.x], abs=0.1)
    assert found[0].runner_up > 0.9
    assert found[0].runner_up == pytest.approx(
        float(Helmert().score(found[1].moments)) / float(Helmert().score(found[0].moments))
    )
    assert method.localize(scan, point_map, prior).status is Status.AMBIGUOUS


def test_what_was_left_out_is_not_taken_for_nothing(town):
    point_map, scan = town
    (best, *others) = places(MaximumConsensus(), scan, point_map, TRUTH, SearchSpace())
    assert not others
    assert best.runner_up == pytest.approx(0.85 * 0.8)  # proved in large cells, not more


@pytest.mark.parametrize("beyond", [2.97, 3.3])
def test_an_answer_in_the_outermost_cell_or_beyond_is_at_the_rim(town, beyond):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x - beyond)
    space = SearchSpace(3.0, heading_half_width_deg=2.0)
    best = places(MaximumConsensus(), scan, point_map, prior, space)[0]
    assert best.is_at_rim
    inside = places(MaximumConsensus(), scan, point_map, replace(prior, x=TRUTH.x - 2.5), space)[0]
    assert not inside.is_at_rim
    answer = MaximumConsensus(space, wider=0.0).localize(scan, point_map, prior)
    assert answer.status is Status.AT_RIM


def test_a_heading_that_is_certain_is_kept(town):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + 2.0, heading=TRUTH.heading + math.radians(0.3))
    best = places(MaximumConsensus(), scan, point_map, prior, SearchSpace(3.0, heading_half_width_deg=0.0))[0]
    assert best.pose.heading == prior.heading


def test_heights_are_searched_in_small_cells_too(town):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + 4.0, z=TRUTH.z + 0.42)
    space = SearchSpace(6.0, heading_half_width_deg=4.0, height_half_width=0.6)
    best = places(MaximumConsensus(), scan, point_map, prior, space)[0]
    assert best.pose.z == pytest.approx(TRUTH.z, abs=0.5 * CELL + 1e-9)


def test_where_nothing_matches_that_is_said(town):
    point_map, scan = town
    far = replace(TRUTH, z=60.0)
    assert places(MaximumConsensus(), scan, point_map, far, SearchSpace()) == []
    assert MaximumConsensus().localize(scan, point_map, far).status is Status.NO_MATCH


def test_a_small_open_space_is_searched_in_small_cells_at_once(town):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + 0.4)
    is_open, given = SearchSpace(0.6, heading_half_width_deg=1.0), SearchSpace(0.6, CELL, 1.0, 0.5)
    method = MaximumConsensus(is_open, refinement=False)
    assert not method.cell_search.is_coarse_to_fine(is_open, point_map)
    answer, wanted = (
        replace(method, space=space).localize(scan, point_map, prior) for space in (is_open, given)
    )
    assert (answer.pose, answer.score, answer.cell) == (wanted.pose, wanted.score, wanted.cell)


def test_given_cells_of_a_level_are_searched_in_it(town):
    point_map, scan = town
    prior = replace(TRUTH, x=TRUTH.x + 1.0)
    space = SearchSpace(3.6, 0.12, 2.0, 1.0)
    answer = MaximumConsensus(space, refinement=False).localize(scan, point_map, prior)
    thinned = scan.thinned(MaximumConsensus().thinning)
    wanted = branch_and_bound(thinned, point_map.level(2), prior, space, Helmert())
    assert (answer.cell, answer.score) == (wanted.cell, wanted.score)


def test_a_kilometre_at_any_heading_is_too_much(town):
    point_map, scan = town
    space = SearchSpace(1000.0, heading_half_width_deg=180.0)
    with pytest.raises(SearchSpaceError, match=r"at most 268,435,456 cells of 0\.96 m .*Narrow"):
        MaximumConsensus(space).localize(scan, point_map, TRUTH)


def test_a_place_that_was_given_up_in_small_cells_scores_less_than_the_share():
    points, normals = walls(5, n_walls=12, reach=8.0)
    twin = points + [30.0, 0.0, 0.0]
    part = np.random.default_rng(0).random(len(points)) < 0.6  # in large cells that hardly shows
    both = np.concatenate([points, twin[part]]), np.concatenate([normals, normals[part]])
    point_map, scan = PointMap.from_points(*both, CELL), seen(points, normals, TRUTH, 6)
    (best,) = places(MaximumConsensus(), scan, point_map, replace(TRUTH, x=TRUTH.x + 14.0), SearchSpace(18.0))
    (alone,) = places(MaximumConsensus(), scan, point_map, TRUTH, SearchSpace(6.0))
    assert alone.runner_up == pytest.approx(0.68)
    assert best.runner_up == pytest.approx(0.8) and best.runner_up < 0.8
