"""Branch and bound finds the cell of the exhaustive search, to the last bit, and what it proves is true (D7)."""

import math
import sys
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, OwnObjective

from maxcon import Count, Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError, OptionError, SearchSpaceError
from maxcon.search import Multiplicity, Weighting, branch_and_bound, exhaustive
from maxcon.search.bounds import N_AXES, ByAxes, ByCount, Summand, bounding_of, nearest_axis
from maxcon.search.objectives import OBJECTIVES
from maxcon.search.prepared_scan import PreparedScan

CELL = 0.1
MODULE = sys.modules["maxcon.search.branch_and_bound"]


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


def assert_it_is_the_best(found, accumulator, objective, space, ratio, guard_radius=0.3, guarded=None):
    __tracebackhide__ = True
    scores = accumulator.score(objective)
    best = accumulator.best_cell(objective)
    assert found.cell == best and found.score == scores[best] == found.bound
    assert (found.moments == accumulator.moments[best]).all()
    _, ny, nx = space.shape
    guarded = guarded or best
    distance = np.hypot(np.arange(ny)[:, None] - guarded[1], np.arange(nx)[None, :] - guarded[2]) * space.cell
    second_best = scores.max(axis=0).max(where=distance > guard_radius, initial=0.0)
    assert found.second_best >= second_best
    if second_best >= ratio * scores[guarded]:
        assert found.second_best == second_best
    else:
        assert found.second_best < ratio * scores[guarded] or found.second_best == second_best == 0.0


SPACE = SearchSpace(0.8, CELL, 1.0, 0.5)
HERE = *street(3, SPACE), SPACE
LIMITS = {
    "FIRST_CELLS": [1, 2, 30], "SCORED_AT_ONCE": [1, 8], "MOST_LEFT_OPEN": [0, 3, 192],
    "CELLS_PER_SINGLE": [1, 120, 10**9], "HEADINGS_PER_PASS": [1, 2, 16], "CELLS_PER_PASS": [1, 100, 2**22],
    "PASS_CELLS": [1, 100, 2**20],
}  # fmt: skip


@given(
    seed=SEEDS, objective=st.sampled_from([*OBJECTIVES, OwnObjective()]), options=OPTIONS, is_signed=st.booleans(),
    n_steps=st.sampled_from([0, 1, 3, 10, 24]),
    turns=st.sampled_from([(0.0, 0.5), (1.0, 0.5), (2.0, 0.5), (20.0, 4.0)]),
    ratio=st.sampled_from([1.0, 0.8, 0.3, 1e-6]), guard_radius=st.sampled_from([0.0, 0.3, 1.0]),
    is_guarded=st.booleans(), n_points=st.sampled_from([30, 400]), n_threads=st.sampled_from([1, 2]),
    factor=st.sampled_from([1, 1, 2, 8]),
    limits=st.just({}) | st.fixed_dictionaries({name: st.sampled_from(values) for name, values in LIMITS.items()}),
)  # fmt: skip
def test_it_finds_what_the_exhaustive_search_finds(
    seed, objective, options, is_signed, n_steps, turns, ratio, guard_radius, is_guarded, n_points, n_threads, factor,
    limits,
):  # fmt: skip
    space = SearchSpace(n_steps * CELL * factor, CELL * factor, *turns)
    scan, point_map, prior = street(seed, space, is_signed=is_signed, n_points=n_points)
    scene = scan, point_map.level(factor), prior, space
    guarded = tuple(np.random.default_rng(seed).integers(space.shape).tolist()) if is_guarded else None
    asked = {"ratio": ratio, "guard_radius": guard_radius, "guarded": guarded}
    with mock.patch.dict(MODULE.__dict__, limits):
        found = branch_and_bound(*scene, objective, **options, **asked, n_threads=n_threads)
    assert_it_is_the_best(found, exhaustive(*scene, **options), objective, space, ratio, guard_radius, guarded)
    event(f"all cells scored: {found.n_scored >= space.n_cells}")


