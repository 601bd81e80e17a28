# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Coarse to fine finds the best small cell of a wide space, and says what it knows of the other candidates."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maxcon import Count, Helmert, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status
from maxcon.errors import SearchSpaceError
from maxcon.search import Found, branch_and_bound, coarse_to_fine
from maxcon.search.coarse_to_fine import (
    COARSE,
    MANY_CELLS,
    WIDE,
    BestCell,
    _is_at_boundary,
    best_candidates,
    distinct_candidates,
)
from maxcon.search.scored_cells import Candidates

CELL = 0.06
TRUTH = Pose(1.23, -0.87, 1.6, 0.0, 0.0, 0.4)


def walls(seed, n_walls=26, reach=22.0):
    """Points and normals of short walls along and across, facing the origin, up to 4 m high."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for number in range(n_walls):
        start, length = rng.uniform(-reach, reach, 2), rng.uniform(2.0, 7.0)
        run = np.array([1.0, 0.0]) if number % 2 else np.array([0.0, 1.0])
        along, up = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, length, 0.04), np.arange(0.1, 4.0, 0.1)))
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


def made(seed, truth_seed=None, cell=CELL):
    """Map and scan of a town of walls."""
    points, normals = walls(seed)
    return PointMap.from_points(points, normals, cell), seen(points, normals, TRUTH, truth_seed or seed)


def beside(x=0.0, y=0.0, z=0.0, turn_deg=0.0):
    """The true pose moved and turned."""
    return replace(TRUTH.translated([x, y, z]), heading=TRUTH.heading + math.radians(turn_deg))


def candidates(scan, point_map, prior, space, **options):
    return MaximumConsensus(**options).cell_search.candidates(scan, point_map, prior, space)


@pytest.fixture(scope="module")
def town():
    return made(3, 4)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("objective", [Helmert(), Count()])
def test_it_finds_the_best_small_cell_of_the_whole_space(seed, objective):
    point_map, scan = made(seed)
    prior = beside(*np.random.default_rng(seed).uniform(-2.8, 2.8, 2), turn_deg=1.1)
    space = SearchSpace(3.0, heading_half_width_deg=2.0)
    best = candidates(scan, point_map, prior, space, objective=objective)[0]
    cells = space.at(CELL)
    wanted = branch_and_bound(scan.thinned(MaximumConsensus().thinning), point_map, prior, cells, objective)
    assert_same_pose(best, wanted.score, cells.pose(wanted.cell, prior))


def assert_same_pose(best, score, pose):
    __tracebackhide__ = True
    assert best.score == pytest.approx(score, rel=1e-9)
    assert best.pose.position == pytest.approx(pose.position, abs=1e-9)
    assert math.remainder(best.pose.heading - pose.heading, math.tau) == pytest.approx(0.0, abs=1e-9)


ANY_HEADING = MaximumConsensus(SearchSpace(5.0, heading_half_width_deg=180.0))


@pytest.mark.parametrize(
    ("method", "x", "y", "turn_deg"),
    [
        (MaximumConsensus(), 11.0, -9.0, 9.0),
        (MaximumConsensus(), -11.5, 3.0, -9.5),
        (MaximumConsensus(), 0.0, 0.0, 0.0),
        (ANY_HEADING, 3.0, 0.0, 143.0),
    ],
)
def test_far_priors_are_no_matter(town, method, x, y, turn_deg):
    point_map, scan = town
    answer = method.localize(scan, point_map, beside(x, y, turn_deg=turn_deg))
    assert (answer.is_localized, answer.cell, answer.runner_up < 0.8) == (True, None, True)
    assert math.hypot(answer.pose.x - TRUTH.x, answer.pose.y - TRUTH.y) < 0.02
    assert math.remainder(answer.pose.heading - TRUTH.heading, math.tau) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("cell", "factor"), [(0.03, 16), (0.1, 4), (0.24, 2), (0.5, 1)])
def test_large_cells_are_of_half_a_metre_whatever_the_voxels_of_the_map(cell, factor):
    point_map, scan = made(3, 4, cell)
    assert COARSE.of(point_map) is point_map.level(factor)
    answer = MaximumConsensus().localize(scan, point_map, beside(9.0, -8.0))
    assert answer.is_localized
    assert math.hypot(answer.pose.x - TRUTH.x, answer.pose.y - TRUTH.y) < 0.02


@pytest.mark.parametrize("seed", range(2))
def test_sixty_metres_at_any_heading_find_what_twelve_and_ten_degrees_do(seed):
    rng = np.random.default_rng(seed)
    point_map, scan = made(seed)
    prior = beside(*rng.uniform(-11.0, 11.0, 2), turn_deg=rng.uniform(-8.6, 8.6))
    wide = SearchSpace(60.0, heading_half_width_deg=180.0)
    assert COARSE.cells(wide, point_map).n_cells > MANY_CELLS > COARSE.cells(SearchSpace(), point_map).n_cells
    wanted = candidates(scan, point_map, prior, SearchSpace())[0]
    assert_same_pose(candidates(scan, point_map, prior, wide)[0], wanted.score, wanted.pose)


def twins(apart, part=slice(None)):
    """Map and scan of walls that stand once more, in part, so many metres along x."""
    points, normals = walls(5, n_walls=12, reach=8.0)
    both = np.concatenate([points, (points + [apart, 0.0, 0.0])[part]]), np.concatenate([normals, normals[part]])
    return PointMap.from_points(*both, CELL), seen(points, normals, TRUTH, 6)


def test_a_twin_makes_it_ambiguous_and_both_are_candidates():
    point_map, scan = twins(30.0)
    prior, space = beside(14.0), SearchSpace(18.0)
    first, second, *_ = candidates(scan, point_map, prior, space)
    assert sorted([first.pose.x, second.pose.x]) == pytest.approx([TRUTH.x, TRUTH.x + 30.0], abs=0.1)
    scores = [float(Helmert().score(each.moments)) for each in (first, second)]
    assert first.runner_up == pytest.approx(scores[1] / scores[0]) and first.runner_up > 0.9
    assert MaximumConsensus(space).localize(scan, point_map, prior).status is Status.AMBIGUOUS


def test_twins_farther_apart_than_wide_cells_make_it_ambiguous():
    point_map, scan = twins(69.6)  # whole voxels
    method = MaximumConsensus(SearchSpace(60.0, heading_half_width_deg=180.0))
    assert method.localize(scan, point_map, beside(33.0)).status is Status.AMBIGUOUS


def test_a_candidate_that_was_given_up_in_small_cells_scores_less_than_the_ratio(town):
    point_map, scan = twins(30.0, np.random.default_rng(0).random(len(walls(5, 12, 8.0)[0])) < 0.6)
    (best,) = candidates(scan, point_map, beside(14.0), SearchSpace(18.0))  # in large cells that hardly shows
    assert best.runner_up == pytest.approx(0.8) and best.runner_up < 0.8
    (alone,) = candidates(*town[::-1], TRUTH, SearchSpace())
    assert alone.runner_up == pytest.approx(0.85 * 0.8)  # proved in large cells, not more


@pytest.mark.parametrize("beyond", [2.97, 3.3])
def test_an_answer_in_the_outermost_cell_or_beyond_is_at_the_boundary(town, beyond):
    point_map, scan = town
    space = SearchSpace(3.0, heading_half_width_deg=2.0)
    assert candidates(scan, point_map, beside(-beyond), space)[0].is_at_boundary
    assert not candidates(scan, point_map, beside(-2.5), space)[0].is_at_boundary
    assert MaximumConsensus(space, wider=0.0).localize(scan, point_map, beside(-beyond)).status is Status.AT_RIM


def test_a_heading_that_is_certain_is_kept_and_heights_are_searched_in_small_cells_too(town):
    point_map, scan = town
    prior = beside(2.0, turn_deg=0.3)
    best = candidates(scan, point_map, prior, SearchSpace(3.0, heading_half_width_deg=0.0))[0]
    assert best.pose.heading == prior.heading
    space = SearchSpace(6.0, heading_half_width_deg=4.0, height_half_width=0.6)
    best = candidates(scan, point_map, beside(4.0, z=0.42), space)[0]
    assert best.pose.z == pytest.approx(TRUTH.z, abs=0.5 * CELL + 1e-9)
    far = replace(TRUTH, z=60.0)
    assert candidates(scan, point_map, far, SearchSpace()) == []
    assert MaximumConsensus().localize(scan, point_map, far).status is Status.NO_MATCH


def test_a_small_open_space_is_searched_in_small_cells_at_once(town):
    point_map, scan = town
    prior = beside(0.4)
    is_open, given = SearchSpace(0.6, heading_half_width_deg=1.0), SearchSpace(0.6, CELL, 1.0, 0.5)
    method = MaximumConsensus(is_open, refinement=False)
    assert not method.cell_search.is_coarse_to_fine(is_open, point_map)
    answer, wanted = (replace(method, space=space).localize(scan, point_map, prior) for space in (is_open, given))
    assert (answer.pose, answer.score, answer.cell) == (wanted.pose, wanted.score, wanted.cell)


def test_given_cells_of_a_level_are_searched_in_it(town):
    point_map, scan = town
    prior = beside(1.0)
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


# --- what is followed, by searches whose answers are given ---------------------------------------------------------

EDGE = 8 * CELL  # of a coarse cell
HERE = Pose(0.0, 0.0, 1.5, 0.0, 0.0, 0.0)


def moments_of(score):
    """Moments that have this score by Helmert's."""
    return np.array([100.0, 2.0 * score, 0.0, 2.0 * score])


