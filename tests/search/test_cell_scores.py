# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single cells have, to the last bit, the moments that the exhaustive search gives them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maxcon import Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.search import Multiplicity, Weighting, exhaustive
from maxcon.search.cell_scores import Candidates, CellScores
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.window import Window

CELL = 0.1
TILE = 512 * CELL
SPACE = SearchSpace(1.5, CELL, 2.0, 1.0)


def scene(seed, corner, n_points, is_signed, multiplicity, weighting):
    """A cloud about a point, given in tiles, of which it may be a corner: moments, and scores of cells of its scan."""
    rng = np.random.default_rng(seed)
    middle = np.array([*corner, 0.0]) * TILE
    spread = rng.choice([2.0, 12.0, 40.0])
    points = middle + rng.uniform(-1.0, 1.0, (6000, 3)) * [spread, spread, rng.choice([0.2, 8.0])]
    normals = rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[rng.random(len(normals)) < 0.2] = 0.0
    kept = (points[:, 0] < middle[0]) | (rng.random() < 0.7)  # or a map that ends in the middle
    point_map = PointMap.from_points(points[kept], normals[kept], CELL, is_signed=is_signed)
    prior = Pose(*(middle[:2] + rng.uniform(-0.5, 0.5, 2)), 0.3, 0.01, -0.02, rng.uniform(-4.0, 4.0))
    seen = rng.permutation(len(points))[:n_points]
    scan = Scan((points[seen] - prior.position) @ prior.rotation, normals[seen] @ prior.rotation)
    options = {"multiplicity": multiplicity, "weighting": weighting}
    moments = exhaustive(scan, point_map, prior, SPACE, **options).moments
    prepared = PreparedScan.prepare(scan, point_map, prior, SPACE, multiplicity, weighting)
    return moments, CellScores(prepared, Helmert(), 0.3)


def some_cells(rng, n):
    cells = rng.integers(0, SPACE.shape, (n, 3))
    cells[:2] = [[0, 0, 0], np.array(SPACE.shape) - 1]
    return cells


CORNERS = st.sampled_from([(0.0, 0.0), (1.0, -1.0), (0.5, 3.0), (-2.5, -0.5), (-30000.0, 20000.0)])


@given(
    seed=st.integers(0, 2**32),
    corner=CORNERS,
    n_points=st.sampled_from([1, 50, 3000]),
    is_signed=st.booleans(),
    multiplicity=st.sampled_from(list(Multiplicity)),
    weighting=st.sampled_from(list(Weighting)),
)
@settings(max_examples=80)
def test_moments_are_those_of_the_exhaustive_search(
    seed, corner, n_points, is_signed, multiplicity, weighting
):
    wanted, scores = scene(seed, corner, n_points, is_signed, multiplicity, weighting)
    cells = some_cells(np.random.default_rng(seed), 30)
    for heading in range(SPACE.shape[0]):
        mine = cells[cells[:, 0] == heading]
        if not len(mine):
            continue
        assert (scores.moments(heading, mine) == wanted[tuple(mine.T)]).all()


def test_the_moments_of_these_scenes_are_not_all_zero():
    wanted, _ = scene(1, (0.0, 0.0), 3000, True, Multiplicity.OCCUPIED, Weighting.COSINE)
    assert (np.count_nonzero(wanted, axis=(0, 1, 2)) > SPACE.n_cells // 4).all()


@pytest.mark.parametrize("seed", range(3))
def test_scores_and_the_best_cell(seed):
    wanted, scores = scene(seed, (0.0, 0.0), 3000, True, Multiplicity.OCCUPIED, Weighting.COSINE)
    wanted = Helmert().score(wanted)
    cells = some_cells(np.random.default_rng(seed), 40)
    for part in (cells[:10], cells[5:25], cells[25:], cells[:0]):  # some twice
        scores.score(part)
    assert {cell: score for cell, (score, _) in scores.scored.items()} == {
        tuple(cell): wanted[tuple(cell)] for cell in cells.tolist()
    }
    assert (scores.best, scores.cell) == max(
        ((wanted[tuple(cell)], tuple(cell)) for cell in cells.tolist()),
        key=lambda each: (each[0], [-index for index in each[1]]),
    )


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_a_window_is_scored_at_once(seed, n_threads):
    moments, scores = scene(seed, (0.0, 0.0), 3000, True, Multiplicity.OCCUPIED, Weighting.COSINE)
    wanted = Helmert().score(moments)
    headings, window = np.array([0, 2, 3]), Window.around(np.array([[0, 3, 10], [0, 9, 25]]), SPACE)
    grid = scores.score_window(headings, window, n_threads)
    assert (grid.numbers == wanted[headings, 3:10, 10:26]).all()
    (cell,) = map(tuple, grid.first_highest().tolist())
    assert (scores.best, scores.cell, scores.n_in_windows) == (wanted[cell], cell, 3 * 7 * 16)
    assert (scores.scored[cell][1] == moments[cell]).all()
    scores.kept = Candidates(*((cells := grid.highest(9)), grid.at(cells)))
    far = cells[scores.is_beyond(cells)]
    assert scores.runner_up() == max([*wanted[tuple(far.T)], 0.0])
