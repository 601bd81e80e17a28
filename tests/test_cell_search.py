"""Which search a space is given, and what is said of a best cell: its ratios, what lies beyond, what casts doubt."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from maxcon import Accumulator, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status, Trust, cell_search
from maxcon.cell_search import BestCell, CellSearch, is_at_boundary
from maxcon.integrity import reasons_to_doubt_answer
from upright_walls import joined, on_grid

CELL = 0.06
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)
PRIOR = Pose(4.0, -3.0, 1.0, 0.0, 0.0, 0.3)
SMALL = SearchSpace(0.3, CELL, 1.0, 0.5)
MIDDLE = (2, 5, 5)
FEW = np.array([4.0, 1.2, 0.0, 2.5])


@pytest.fixture
def corner():
    """A scan of two walls at right angles, and the map of them."""
    ways = ((3.95, 4.03), (-4.05, 4.03)), ((4.03, -4.0), (4.03, 4.0))
    points, normals = joined(*(on_grid(*way, (0.0, 0.05)) for way in ways))
    return Scan(points, normals), PointMap.from_points(points, normals, CELL)


def test_the_search_that_is_asked_for_is_made_and_only_open_spaces_coarse_to_fine(corner, monkeypatch):
    bounded, exhaustive = (MaximumConsensus(search=name).cell_search for name in ("branch-and-bound", "exhaustive"))
    is_open = SearchSpace(1.0, heading_half_width_deg=2.0)
    assert bounded.is_coarse_to_fine(is_open) and not exhaustive.is_coarse_to_fine(is_open)
    assert not bounded.is_coarse_to_fine(is_open.at(CELL))
    bounded, exhaustive = (MaximumConsensus(SPACE, search=by).cell_search for by in ("branch-and-bound", "exhaustive"))
    with monkeypatch.context() as patched:
        patched.setattr("maxcon.cell_search.branch_and_bound", None)
        wanted = exhaustive.best(*corner, HERE, SPACE)
    monkeypatch.setattr("maxcon.cell_search.exhaustive", None)
    assert bounded.best(*corner, HERE, SPACE).score == wanted.score > 1.0


def test_of_several_candidates_the_best_is_the_answer(corner, monkeypatch):
    moments, one_cell = np.array([300.0, 150.0, 0.0, 150.0]), SearchSpace(0.0, CELL, 0.0, 0.5)
    found = [
        BestCell(one_cell, HERE.translated([x, 0.0, 0.0]), (0, 0, 0), 9.0 - x, moments, 0.1, False)
        for x in (0.0, 1.0, 2.0)
    ]
    monkeypatch.setattr(CellSearch, "candidates", lambda *_: found)
    estimate = MaximumConsensus().cell_search.best(*corner, HERE, SearchSpace())
    assert (estimate.score, estimate.pose, estimate.cell) == (9.0, HERE, None)


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_no_runner_up_at_all_may_be_allowed(corner, search):
    method = MaximumConsensus(SPACE, search=search, trust=Trust(largest_runner_up=0.0))
    estimate = method.cell_search.best(*corner, HERE, SPACE)
    assert (estimate.cell, estimate.runner_up) == ((2, 10, 10), 0.0)


@pytest.mark.parametrize(("least", "runner_up"), [(0.4, 0.5), (40.0, 0.5), (0.0, math.inf)])
def test_the_runner_up_is_a_ratio_of_helmert_s_scores_however_low_these_are(corner, least, runner_up):
    scan, point_map = corner
    moments = np.zeros((*SPACE.shape, 4))
    moments[2, 10, 10] = [100.0, least, 0.0, least]
    moments[2, 10, 19] = [50.0, 0.5 * least, 0.0, 0.5 * least]
    estimate = MaximumConsensus(SPACE).cell_search.conclude(Accumulator(moments, SPACE, HERE), scan, point_map)
    assert estimate.runner_up == pytest.approx(runner_up)


# --- the estimate of a best cell ---
def scene(cell, n_matching=4, n_points=16):
    """Points of which the first few lie in voxels of three map points, and the others in none, at a cell."""
    pose = SMALL.pose(cell, PRIOR)
    at = pose.position + np.column_stack([np.arange(n_points) + 1.0, 2.0 * np.arange(n_points), np.zeros(n_points)])
    matching = np.repeat(at[:n_matching], 3, axis=0)
    point_map = PointMap.from_points(matching, np.tile([1.0, 0.0, 0.0], (len(matching), 1)), CELL)
    return Scan((at - pose.position) @ pose.rotation, np.zeros_like(at)), point_map  # weights of a half


class Constant:
    """An objective of one score for all cells, which remembers what it was asked."""

    def __init__(self, score):
        self.of_all, self.shapes = score, []

    def score(self, moments):
        self.shapes.append(moments.shape)
        return np.full(moments.shape[:-1], self.of_all)


def best_cell(cell=MIDDLE, score=1.0, runner_up=0.1, is_at_boundary=None):
    return BestCell(SMALL, PRIOR, cell, score, FEW, runner_up, is_at_boundary)


def judged(best, multiplicity="occupied", objective=None):
    search = CellSearch(objective or Constant(0.0), multiplicity, "cosine", "branch-and-bound", 0.0, 1, Trust())
    return search.estimate(best, *scene(best.cell))


@pytest.mark.parametrize("cell", [MIDDLE, (1, 3, 8)])
def test_the_matched_ratio_is_that_of_the_points_however_often_a_voxel_counts(cell):
    once = best_cell(cell)
    assert judged(once).share == judged(replace(once, moments=3.0 * FEW), "points").share == 4 / 16


def test_what_is_known_of_the_cell_is_passed_on():
    best = best_cell((1, 3, 8), 7.5, 0.25)
    estimate = judged(best)
    assert (estimate.pose, estimate.score, estimate.cell) == (SMALL.pose((1, 3, 8), PRIOR), 7.5, (1, 3, 8))
    assert (estimate.runner_up, estimate.status) == (0.25, Status.LOCALIZED)
    np.testing.assert_allclose(estimate.cofactor, [[1 / 1.2, 0.0], [0.0, 1 / 2.5]])
    assert judged(replace(best, runner_up=0.9)).status is Status.AMBIGUOUS
    (words,) = reasons_to_doubt_answer(FEW)  # few matches in a direction: only where matches are what is counted
    assert words in estimate.reason and words not in judged(best, "points").reason


@pytest.mark.parametrize(("heading", "turn_deg"), [(0, -1.5), (4, 1.5)])
@pytest.mark.parametrize(("beyond", "status"), [(0.9, Status.LOCALIZED), (1.0, Status.LOCALIZED), (1.1, Status.AT_RIM)])
def test_only_a_higher_score_beyond_the_last_heading_is_the_boundary(monkeypatch, heading, turn_deg, beyond, status):
    searched = Mock(wraps=cell_search.exhaustive)
    monkeypatch.setattr(cell_search, "exhaustive", searched)
    objective = Constant(beyond)
    assert judged(best_cell((heading, 5, 5)), objective=objective).status is status
    assert objective.shapes == [(1, 10, 10, 4)]
    ((_, _, prior, _),) = (call.args for call in searched.call_args_list)
    assert prior.heading == pytest.approx(PRIOR.heading + math.radians(turn_deg))
    assert (prior.x, prior.y, prior.z) == (PRIOR.x, PRIOR.y, PRIOR.z)


@pytest.mark.parametrize(("cell", "told", "status"), [
    *(((heading, 5, 5), None, Status.LOCALIZED) for heading in (1, 2, 3)),
    ((2, 0, 5), None, Status.AT_RIM),
    ((2, 5, 9), None, Status.AT_RIM),
    ((2, 0, 5), False, Status.LOCALIZED),
    (MIDDLE, True, Status.AT_RIM),
    ((0, 5, 5), False, Status.LOCALIZED),
])  # fmt: skip
def test_whoever_looked_beyond_tells_the_boundary_and_otherwise_the_cell_does(cell, told, status):
    objective = Constant(5.0)
    assert judged(best_cell(cell, is_at_boundary=told), objective=objective).status is status
    assert objective.shapes == []


@pytest.mark.parametrize(("offset", "turn_deg", "space", "is_beyond"), [
    (11.88, 0.0, SearchSpace(12.0), False), (11.94, 0.0, SearchSpace(12.0), True),
    (-11.94, 0.0, SearchSpace(12.0), False), (-12.0, 0.0, SearchSpace(12.0), True),
    (-12.3, 0.0, SearchSpace(12.0), True), (0.0, 10.24, SearchSpace(12.0), False),
    (0.0, -10.26, SearchSpace(12.0), True), (0.0, 349.76, SearchSpace(12.0), False),
    (0.03, 0.0, SearchSpace(0.0), False), (0.3, 0.0, SearchSpace(0.3), True),
    (-CELL, 0.0, SearchSpace(CELL), False), (CELL, 0.0, SearchSpace(CELL), True),
])  # fmt: skip
def test_the_boundary_is_the_outermost_cell_or_half_a_step_beyond_the_last_heading(offset, turn_deg, space, is_beyond):
    for at in (0.0, 0.1, 50.0, -1234.56):  # rounding decides nothing
        prior = replace(HERE, x=at, y=-at, heading=2.0)
        for x, y in ((offset, 0.0), (0.0, offset)):
            pose = replace(prior.translated([x, y, 0.0]), heading=prior.heading + math.radians(turn_deg))
            assert is_at_boundary(pose, prior, space, CELL) is is_beyond