class Hills:
    """A search of a map of hills alone: a cell scores what the highest hill in it does, by the edge of the cell.

    hills : (x, y, turn in degrees, {cell edge: score}) each; what it is asked is kept.
    """

    def __init__(self, *hills):
        self.hills, self.asked = hills, []

    def __call__(self, scan, point_map, prior, space, *, share=1.0, lists_all=False, incumbent=None):
        edge = round(point_map.cell, 2)
        asked = {"scan": scan, "prior": prior, "space": space, "share": share, "incumbent": incumbent}
        self.asked.append(SimpleNamespace(edge=edge, lists_all=lists_all, **asked))
        scores = {}
        for x, y, turn_deg, of_edges in self.hills:
            cell = space.nearest_cell(replace(prior, x=x, y=y, heading=math.radians(turn_deg)), prior)
            pose = space.pose(cell, prior)
            off = max(abs(pose.x - x), abs(pose.y - y))
            if off <= edge / 2 + 1e-9 and abs(math.degrees(pose.heading) - turn_deg) <= space.step_deg / 2 + 1e-9:
                scores[cell] = max(scores.get(cell, 0.0), of_edges.get(edge, 0.0))
        cell = max(scores, key=scores.get, default=(0, 0, 0))
        score = scores.get(cell, 0.0)
        reached = [each for each in scores if scores[each] > 0.0 and scores[each] >= share * score]
        if incumbent is not None:
            reached = [each for each in reached if scores[each] >= incumbent.score]
        reaching = Candidates(np.array(reached).reshape(-1, 3), np.array([scores[each] for each in reached]))
        return Found(cell, score, moments_of(score), score, 0.0, 1, reaching=reaching)

    def of(self, edge):
        return [asked for asked in self.asked if asked.edge == edge]


