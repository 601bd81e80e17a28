# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Branch and bound finds the cell of the exhaustive search, to the last bit, and what it proves is true (D7)."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, OwnObjective

from maxcon import Count, Helmert, MaxEigenvalue, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError, OptionError, SearchSpaceError
from maxcon.search import Incumbent, Limits, Multiplicity, Weighting, branch_and_bound, exhaustive
from maxcon.search.bounds import N_AXES, ByAxes, ByCount, Summand, bounding_of, nearest_axis
from maxcon.search.branch_and_bound import BoundedSearch
from maxcon.search.objectives import OBJECTIVES
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.scored_cells import ScoredCells
from maxcon.search.space import Window

CELL = 0.1


def street(seed, space, *, n_walls=8, is_signed=True, azimuth=None, n_points=400):
    """Walls along and across a street of any azimuth, in part also scanned, from a pose of the space; and clutter."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-np.pi, np.pi) if azimuth is None else azimuth
    along, across = (np.array([np.cos(azimuth), np.sin(azimuth)]), np.array([-np.sin(azimuth), np.cos(azimuth)]))
    points, normals = [], []
    for number in range(n_walls):
        is_facade = number % 4 != 0
        run, facing = (along, across) if is_facade else (across, along)
        start = rng.uniform(-12.0, 12.0) * along + rng.choice([-5.0, 5.0]) * across
        length = rng.uniform(3.0, 12.0) if is_facade else rng.uniform(0.3, 1.0)
        steps = np.arange(0.0, length, CELL / 2)
        for height in np.arange(0.05, 1.0, 2 * CELL):
            points.append(np.column_stack([start + steps[:, None] * run, np.full(len(steps), height)]))
            side = -np.sign(facing @ start) or 1.0
            noisy = np.array([*(side * facing), 0.0]) + rng.normal(0.0, 0.05, (len(steps), 3))
            normals.append(noisy / np.linalg.norm(noisy, axis=1, keepdims=True))
    points, normals = np.concatenate(points), np.concatenate(normals)
    normals[rng.random(len(normals)) < 0.05] = 0.0
    point_map = PointMap.from_points(points, normals, CELL, is_signed=is_signed)
    prior = Pose(*rng.uniform(-0.5, 0.5, 2), 0.5, *rng.uniform(-0.02, 0.02, 2), rng.uniform(-4.0, 4.0))
    truth = space.pose(tuple(int(rng.integers(n)) for n in space.shape), prior)
    seen = rng.permutation(len(points))[:n_points]
    normals *= rng.uniform(0.996, 1.004, (len(normals), 1))  # as long as is allowed
    wrong = rng.random(len(seen)) < 0.3
    at = points[seen] + np.where(wrong[:, None], rng.uniform(-2.0, 2.0, (len(seen), 3)) * [1, 1, 0], 0.0)
    normals_scan = normals[seen] @ truth.rotation
    normals_scan[rng.random(len(seen)) < rng.choice([0.0, 0.7, 1.0], p=[0.4, 0.5, 0.1])] = 0.0
    return Scan((at - truth.position) @ truth.rotation, normals_scan), point_map, prior


def assert_it_is_the_best(found, accumulator, objective, space, share, guard_radius, guarded=None):
    __tracebackhide__ = True
    scores = accumulator.score(objective)
    best = accumulator.best_cell(objective)
    assert found.cell == best
    assert found.score == scores[best] == found.bound
    assert (found.moments == accumulator.moments[best]).all()
    _, ny, nx = space.shape
    guarded = guarded or best
    distance = np.hypot(np.arange(ny)[:, None] - guarded[1], np.arange(nx)[None, :] - guarded[2]) * space.cell
    runner_up = scores.max(axis=0).max(where=distance > guard_radius, initial=0.0)
    assert found.rest >= runner_up
    if runner_up >= share * scores[guarded]:
        assert found.rest == runner_up
    else:
        assert found.rest < share * scores[guarded] or found.rest == runner_up == 0.0


def assert_all_are_listed(found, scores, share, guarded=None):
    __tracebackhide__ = True
    asked = share * scores[guarded or found.cell]
    if asked > 0.0:
        assert {*map(tuple, found.reaching.cells.tolist())} == {*map(tuple, np.argwhere(scores >= asked).tolist())}
        assert (found.reaching.upper == scores[tuple(found.reaching.cells.T)]).all()


def some_cell(seed, space):
    rng = np.random.default_rng(seed)
    return tuple(int(rng.integers(n)) for n in space.shape)


SPACE = SearchSpace(0.8, CELL, 1.0, 0.5)
HERE = *street(3, SPACE), SPACE


@given(
    seed=SEEDS,
    objective=st.sampled_from([*OBJECTIVES, OwnObjective()]),
    options=OPTIONS,
    is_signed=st.booleans(),
    n_steps=st.sampled_from([0, 1, 3, 10, 24]),
    turns=st.sampled_from([(0.0, 0.5), (1.0, 0.5), (2.0, 0.5), (20.0, 4.0)]),
    share=st.sampled_from([1.0, 0.8, 0.3]),
    guard_radius=st.sampled_from([0.0, 0.3, 1.0]),
    is_guarded=st.booleans(),
    lists_all=st.booleans(),
    n_threads=st.sampled_from([1, 2]),
    factor=st.sampled_from([1, 1, 2, 8]),
)
def test_it_finds_what_the_exhaustive_search_finds(
    seed, objective, options, is_signed, n_steps, turns, share, guard_radius, is_guarded, lists_all, n_threads, factor
):
    space = SearchSpace(n_steps * CELL * factor, CELL * factor, *turns)
    scan, point_map, prior = street(seed, space, is_signed=is_signed)
    scene = scan, point_map.level(factor), prior, space
    guarded = some_cell(seed, space) if is_guarded else None
    asked = {"share": share, "guard_radius": guard_radius, "guarded": guarded}
    found = branch_and_bound(*scene, objective, **options, **asked, lists_all=lists_all, n_threads=n_threads)
    accumulator = exhaustive(*scene, **options)
    assert_it_is_the_best(found, accumulator, objective, space, share, guard_radius, guarded)
    if lists_all:
        assert_all_are_listed(found, accumulator.score(objective), share, guarded)
    else:
        assert len(found.reaching) == 0
    event(f"all cells scored: {found.n_scored >= space.n_cells}")


@given(
    seed=SEEDS,
    objective=st.sampled_from([*OBJECTIVES, OwnObjective()]),
    n_steps=st.sampled_from([1, 5, 10]),
    share=st.sampled_from([1.0, 0.8, 0.1]),
    is_guarded=st.booleans(),
    n_points=st.sampled_from([30, 400]),
    limits=st.builds(
        Limits,
        first_cells=st.sampled_from([1, 2, 30]),
        scored_at_once=st.sampled_from([1, 8]),
        left_out=st.sampled_from([0.0, 0.1, 0.9]),
        left_out_of_scan=st.sampled_from([0.0, 0.01, 0.5]),
        most_candidates=st.sampled_from([0, 3, 192]),
        most_kept=st.sampled_from([0, 30, 2**14]),
        undecided=st.sampled_from([1, 20]),
        cells_per_candidate=st.sampled_from([1, 120, 10**9]),
        margin=st.sampled_from([0, 24]),
        bound_steps=st.sampled_from([2, 100, 4096]),
        headings_per_pass=st.sampled_from([1, 2, 16]),
        cells_per_pass=st.sampled_from([1, 100, 2**22]),
        scored_per_pass=st.sampled_from([1, 100, 2**20]),
    ),
)
def test_limits_of_time_and_memory_change_no_answer(seed, objective, n_steps, share, is_guarded, n_points, limits):
    space = SearchSpace(n_steps * CELL, CELL, 2.0, 0.5)
    scene = *street(seed, space, n_points=n_points), space
    guarded = some_cell(seed, space) if is_guarded else None
    found = branch_and_bound(*scene, objective, share=share, guarded=guarded, lists_all=True, limits=limits)
    accumulator = exhaustive(*scene)
    assert_it_is_the_best(found, accumulator, objective, space, share, 0.3, guarded)
    assert_all_are_listed(found, accumulator.score(objective), share, guarded)


@given(
    seed=SEEDS,
    objective=st.sampled_from([Count(), Helmert(), MaxEigenvalue()]),
    n_steps=st.sampled_from([3, 10]),
    worth=st.sampled_from([0.3, 0.99, 1.0, 1.01, 5.0]),
)
def test_where_something_stands_only_what_scores_as_much_is_found(seed, objective, n_steps, worth):
    space = SearchSpace(n_steps * CELL, CELL, 1.0, 0.5)
    scan, point_map, prior = street(seed, space)
    best = branch_and_bound(scan, point_map, prior, space, objective)
    incumbent = Incumbent(worth * best.score, best.moments)
    found = branch_and_bound(scan, point_map, prior, space, objective, incumbent=incumbent)
    if worth <= 1.0:
        assert (found.cell, found.score) == (best.cell, best.score)
    elif best.score > 0.0:
        assert found.score < incumbent.score


@given(
    seed=SEEDS,
    azimuth=st.floats(-np.pi, np.pi),
    options=OPTIONS,
    is_signed=st.booleans(),
    n_steps=st.sampled_from([0, 1, 2, 7, 16]),
    summand=st.just(Summand()) | st.builds(Summand, st.integers(0, N_AXES - 1), st.sampled_from([0.0, 0.01, 0.2])),
    n_threads=st.sampled_from([1, 2]),
)
def test_no_cell_has_more_than_its_bound(seed, azimuth, options, is_signed, n_steps, summand, n_threads):
    space = SearchSpace(n_steps * CELL, CELL, 1.0, 0.5)
    scan, point_map, prior = street(seed, space, is_signed=is_signed, azimuth=azimuth)
    prepared = PreparedScan.prepare(scan, point_map, prior, space, **options)
    bounding = bounding_of(Count() if summand.axis is None else Helmert(), prepared)
    if not bounding.prepared.n_points:  # nothing adds to N: the search does not ask
        assert options["weighting"] is Weighting.PUBLISHED
        return
    sums = bounding.sum_up(np.arange(space.shape[0]), Window.of(space), summand, n_threads)
    cells = np.argwhere(np.ones(space.shape, bool))
    upper = sums.at(cells).reshape(space.shape)
    moments = exhaustive(scan, point_map, prior, space, **options).moments
    if summand.axis is None:
        along = moments[..., 0]
    else:
        azimuth = summand.axis * np.pi / N_AXES
        c, s = np.cos(azimuth), np.sin(azimuth)
        along = moments @ [0.0, c * c, 2.0 * c * s, s * s]
    assert (upper >= along).all()
    if summand.least == 0.0:  # and not much less: rounding
        assert (upper <= along + 1e-3 * bounding.most * bounding.fullest + 1e-6).all()
    assert (along <= bounding.most).all()

    rng = np.random.default_rng(seed)  # a window has the bounds of the whole, up to the units that rounding adds
    cells = np.unique(cells[rng.integers(0, len(cells), 3)], axis=0)
    window = Window.around(cells, space)
    part = bounding.sum_up(np.unique(cells[:, 0]), window, summand, n_threads)
    assert (part.at(cells) >= along[tuple(cells.T)]).all()
    assert np.allclose(part.at(cells), upper[tuple(cells.T)], rtol=0.0, atol=1e-3 * bounding.most)
    (y, x), (ny, nx) = window.first_cell(space), window.shape
    in_window, highest = part.reaching(-1.0)
    assert highest == 0.0
    assert {*in_window[:, 1]} == {*range(y, y + ny)}
    assert {*in_window[:, 2]} == {*range(x, x + nx)}


@pytest.mark.parametrize("summand", [Summand(5), Summand()])
def test_sums_that_reach_something_and_the_highest(summand):
    prepared = PreparedScan.prepare(*HERE, Multiplicity.OCCUPIED, Weighting.COSINE)
    headings = np.array([1, 3, 4])
    bounding = bounding_of(Count() if summand.axis is None else Helmert(), prepared)
    along = bounding.sum_up(headings, Window.of(SPACE), summand)
    _, ny, nx = SPACE.shape
    all_cells = np.array([(h, y, x) for h in headings for y in range(ny) for x in range(nx)])
    sums = along.at(all_cells)
    for least in (-1.0, *np.quantile(sums, [0.2, 0.9, 1.0]), sums.max() + 1.0):
        cells, highest = along.reaching(least)
        assert (cells == all_cells[sums >= least]).all()
        assert highest == sums[sums < least].max(initial=0.0)
        assert along.count_reaching(least) == len(cells)
    for n_cells in (1, 7, len(sums), len(sums) + 1):
        got = np.sort(along.at(along.units.highest(n_cells)))
        assert (got == np.sort(sums)[-n_cells:]).all()


@pytest.mark.parametrize("multiplicity", list(Multiplicity))
@pytest.mark.parametrize("length", [0.996, 1.0, 1.004])
@pytest.mark.parametrize("n_bare", [0, 7])
def test_where_every_point_matches_squarely_a_cell_has_all_that_is_thought_possible(multiplicity, length, n_bare):
    rng = np.random.default_rng(0)
    voxels = np.column_stack([np.zeros(60), rng.permutation(60), np.arange(60) % 3])
    points = (np.repeat(voxels, 3, axis=0) + rng.uniform(0.2, 0.8, (180, 3))) * CELL
    point_map = PointMap.from_points(points, np.tile([-1.0, 0.0, 0.0], (180, 1)), CELL)
    normals = np.repeat([[-length, 0.0, 0.0], [0.0, 0.0, 0.0]], [60 - n_bare, n_bare], axis=0)
    scan, prior = Scan((voxels + 0.5) * CELL, normals), Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    prepared = PreparedScan.prepare(
        scan, point_map, prior, SearchSpace(0.2, CELL, 0.0, 0.5), multiplicity, Weighting.COSINE
    )
    times = 1 if multiplicity is Multiplicity.OCCUPIED else 3
    for objective, summand in ((Count(), Summand()), (Helmert(), Summand(0))):
        bounding = bounding_of(objective, prepared)
        here = bounding.sum_up(np.array([0]), Window(0, 0, 0, 0), summand).at(np.array([[0, 2, 2]]))[0]
        count, along, *_ = prepared.moments_of_cells(0, np.array([[0, 2, 2]]))[0]
        assert count == 60 * times
        if summand.axis is None:
            weights, added = 60.0, count
        else:
            weights, added = (60 - n_bare) * max(1.0, length) + 0.5 * n_bare, along
        assert added <= here <= added * (1.0 + 1e-3)
        assert added <= bounding.most
        assert bounding.most == pytest.approx(times * weights, rel=5e-6)


def test_the_first_sum_is_along_the_axis_determined_least_and_the_second_across():
    limits = Limits(left_out=0.2, left_out_of_scan=0.03)
    normals = np.tile([[0.6], [0.0], [0.8]], 50)
    for azimuth in np.linspace(-3.0, 3.0, 17):
        weak, strong = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
        (xx, xy), (_, yy) = 4.0 * np.outer(weak, weak) + 40.0 * np.outer(strong, strong)
        prepared = SimpleNamespace(
            normals=normals, without_normal=0.5, spread=np.array([xx, xy, yy]), prior=Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.7)
        )
        bounding = ByAxes(prepared, Helmert())
        for leader in (None, Incumbent(0.0, np.zeros(4))):  # no cell determines anything yet: the scan decides
            summand = BoundedSearch(bounding, SimpleNamespace(leader=leader, asked=0.0), limits, 1)._summand()
            assert summand.axis == nearest_axis(azimuth + 0.7)
            assert summand.least == pytest.approx(0.03 * 4.0 / 50)
        leader = Incumbent(3.6, np.array([50.0, xx, xy, yy]))
        summand = BoundedSearch(bounding, SimpleNamespace(leader=leader, asked=2.5), limits, 1)._summand()
        assert summand.axis == nearest_axis(azimuth)
        assert summand.least == pytest.approx(0.2 * 2.5 / 50)
        assert bounding.across(summand) == Summand(nearest_axis(azimuth + 0.5 * np.pi), summand.least)


@given(
    seed=SEEDS,
    objective=st.sampled_from([Helmert(), MaxEigenvalue()]),
    first=st.integers(0, N_AXES - 1),
    weak=st.floats(-np.pi, np.pi),
    share=st.sampled_from([0.05, 0.5, 1.0]),
)
def test_second_bounds_hold_along_whatever_axis_the_first_were(seed, objective, first, weak, share):
    """The incumbent may be of another place: it may leave open what no cell of this one does."""
    space = SearchSpace(0.6, CELL, 1.0, 0.5)
    scan, point_map, prior = street(seed, space)
    scores = exhaustive(scan, point_map, prior, space).score(objective)
    if not scores.any():
        return
    cosine, sine = np.cos(weak), np.sin(weak)
    moments = np.array([200.0, cosine**2 + 50.0 * sine**2, -49.0 * cosine * sine, sine**2 + 50.0 * cosine**2])
    prepared = PreparedScan.prepare(scan, point_map, prior, space, Multiplicity.OCCUPIED, Weighting.COSINE)
    scored = ScoredCells(prepared, objective, incumbent=Incumbent(share * scores.max(), moments))
    limits = Limits(most_candidates=0, undecided=1)
    search = BoundedSearch(bounding_of(objective, prepared), scored, limits, 1)
    sums = search.bounding.sum_up(np.arange(space.shape[0]), Window.of(space), Summand(first))
    left = search._left_open(sums)
    assert (left.upper >= scores[tuple(left.cells.T)]).all()
    is_left = np.zeros(space.shape, bool)
    is_left[tuple(left.cells.T)] = True
    assert is_left[scores >= scored.asked].all()
    assert search.ruled_out >= scores[~is_left].max(initial=0.0)


def test_few_cells_are_scored_in_a_street():
    space = SearchSpace(3.0, CELL, 2.0, 0.5)
    n_scored = []
    for seed in range(10):
        scan, point_map, prior = street(seed, space, n_walls=30, n_points=3000)
        n_scored.append(branch_and_bound(scan, point_map, prior, space, Helmert()).n_scored)
    assert np.median(n_scored) < 0.002 * space.n_cells


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize(("half_width", "turn_deg"), [(0.6, 0.0), (3.0, 1.0)])
def test_the_first_of_equal_cells_wins(scene, objective, half_width, turn_deg):
    """Along a single wall many cells are alike, and none is determined."""
    scene.wall((-5.0, 4.0), (5.0, 4.0))
    space = SearchSpace(half_width, 0.06, turn_deg, 0.5)
    arguments = scene.scan, scene.point_map, scene.sensor, space
    found = branch_and_bound(*arguments, objective, share=0.5)
    assert_it_is_the_best(found, exhaustive(*arguments), objective, space, 0.5, 0.3)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_where_nothing_matches_the_first_cell_is_found(objective):
    far = Scan([[500.0, 500.0, 500.0], [-500.0, 20.0, 3.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for nothing in (far, Scan(np.empty((0, 3)), np.empty((0, 3)))):
        found = branch_and_bound(nothing, *HERE[1:], objective, share=0.5)
        assert (found.cell, found.score, found.rest) == ((0, 0, 0), 0.0, 0.0)
        assert not found.moments.any()


def test_an_objective_without_bounds_is_searched_exhaustively_in_a_space_small_enough(monkeypatch):
    for limits in (Limits(), Limits(scored_per_pass=100)):  # or less than at one heading
        found = branch_and_bound(*HERE, OwnObjective(), share=0.5, limits=limits)
        assert found.n_scored == SPACE.n_cells
        assert_it_is_the_best(found, exhaustive(*HERE), OwnObjective(), SPACE, 0.5, 0.3)
    monkeypatch.setattr("maxcon.search.accumulator.MOST_CELLS", SPACE.n_cells)
    assert branch_and_bound(*HERE, OwnObjective()).score > 0.0
    monkeypatch.setattr("maxcon.search.accumulator.MOST_CELLS", SPACE.n_cells - 1)
    with pytest.raises(SearchSpaceError, match="at most 1,279 cells in an exhaustive search, got 1,280"):
        branch_and_bound(*HERE, OwnObjective())
    assert branch_and_bound(*HERE, Helmert()).score > 0.0


@pytest.mark.parametrize("is_bounded", [False, True])
@pytest.mark.parametrize(
    ("score", "words"),
    [
        (lambda moments: moments[..., 0] * np.nan, r"scores that are numbers, got NaN\."),
        (lambda moments: moments.sum(), r"scores of shape \(.*\), got \(\)\."),
        (lambda moments: moments[..., 0] - 1e9, r"scores of 0 or more .*, got -1e\+09\. Let the objective return 0"),
    ],
)
def test_scores_that_promise_nothing_are_refused(is_bounded, score, words):
    objective = OwnObjective(score)
    if is_bounded:
        objective.bound_by_count = lambda count: count
    with pytest.raises(ArrayError, match=words):
        branch_and_bound(*HERE, objective)


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("share", [1.0, 0.5, 1e-6])
@pytest.mark.parametrize(("pass_cells", "n_threads", "undecided"), [(2**20, 1, 4), (50, 2, 10**9)])
def test_where_bounds_decide_little_windows_are_searched_exhaustively(
    objective, share, pass_cells, n_threads, undecided
):
    limits = Limits(cells_per_candidate=10**9, most_candidates=0, scored_per_pass=pass_cells, undecided=undecided)
    found = branch_and_bound(*HERE, objective, share=share, n_threads=n_threads, limits=limits)
    assert_it_is_the_best(found, exhaustive(*HERE), objective, SPACE, share, 0.3)


def test_a_large_space_in_which_nothing_stands_out_is_refused_and_exactly_so_many_cells_are_looked_at():
    def search(most_scored):
        limits = Limits(cells_per_candidate=10**9, most_candidates=0, most_scored=most_scored)
        return branch_and_bound(*HERE, Helmert(), share=0.5, limits=limits)

    with pytest.raises(SearchSpaceError, match="at most 10 cells") as refusal:
        search(10)
    asked = int(re.search(r"got ([\d,]+)", str(refusal.value))[1].replace(",", ""))
    assert search(asked).score > 0.0
    with pytest.raises(SearchSpaceError):
        search(asked - 1)


@given(
    n_steps=st.integers(0, 9),
    turn_deg=st.sampled_from([0.0, 1.0, 4.5]),
    headings=st.sampled_from([1, 2, 5, 16]),
    cells=st.sampled_from([1, 7, 40, 100, 650, 2**22]),
)
def test_parts_make_up_the_space_from_those_near_the_prior_on_and_fit_in_memory(n_steps, turn_deg, headings, cells):
    space = SearchSpace(n_steps * CELL, CELL, turn_deg, 0.5)
    bounding = SimpleNamespace(prepared=SimpleNamespace(space=space))
    parts = BoundedSearch(bounding, None, Limits(headings_per_pass=headings, cells_per_pass=cells), 1)._parts()
    times = np.zeros(space.shape, int)
    far = []
    for some, window in parts:
        (y, x), (ny, nx) = window.first_cell(space), window.shape
        times[some, y : y + ny, x : x + nx] += 1
        assert len(some) <= headings
        assert len(some) * ny * nx <= cells or (len(some), ny) == (1, 1)
        turned, rows = round(abs(space.headings[some].mean()), 9), abs(window.y_first + window.y_last)
        far.append((turned, some[0] > space.shape[0] // 2, rows))
    assert (times == 1).all()
    assert far == sorted(far)


@pytest.mark.parametrize("seed", range(2))
def test_very_full_voxels(seed):
    space = SearchSpace(0.8, CELL, 1.0, 0.5)
    scan, point_map, prior = street(seed, space)
    rng = np.random.default_rng(seed)
    indices, counts, normals = point_map.all_voxels()
    often = np.where(rng.random(len(counts)) < 0.01, rng.integers(1, 3000, len(counts)), 1)
    points = np.repeat((indices + 0.5) * CELL, often, axis=0)
    fuller = PointMap.from_points(points, np.repeat(normals, often, axis=0), CELL)
    prepared = PreparedScan.prepare(scan, fuller, prior, space, Multiplicity.POINTS, Weighting.COSINE)
    assert bounding_of(Helmert(), prepared).unit > 2.0**-14
    for objective in OBJECTIVES:
        found = branch_and_bound(scan, fuller, prior, space, objective, multiplicity="points", share=0.7)
        accumulator = exhaustive(scan, fuller, prior, space, multiplicity="points")
        assert_it_is_the_best(found, accumulator, objective, space, 0.7, 0.3)


@given(
    n_points=st.integers(0, 2**20),
    fullest=st.integers(1, 2**31),
    is_once=st.booleans(),
    objective=st.sampled_from(OBJECTIVES),
)
def test_sums_fit_in_their_integers_in_units_no_coarser_than_that_asks_for(n_points, fullest, is_once, objective):
    tiles = {0: (SimpleNamespace(fullest=1), None), 3: (SimpleNamespace(fullest=fullest), None)}
    prepared = SimpleNamespace(n_points=n_points, is_once=is_once, tiles=tiles)
    kind = ByCount if isinstance(objective, Count) else ByAxes
    unit = kind(prepared, objective).unit
    # A match adds at most as much as its voxel weighs, a little more for rounding, and what is rounded up to a unit.
    largest, room = (n_points * 3, 2**30) if is_once else (fullest + 2, 2**22)
    assert math.frexp(unit)[0] == 0.5
    assert largest <= room * unit
    assert unit == 2.0**-14 or largest > room * unit / 2


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
def test_a_scan_of_three_hundred_thousand_points_in_one_voxel(multiplicity):
    walls = np.array([[1.05, 0.05, 0.05], [0.05, 1.05, 0.05]])
    normals = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    point_map = PointMap.from_points(np.repeat(walls, 3, axis=0), np.repeat(normals, 3, axis=0), CELL)
    scan = Scan(np.repeat(walls, 150_000, axis=0), np.repeat(normals, 150_000, axis=0))
    prior, space = Pose(0.2, -0.3, 0.0, 0.0, 0.0, 0.0), SearchSpace(0.8, CELL, 1.0, 1.0)
    for objective in OBJECTIVES:
        found = branch_and_bound(scan, point_map, prior, space, objective, multiplicity=multiplicity, share=0.5)
        accumulator = exhaustive(scan, point_map, prior, space, multiplicity=multiplicity)
        assert found.score >= 75_000
        assert_it_is_the_best(found, accumulator, objective, space, 0.5, 0.3)


@pytest.mark.parametrize("option", [{"share": 0.0}, {"share": 1.5}, {"guard_radius": -1.0}, {"guard_radius": np.inf}])
def test_options_out_of_range_are_refused(option):
    with pytest.raises(OptionError, match=f"Expected `{next(iter(option))}`"):
        branch_and_bound(*HERE, Helmert(), **option)


def test_the_nearest_axis():
    step = math.pi / N_AXES
    assert nearest_axis(0.4 * step) == nearest_axis(math.pi) == nearest_axis(-math.pi) == 0
    assert nearest_axis(-0.6 * step) == 63
    for azimuth in np.linspace(-7.0, 7.0, 100):
        axis = nearest_axis(azimuth)
        off = (azimuth - axis * step + math.pi / 2) % math.pi - math.pi / 2
        assert abs(off) <= step / 2 + 1e-12
        across = Summand((axis + N_AXES // 2) % N_AXES)
        assert np.dot(Summand(axis).vector, across.vector) == pytest.approx(0.0, abs=1e-6)
        assert np.linalg.norm(Summand(axis).vector) == pytest.approx(1.0, abs=1e-6)
