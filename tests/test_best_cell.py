# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is said of a best cell: the share that matches there, what is beyond the last heading, and what casts doubt."""

import math
from dataclasses import replace

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan, SearchSpace, Status, Trust, cell_search
from maxcon.cell_search import CellSearch
from maxcon.integrity import reasons_to_doubt_answer
from maxcon.search.coarse_to_fine import BestCell

CELL = 0.1
PRIOR = Pose(4.0, -3.0, 1.0, 0.0, 0.0, 0.3)
SPACE = SearchSpace(0.5, CELL, 1.0, 0.5)
MIDDLE = (2, 5, 5)
FEW = np.array([4.0, 1.2, 0.0, 2.5])


def scene(cell, n_matching=4, n_points=16):
    """Points of which the first few lie in voxels of three map points, and the others in none, at a cell."""
    pose = SPACE.pose(cell, PRIOR)
    at = pose.position + np.column_stack([np.arange(n_points) + 1.0, 2.0 * np.arange(n_points), np.zeros(n_points)])
    normals = np.tile([1.0, 0.0, 0.0], (n_points, 1))
    point_map = PointMap.from_points(
        np.repeat(at[:n_matching], 3, axis=0), np.repeat(normals[:n_matching], 3, axis=0), CELL
    )
    return Scan((at - pose.position) @ pose.rotation, np.zeros_like(at)), point_map  # weights of a half


class Constant:
    """An objective of one score for all cells, which remembers what it was asked."""

    def __init__(self, score):
        self.of_all, self.shapes = score, []

    def score(self, moments):
        self.shapes.append(moments.shape)
        return np.full(moments.shape[:-1], self.of_all)


def judged(best, multiplicity="occupied", objective=None, scan_and_map=None):
    scan, point_map = scan_and_map or scene(best.cell)
    search = CellSearch(objective or Constant(0.0), multiplicity, "cosine", "branch-and-bound", 0.0, 1, Trust())
    return search.estimate(best, scan, point_map)


@pytest.mark.parametrize("cell", [MIDDLE, (1, 3, 8)])
def test_the_share_is_that_of_the_points_that_match_however_often_a_voxel_counts(cell):
    once = BestCell(SPACE, PRIOR, cell, 1.0, FEW, 0.1)
    often = replace(once, moments=3.0 * FEW)
    assert judged(once).share == judged(often, "points").share == 4 / 16


def test_few_matches_in_a_direction_cast_doubt_only_where_matches_are_what_is_counted():
    best = BestCell(SPACE, PRIOR, MIDDLE, 1.0, FEW, 0.1)
    (words,) = reasons_to_doubt_answer(FEW)
    assert words in judged(best).reason
    assert words not in judged(best, "points").reason


def test_what_is_known_of_the_cell_is_passed_on():
    best = BestCell(SPACE, PRIOR, (1, 3, 8), 7.5, FEW, 0.25)
    estimate = judged(best)
    assert (estimate.pose, estimate.score, estimate.cell) == (SPACE.pose((1, 3, 8), PRIOR), 7.5, (1, 3, 8))
    assert (estimate.runner_up, estimate.status) == (0.25, Status.LOCALIZED)
    np.testing.assert_allclose(estimate.cofactor, [[1 / 1.2, 0.0], [0.0, 1 / 2.5]])
    assert judged(replace(best, runner_up=0.9)).status is Status.AMBIGUOUS


@pytest.mark.parametrize(("heading", "turn_deg"), [(0, -1.5), (4, 1.5)])
@pytest.mark.parametrize(("beyond", "status"), [(0.9, Status.LOCALIZED), (1.0, Status.LOCALIZED), (1.1, Status.AT_RIM)])
def test_one_heading_beyond_the_last_is_scored_and_only_a_higher_score_there_is_the_rim(
    monkeypatch, heading, turn_deg, beyond, status
):
    priors = []

    def exhaustive(scan, point_map, prior, space, **options):
        priors.append(prior)
        return real(scan, point_map, prior, space, **options)

    real = cell_search.exhaustive
    monkeypatch.setattr(cell_search, "exhaustive", exhaustive)
    objective = Constant(beyond)
    best = BestCell(SPACE, PRIOR, (heading, 5, 5), 1.0, FEW, 0.1)
    assert judged(best, objective=objective).status is status
    assert objective.shapes == [(1, 10, 10, 4)]
    assert [prior.heading for prior in priors] == pytest.approx([PRIOR.heading + math.radians(turn_deg)])
    assert (priors[0].x, priors[0].y, priors[0].z) == (PRIOR.x, PRIOR.y, PRIOR.z)


@pytest.mark.parametrize("heading", [1, 2, 3])
def test_beyond_headings_in_the_middle_nothing_is_scored(heading):
    objective = Constant(5.0)
    assert (
        judged(BestCell(SPACE, PRIOR, (heading, 5, 5), 1.0, FEW, 0.1), objective=objective).status is Status.LOCALIZED
    )
    assert objective.shapes == []


@pytest.mark.parametrize(
    ("cell", "told", "status"),
    [
        ((2, 0, 5), None, Status.AT_RIM),
        ((2, 5, 9), None, Status.AT_RIM),
        ((2, 0, 5), False, Status.LOCALIZED),
        (MIDDLE, True, Status.AT_RIM),
        ((0, 5, 5), False, Status.LOCALIZED),
    ],
)
def test_whoever_looked_beyond_tells_the_rim_and_otherwise_the_cell_does(cell, told, status):
    objective = Constant(5.0)
    assert judged(BestCell(SPACE, PRIOR, cell, 1.0, FEW, 0.1, told), objective=objective).status is status
    assert objective.shapes == []