def hill(x, y, turn_deg=0.0, coarse=10.0, fine=10.0, wide=10.0):
    """A hill in the middle of a coarse cell, at so many of them along x and y."""
    return (x * EDGE, y * EDGE, turn_deg, {2 * EDGE: wide, EDGE: coarse, CELL: fine})


@pytest.fixture(scope="module")
def nowhere():
    """A map for its cells alone, and a scan of some points for their number."""
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (500, 3))
    return Scan(points, np.zeros_like(points)), PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], CELL)


def test_cells_within_a_metre_and_four_degrees_are_one_candidate(nowhere):
    near = hill(2, 0, 0.0, 9.9, 1.0), hill(0, -2, 2.0, 9.8, 1.0), hill(-1, 1, -2.0, 9.7, 1.0)
    far = hill(3, 0, 0.0, 9.6), hill(0, 0, 6.0, 9.5), hill(-2, -2, 0.0, 9.4), hill(0, 0, -6.0, 9.3)
    search = Hills(hill(0, 0), *near, *far)
    best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)
    followed = [(asked.prior.x, asked.prior.y, math.degrees(asked.prior.heading)) for asked in search.of(CELL)]
    assert np.array(followed) == pytest.approx(np.array([each[:3] for each in (hill(0, 0), *far)]))


