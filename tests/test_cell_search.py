# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which search a space is given, and what is told of the runner-up."""

import math

import numpy as np
import pytest

from maxcon import Accumulator, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Trust
from maxcon.search.coarse_to_fine import BestCell

CELL = 0.06
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)


@pytest.fixture
def corner():
    """A scan of two walls at right angles, and the map of them."""
    at = np.arange(-4.0, 4.0, 0.05)
    points = np.concatenate(
        [np.column_stack([at, 0 * at + 4.03, 0 * at]), np.column_stack([0 * at + 4.03, at, 0 * at])]
    )
    normals = np.repeat([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]], len(at), axis=0)
    return Scan(points, normals), PointMap.from_points(points, normals, CELL)


def refuse(*_, **__):
    raise AssertionError("another search was asked for")


def test_the_search_that_is_asked_for_is_made(corner, monkeypatch):
    bounded, exhaustive = (
        MaximumConsensus(SPACE, search=name).cell_search for name in ("branch-and-bound", "exhaustive")
    )
    with monkeypatch.context() as patched:
        patched.setattr("maxcon.cell_search.branch_and_bound", refuse)
        wanted = exhaustive.best(*corner, HERE, SPACE)
    monkeypatch.setattr("maxcon.cell_search.exhaustive", refuse)
    assert bounded.best(*corner, HERE, SPACE).score == wanted.score > 1.0


def test_only_open_spaces_of_more_than_a_few_cells_are_searched_coarse_to_fine_and_only_with_bounds(
    corner, monkeypatch
):
    _, point_map = corner
    bounded, exhaustive = (MaximumConsensus(search=name).cell_search for name in ("branch-and-bound", "exhaustive"))
    is_open = SearchSpace(1.0, heading_half_width_deg=2.0)
    n_cells = is_open.n_cells_at(CELL)
    for few, is_few in ((n_cells - 1, False), (n_cells, True), (n_cells + 1, True)):
        monkeypatch.setattr("maxcon.cell_search.FEW_CELLS", few)
        assert bounded.is_coarse_to_fine(is_open, point_map) is not is_few
        assert not exhaustive.is_coarse_to_fine(is_open, point_map)
        assert not bounded.is_coarse_to_fine(is_open.at(CELL), point_map)


def test_of_several_places_the_best_is_the_answer(corner, monkeypatch):
    moments = np.array([300.0, 150.0, 0.0, 150.0])
    one_cell = SearchSpace(0.0, CELL, 0.0, 0.5)
    places = [
        BestCell(one_cell, HERE.translated([x, 0.0, 0.0]), (0, 0, 0), 9.0 - x, moments, 0.1, False)
        for x in (0.0, 1.0, 2.0)
    ]
    monkeypatch.setattr("maxcon.cell_search.best_candidates", lambda *_: places)
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