@given(
    seed=SEEDS, azimuth=st.floats(-np.pi, np.pi), options=OPTIONS, is_signed=st.booleans(),
    n_steps=st.sampled_from([0, 1, 2, 7, 16]),
    summand=st.just(Summand()) | st.builds(Summand, st.integers(0, N_AXES - 1), st.sampled_from([0.0, 0.01, 0.2])),
    n_threads=st.sampled_from([1, 2]),
)  # fmt: skip
def test_no_cell_has_more_than_its_bound(seed, azimuth, options, is_signed, n_steps, summand, n_threads):
    space = SearchSpace(n_steps * CELL, CELL, 1.0, 0.5)
    scan, point_map, prior = street(seed, space, is_signed=is_signed, azimuth=azimuth)
    prepared = PreparedScan.prepare(scan, point_map, prior, space, **options)
    bounding = bounding_of(Count() if summand.axis is None else Helmert(), prepared)
    if not bounding.prepared.n_points:  # nothing adds to N: the search does not ask
        assert options["weighting"] is Weighting.PUBLISHED
        return
    rng = np.random.default_rng(seed)
    headings = np.flatnonzero(rng.random(space.shape[0]) < 0.7)
    headings = headings if len(headings) else np.array([1])
    sums = bounding.sum_up(headings, summand, n_threads)
    cells = np.argwhere(np.ones(space.shape, bool))
    cells = cells[np.isin(cells[:, 0], headings)]
    upper = sums.at(cells)
    moments = exhaustive(scan, point_map, prior, space, **options).moments[tuple(cells.T)]
    if summand.axis is None:
        along = moments[:, 0]
    else:
        azimuth = summand.axis * np.pi / N_AXES
        c, s = np.cos(azimuth), np.sin(azimuth)
        along = moments @ [0.0, c * c, 2.0 * c * s, s * s]
    assert (upper >= along).all()
    if summand.least == 0.0:  # and not much less: rounding
        assert (upper <= along + 1e-3 * bounding.most * bounding.fullest + 1e-6).all()
    assert (along <= bounding.most).all()
    for least in (-1.0, *(np.sort(upper)[[0, len(upper) // 2, -1]] - 0.25 * sums.unit), upper.max() + 1.0):
        reaching, highest = sums.reaching(least)
        assert (reaching == cells[upper >= least]).all()
        assert highest == upper[upper < least].max(initial=0.0)
    for n_cells in (1, 7, len(cells), len(cells) + 1):
        assert (np.sort(sums.at(sums.highest(n_cells))) == np.sort(upper)[-n_cells:]).all()


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
        here = bounding.sum_up(np.array([0]), summand).at(np.array([[0, 2, 2]]))[0]
        count, along, *_ = prepared.moments_of_cells(0, np.array([[0, 2, 2]]))[0]
        assert count == 60 * times
        if summand.axis is None:
            weights, added = 60.0, count
        else:
            weights, added = (60 - n_bare) * max(1.0, length) + 0.5 * n_bare, along
        assert added <= here <= added * (1.0 + 1e-3) and added <= bounding.most
        assert bounding.most == pytest.approx(times * weights, rel=5e-6)


def test_sums_are_along_the_axis_determined_least():
    normals = np.tile([[0.6], [0.0], [0.8]], 50)
    for azimuth in np.linspace(-3.0, 3.0, 17):
        weak, strong = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
        (xx, xy), (_, yy) = 4.0 * np.outer(weak, weak) + 40.0 * np.outer(strong, strong)
        prepared = SimpleNamespace(
            normals=normals, without_normal=0.5, spread=np.array([xx, xy, yy]), prior=Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.7)
        )
        bounding = ByAxes(prepared, Helmert())
        of_scan, of_cell = bounding.summand(None, 0.0), bounding.summand(np.array([50.0, xx, xy, yy]), 2.5)
        assert (of_scan.axis, of_cell.axis) == (nearest_axis(azimuth + 0.7), nearest_axis(azimuth))
        assert (of_scan.least, of_cell.least) == (pytest.approx(0.01 * 4.0 / 50), pytest.approx(0.1 * 2.5 / 50))


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
    found = branch_and_bound(*arguments, objective, ratio=0.5)
    assert_it_is_the_best(found, exhaustive(*arguments), objective, space, 0.5)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_where_nothing_matches_the_first_cell_is_found(objective):
    far = Scan([[500.0, 500.0, 500.0], [-500.0, 20.0, 3.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for nothing in (far, Scan(np.empty((0, 3)), np.empty((0, 3)))):
        found = branch_and_bound(nothing, *HERE[1:], objective, ratio=0.5)
        assert (found.cell, found.score, found.second_best) == ((0, 0, 0), 0.0, 0.0)
        assert not found.moments.any()


def test_an_objective_without_bounds_is_searched_exhaustively_in_a_space_small_enough(monkeypatch):
    monkeypatch.setattr("maxcon.search.accumulator.MOST_CELLS", SPACE.n_cells)
    assert branch_and_bound(*HERE, OwnObjective()).score > 0.0
    monkeypatch.setattr("maxcon.search.accumulator.MOST_CELLS", SPACE.n_cells - 1)
    with pytest.raises(SearchSpaceError, match="at most 1,279 cells in an exhaustive search, got 1,280"):
        branch_and_bound(*HERE, OwnObjective())
    assert branch_and_bound(*HERE, Helmert()).score > 0.0


@pytest.mark.parametrize("bound", [{}, {"bound_by_count": lambda count: count}])
def test_scores_that_promise_nothing_are_refused(bound):
    objective = OwnObjective(lambda moments: moments[..., 0] * np.nan)
    vars(objective).update(bound)
    with pytest.raises(ArrayError, match=r"scores of searches\.OwnObjective that are numbers, got NaN\."):
        branch_and_bound(*HERE, objective)


def test_a_space_in_which_nothing_stands_out_or_that_is_too_large_is_refused(monkeypatch):
    with pytest.raises(SearchSpaceError, match=r"at most 67,108,864 cells at one heading.* got 100,000,000"):
        branch_and_bound(*HERE[:3], SearchSpace(500.0, CELL, 0.0, 0.5), Helmert())
    monkeypatch.setattr(MODULE, "MOST_LEFT_OPEN", 0)
    monkeypatch.setattr(MODULE, "CELLS_PER_SINGLE", 10**9)
    monkeypatch.setattr(MODULE, "MOST_SCORED", SPACE.n_cells)
    assert branch_and_bound(*HERE, Helmert(), ratio=1e-6).score > 0.0
    monkeypatch.setattr(MODULE, "MOST_SCORED", SPACE.n_cells - 1)
    with pytest.raises(SearchSpaceError, match=r"at most 1,279 cells .* got 1,280: nothing stands out"):
        branch_and_bound(*HERE, Helmert(), ratio=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_very_full_voxels(seed):
    scan, point_map, prior = street(seed, SPACE)
    rng = np.random.default_rng(seed)
    indices, counts, normals = point_map.all_voxels()
    often = np.where(rng.random(len(counts)) < 0.01, rng.integers(1, 3000, len(counts)), 1)
    points = np.repeat((indices + 0.5) * CELL, often, axis=0)
    fuller = PointMap.from_points(points, np.repeat(normals, often, axis=0), CELL)
    prepared = PreparedScan.prepare(scan, fuller, prior, SPACE, Multiplicity.POINTS, Weighting.COSINE)
    assert bounding_of(Helmert(), prepared).unit > 2.0**-14
    for objective in OBJECTIVES:
        found = branch_and_bound(scan, fuller, prior, SPACE, objective, multiplicity="points", ratio=0.7)
        accumulator = exhaustive(scan, fuller, prior, SPACE, multiplicity="points")
        assert_it_is_the_best(found, accumulator, objective, SPACE, 0.7)


@given(
    n_points=st.integers(0, 2**20), fullest=st.integers(1, 2**31), is_once=st.booleans(),
    objective=st.sampled_from(OBJECTIVES),
)  # fmt: skip
def test_sums_fit_in_their_integers_in_units_no_coarser_than_that_asks_for(n_points, fullest, is_once, objective):
    tiles = {0: SimpleNamespace(fullest=1), 3: SimpleNamespace(fullest=fullest)}
    prepared = SimpleNamespace(n_points=n_points, is_once=is_once, tiles=tiles)
    kind = ByCount if isinstance(objective, Count) else ByAxes
    unit = kind(prepared, objective).unit
    # A match adds at most as much as its voxel weighs, a little more for rounding, and what is rounded up to a unit.
    largest, room = (n_points * 3, 2**30) if is_once else (fullest + 2, 2**22)
    assert math.frexp(unit)[0] == 0.5 and largest <= room * unit
    assert unit == 2.0**-14 or largest > room * unit / 2


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
def test_a_scan_of_three_hundred_thousand_points_in_one_voxel(multiplicity):
    walls = np.array([[1.05, 0.05, 0.05], [0.05, 1.05, 0.05]])
    normals = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    point_map = PointMap.from_points(np.repeat(walls, 3, axis=0), np.repeat(normals, 3, axis=0), CELL)
    scan = Scan(np.repeat(walls, 150_000, axis=0), np.repeat(normals, 150_000, axis=0))
    prior, space = Pose(0.2, -0.3, 0.0, 0.0, 0.0, 0.0), SearchSpace(0.8, CELL, 1.0, 1.0)
    for objective in OBJECTIVES:
        found = branch_and_bound(scan, point_map, prior, space, objective, multiplicity=multiplicity, ratio=0.5)
        accumulator = exhaustive(scan, point_map, prior, space, multiplicity=multiplicity)
        assert found.score >= 75_000
        assert_it_is_the_best(found, accumulator, objective, space, 0.5)


@pytest.mark.parametrize("option", [{"ratio": 0.0}, {"ratio": 1.5}, {"guard_radius": -1.0}, {"guard_radius": np.inf}])
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
        assert np.linalg.norm(Summand(axis).vector) == pytest.approx(1.0, abs=1e-6)