@pytest.mark.parametrize(
    ("x", "y", "turn_deg", "n"),
    [
        (1.0, 0.0, 0.0, 1),
        (0.6, 0.8, 3.99, 1),
        (1.01, 0.0, 0.0, 2),
        (0.0, 0.0, 4.01, 2),
        (0.8, 0.8, 0.0, 2),
        (0.0, 0.0, 359.0, 1),
    ],
)
def test_the_highest_best_cell_of_a_candidate_stands_for_it(x, y, turn_deg, n):
    other = replace(HERE, x=x, y=y, heading=math.radians(turn_deg))
    space = SearchSpace(0.0, CELL, 0.0, 0.5)
    low, high = (
        BestCell(space, pose, (0, 0, 0), score, moments_of(score), 0.0) for pose, score in ((HERE, 3.0), (other, 4.0))
    )
    assert distinct_candidates([low, high]) == [high, low][:n] == distinct_candidates([high, low])


def test_coarse_cells_are_followed_that_reach_so_much_of_the_ratio_that_is_asked_for(nowhere):
    scan, _ = nowhere
    search = Hills(hill(0, 0, coarse=10.0), hill(9, 0, coarse=6.81, fine=9.0), hill(-9, 0, coarse=6.79, fine=20.0))
    first, second = best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)
    (coarse,) = search.of(EDGE)
    assert (coarse.share, coarse.lists_all) == (pytest.approx(0.85 * 0.8), True)
    assert (coarse.space.cell, coarse.space.heading_step_deg) == (pytest.approx(EDGE), 2.0)
    assert len(coarse.scan) == len(scan.thinned(1.0)) < len(scan)
    assert [(len(asked.scan), asked.lists_all) for asked in search.of(CELL)] == 2 * [(500, False)]
    assert (first.score, second.score) == (10.0, 9.0)
    assert (first.pose.x, second.pose.x) == (pytest.approx(0.0), pytest.approx(9 * EDGE))
    assert (first.runner_up, second.runner_up) == (pytest.approx(0.9), pytest.approx(10.0 / 9.0))


@pytest.mark.parametrize(
    ("best", "other"),
    [({}, {"coarse": 9.0, "fine": 8.0}), ({"coarse": 1.0, "fine": 1.0}, {"coarse": 0.85 * 0.8, "fine": 0.8})],
)
def test_what_just_reaches_the_ratio_in_small_or_in_coarse_cells_is_a_candidate(nowhere, best, other):
    search = Hills(hill(0, 0, **best), hill(9, 0, **other))
    assert len(best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)) == 2


def test_a_candidate_of_a_lower_coarse_score_may_be_the_best_and_what_is_given_up_is_below_the_ratio(nowhere):
    search = Hills(hill(0, 0, fine=5.0), hill(9, 0, coarse=9.0, fine=10.0), hill(0, 9, coarse=8.0, fine=7.9))
    best, other = best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)
    assert (best.score, other.score) == (10.0, 5.0)  # the third reaches 0.8 of 5, but not of 10
    assert [asked.incumbent and asked.incumbent.score for asked in search.of(CELL)] == [None, 4.0, 8.0]
    assert best.runner_up == math.nextafter(0.8, 0.0)
    assert other.runner_up == pytest.approx(2.0)


def test_no_more_than_twelve_candidates_are_followed_and_the_thirteenth_is_told(nowhere):
    def along(n, coarse):
        return [hill(4 * (k % 5) - 8, 4 * (k // 5) - 8, 0.0, coarse - 0.01 * k, 10.0 - 5.0 * (k > 0)) for k in range(n)]

    for n, rest in ((12, math.nextafter(0.8, 0.0)), (13, 9.88 / 10.0), (20, 9.88 / 10.0)):
        search = Hills(*along(n, 10.0))
        (best,) = best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)
        assert len(search.of(CELL)) == 12
        assert rest <= best.runner_up + 1e-9 <= 1.0 + 1e-9
        assert n > 12 or best.runner_up == rest


def test_small_cells_are_searched_around_a_coarse_one_as_far_as_the_space_goes(nowhere):
    for space, wanted in (
        (SearchSpace(12.0, height_half_width=3.0), (0.48, 1.5, 0.24)),
        (SearchSpace(12.0), (0.48, 1.5, 0.0)),
        (SearchSpace(12.0, heading_half_width_deg=1.0, height_half_width=0.12), (0.48, 1.0, 0.12)),
        (SearchSpace(0.3, heading_half_width_deg=0.0), (0.3, 0.0, 0.0)),
    ):
        search = Hills(hill(0, 0))
        best_candidates(search, *nowhere, HERE, space, 0.8)
        (fine,) = search.of(CELL)
        assert (fine.space.half_width, fine.space.heading_half_width_deg) == pytest.approx(wanted[:2])
        assert fine.space.height_half_width == pytest.approx(wanted[2])


@pytest.mark.parametrize("cell", [(3, 8, 15), (3, 0, 8), (0, 8, 8), (6, 8, 8)])
def test_from_a_best_small_cell_at_the_boundary_hill_climbing_goes_on_four_times(nowhere, cell):
    """In the middle it is stopped; each time it is looked around the last best cell."""

    class Slope(Hills):
        def __call__(self, scan, point_map, prior, space, **options):
            found = super().__call__(scan, point_map, prior, space, **options)
            if point_map.cell != CELL:
                return found
            n = len(self.of(CELL))
            return replace(
                found, cell=cell if n < self.stops else (3, 8, 8), score=10.0 + n, moments=moments_of(10.0 + n)
            )

    for stops, n_looked in ((3, 3), (5, 5), (9, 5)):
        search = Slope(hill(0, 0))
        search.stops = stops
        (best,) = best_candidates(search, *nowhere, HERE, SearchSpace(12.0), 0.8)
        asked = search.of(CELL)
        assert len(asked) == n_looked
        for one, other in itertools.pairwise(asked):
            assert other.prior == one.space.pose(cell, one.prior)
        last = (3, 8, 8) if stops == n_looked else cell
        assert (best.score, best.pose) == (10.0 + n_looked, asked[-1].space.pose(last, asked[-1].prior))


def test_a_very_wide_space_is_searched_in_wide_cells_first_and_in_coarse_ones_around_these(nowhere):
    scan, point_map = nowhere
    space = SearchSpace(60.0, heading_half_width_deg=180.0)
    hills = (
        hill(0, 0, wide=10.0, coarse=8.0),
        hill(20, 0, wide=9.0, coarse=10.0, fine=9.0),
        hill(0, 20, wide=6.01, coarse=6.7, fine=30.0),  # below 0.85 * 0.8 of the best coarse one
        hill(0, -20, wide=5.99, coarse=10.0, fine=30.0),  # below 0.75 * 0.8 of the best wide one
    )
    search = Hills(*hills)
    first, second = best_candidates(search, scan, point_map, HERE, space, 0.8)
    assert (first.score, second.score) == (10.0, 9.0)
    (wide,) = search.of(2 * EDGE)
    assert (wide.share, wide.lists_all) == (pytest.approx(0.75 * 0.8), True)
    assert (wide.space.cell, wide.space.heading_step_deg) == (pytest.approx(2 * EDGE), 2.0)
    assert len(wide.scan) == len(scan.thinned(2.0)) < len(scan.thinned(1.0))
    coarse = search.of(EDGE)
    assert [asked.share for asked in coarse] == pytest.approx([0.68, 0.68, 0.68])
    assert coarse[0].incumbent is None
    assert [asked.incumbent.score for asked in coarse[1:]] == pytest.approx([5.44, 6.8])
    assert [asked.prior.x for asked in coarse] == pytest.approx([0.0, 20 * EDGE, 0.0])
    assert all((asked.space.half_width, asked.space.heading_half_width_deg) == (0.96, 2.0) for asked in coarse)
    assert {asked.space.height_half_width for asked in coarse} == {0.0}
    assert best_candidates(Hills(*hills[:1]), scan, point_map, HERE, space, 0.8)[0].runner_up == pytest.approx(0.68)
    low = best_candidates(Hills(*hills[:1]), scan, point_map, HERE, replace(space, height_half_width=3.0), 0.8)
    assert len(low) == 1


def test_no_more_wide_cells_are_followed_than_a_limit(nowhere, monkeypatch):
    assert coarse_to_fine.MOST_WIDE_CANDIDATES == 256
    monkeypatch.setattr(coarse_to_fine, "MOST_WIDE_CANDIDATES", 20)
    space = SearchSpace(60.0, heading_half_width_deg=180.0)
    hills = [hill(6 * (k % 7) - 18, 6 * (k // 7) - 18, 0.0, 5.0, 5.0, 10.0 - 0.01 * k) for k in range(30)]
    hills[0] = hill(-18, -18)
    search = Hills(*hills)
    (best,) = best_candidates(search, *nowhere, HERE, space, 0.8)
    assert len(search.of(EDGE)) == 20
    assert best.runner_up == pytest.approx((10.0 - 0.2) / 10.0)


@pytest.mark.parametrize(("level", "edge"), [(COARSE, 0.48), (WIDE, 0.96)])
@pytest.mark.parametrize("cell", [0.015, 0.02, 0.06, 0.11, 0.3, 0.7, 2.0])
def test_the_level_of_a_map_is_that_of_the_nearest_edge_by_ratio(level, edge, cell):
    point_map = PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], cell)
    factor = min(2**k for k in range(6) if 2**k * cell * math.sqrt(2.0) > edge or k == 5)
    assert level.of(point_map).cell == pytest.approx(factor * cell)


@pytest.mark.parametrize(
    ("offset", "turn_deg", "space", "is_at_boundary"),
    [
        (11.88, 0.0, SearchSpace(12.0), False),
        (11.94, 0.0, SearchSpace(12.0), True),
        (-11.94, 0.0, SearchSpace(12.0), False),
        (-12.0, 0.0, SearchSpace(12.0), True),
        (-12.3, 0.0, SearchSpace(12.0), True),
        (0.0, 10.24, SearchSpace(12.0), False),
        (0.0, -10.26, SearchSpace(12.0), True),
        (0.0, 349.76, SearchSpace(12.0), False),
        (0.03, 0.0, SearchSpace(0.0), False),
        (0.3, 0.0, SearchSpace(0.3), True),
        (0.0, 0.0, SearchSpace(CELL), False),
        (-CELL, 0.0, SearchSpace(CELL), False),
        (CELL, 0.0, SearchSpace(CELL), True),
    ],
)
@pytest.mark.parametrize("is_along_y", [False, True])
def test_the_boundary_is_the_outermost_cell_or_half_a_step_beyond_the_last_heading(
    offset, turn_deg, space, is_along_y, is_at_boundary
):
    for at in (0.0, 0.1, 50.0, -1234.56):  # rounding decides nothing
        prior = replace(HERE, x=at, y=-at, heading=2.0)
        x, y = (0.0, offset) if is_along_y else (offset, 0.0)
        pose = replace(prior.translated([x, y, 0.0]), heading=prior.heading + math.radians(turn_deg))
        assert _is_at_boundary(pose, prior, space, CELL) is is_at_boundary


def test_however_low_scores_are_candidates_are_found_but_none_where_all_are_zero(nowhere):
    low, zero = Hills(hill(0, 0, 0.0, 1e-3, 1e-3)), Hills(hill(0, 0, 0.0, 0.0, 0.0))
    (best,) = best_candidates(low, *nowhere, HERE, SearchSpace(12.0), 0.8)
    assert (best.score, best.runner_up) == (1e-3, pytest.approx(0.68))
    assert best_candidates(zero, *nowhere, HERE, SearchSpace(12.0), 0.8) == []


def test_a_candidate_that_matches_determine_in_no_direction_may_have_any_runner_up(nowhere):
    class Counted(Hills):
        def __call__(self, *arguments, **options):
            return replace(super().__call__(*arguments, **options), moments=np.array([10.0, 10.0, 0.0, 0.0]))

    (best,) = best_candidates(Counted(hill(0, 0)), *nowhere, HERE, SearchSpace(12.0), 0.8)
    assert (best.score, best.runner_up) == (10.0, math.inf)


def test_more_cells_than_many_are_searched_in_wide_ones_first_and_more_than_most_are_refused(nowhere, monkeypatch):
    space, search = SearchSpace(12.0), Hills(hill(0, 0))
    n_cells = COARSE.cells(space, nowhere[1]).n_cells
    monkeypatch.setattr(coarse_to_fine, "MOST_LARGE_CELLS", n_cells)
    for many, n_wide in ((n_cells, 0), (n_cells - 1, 1)):
        monkeypatch.setattr(coarse_to_fine, "MANY_CELLS", many)
        best_candidates(search, *nowhere, HERE, space, 0.8)
        assert len(search.of(2 * EDGE)) == n_wide
    monkeypatch.setattr(coarse_to_fine, "MANY_CELLS", n_cells)
    monkeypatch.setattr(coarse_to_fine, "MOST_LARGE_CELLS", n_cells - 1)
    with pytest.raises(SearchSpaceError, match=r"cells of 0\.48 m and 2 degrees"):
        best_candidates(search, *nowhere, HERE, space, 0.8)
