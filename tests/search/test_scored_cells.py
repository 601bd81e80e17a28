# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Single cells have, to the last bit, the moments of the exhaustive search; what is kept of their scores."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, unit_vectors

from maxcon import Count, Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.search import Found, Incumbent, Multiplicity, Weighting, branch_and_bound, exhaustive
from maxcon.search.prepared_scan import PreparedScan
from maxcon.search.scored_cells import ScoredCells
from maxcon.search.space import Window

CELL, ONCE = 0.1, Multiplicity.OCCUPIED
TILE = 512 * CELL
SPACE = SearchSpace(1.5, CELL, 2.0, 1.0)


def scene(seed, corner=(0.0, 0.0), n_points=3000, is_signed=True, *, multiplicity=ONCE, weighting=Weighting.COSINE):
    """A cloud about a point, given in tiles, of which it may be a corner: moments of all cells, and its scan."""
    rng = np.random.default_rng(seed)
    middle = np.array([*corner, 0.0]) * TILE
    spread = rng.choice([2.0, 12.0, 40.0])
    points = middle + rng.uniform(-1.0, 1.0, (6000, 3)) * [spread, spread, rng.choice([0.2, 8.0])]
    normals = unit_vectors(rng, len(points), 0.2)
    kept = (points[:, 0] < middle[0]) | (rng.random() < 0.7)  # or a map that ends in the middle
    point_map = PointMap.from_points(points[kept], normals[kept], CELL, is_signed=is_signed)
    prior = Pose(*(middle[:2] + rng.uniform(-0.5, 0.5, 2)), 0.3, 0.01, -0.02, rng.uniform(-4.0, 4.0))
    seen = rng.permutation(len(points))[:n_points]
    scan = Scan((points[seen] - prior.position) @ prior.rotation, normals[seen] @ prior.rotation)
    options = {"multiplicity": multiplicity, "weighting": weighting}
    moments = exhaustive(scan, point_map, prior, SPACE, **options).moments
    prepared = PreparedScan.prepare(scan, point_map, prior, SPACE, multiplicity, weighting)
    return moments, prepared


def some_cells(rng, n):
    cells = rng.integers(0, SPACE.shape, (n, 3))
    cells[:2] = [[0, 0, 0], np.array(SPACE.shape) - 1]
    return cells


CORNERS = st.sampled_from([(0.0, 0.0), (1.0, -1.0), (0.5, 3.0), (-2.5, -0.5), (-30000.0, 20000.0)])


@given(seed=SEEDS, corner=CORNERS, n_points=st.sampled_from([1, 50, 3000]), is_signed=st.booleans(), options=OPTIONS)
def test_moments_are_those_of_the_exhaustive_search(seed, corner, n_points, is_signed, options):
    wanted, prepared = scene(seed, corner, n_points, is_signed, **options)
    cells = some_cells(np.random.default_rng(seed), 30)
    event(f"some match: {wanted.any()}")
    for heading in np.unique(cells[:, 0]):
        mine = cells[cells[:, 0] == heading]
        assert (prepared.moments_of_cells(heading, mine) == wanted[tuple(mine.T)]).all()


def test_a_scan_of_many_layers_far_from_the_map_matches_nothing():
    heights = np.arange(20_000.0)
    scan = Scan(np.column_stack([heights, heights, heights]), np.tile([1.0, 0.0, 0.0], (20_000, 1)))
    point_map = PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], CELL)
    prior = Pose(1e6, 1e6, 0.0, 0.0, 0.0, 0.0)
    prepared = PreparedScan.prepare(scan, point_map, prior, SPACE, Multiplicity.OCCUPIED, Weighting.COSINE)
    assert prepared.matches_nothing
    assert not prepared.moments_of_cells(0, np.zeros((3, 3), np.int64)).any()


def test_more_headings_than_are_kept(monkeypatch):
    monkeypatch.setattr("maxcon.search.prepared_scan.MOST_HEADINGS_KEPT", 2)
    wanted, prepared = scene(2)
    assert (np.count_nonzero(wanted, axis=(0, 1, 2)) > SPACE.n_cells // 4).all()
    cells = np.argwhere(np.ones(SPACE.shape[1:], bool))[:20]
    for heading in [*range(SPACE.shape[0]), 0, 1, 0]:
        of_heading = np.insert(cells, 0, heading, axis=1)
        assert (prepared.moments_of_cells(heading, of_heading) == wanted[tuple(of_heading.T)]).all()


@pytest.mark.parametrize("seed", range(3))
def test_scores_and_the_best_cell(seed):
    moments, prepared = scene(seed)
    wanted = Helmert().score(moments)
    cells = some_cells(np.random.default_rng(seed), 40)
    scored = ScoredCells(prepared, Helmert(), share=1e-9, lists_all=True)
    for part in (cells[:10], cells[5:25], cells[25:], cells[:0]):  # some twice
        scored.score(part)
    found = scored.found(rest=0.0)
    assert dict(zip(map(tuple, found.reaching.cells.tolist()), found.reaching.upper, strict=True)) == {
        tuple(cell): score for cell in cells.tolist() if (score := wanted[tuple(cell)]) >= scored.asked
    }
    best = max(
        ((wanted[tuple(cell)], tuple(cell)) for cell in cells.tolist()),
        key=lambda each: (each[0], [-index for index in each[1]]),
    )
    assert (found.score, found.cell) == best
    assert (scored.best, scored.asked) == (best[0], 1e-9 * best[0])
    assert (scored.leader.score, found.n_scored) == (best[0], len({*map(tuple, cells.tolist())}))
    assert (found.moments == moments[found.cell]).all()
    assert scored.highest_of(cells[3:9]) == wanted[tuple(cells[3:9].T)].max()


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_a_window_is_scored_at_once(seed, n_threads):
    moments, prepared = scene(seed)
    scores = Helmert().score(moments)
    headings, window = np.array([0, 2, 3]), Window.around(np.array([[0, 3, 10], [0, 9, 25]]), SPACE)
    scored = ScoredCells(prepared, Helmert(), share=0.5, lists_all=True)
    highest_other = scored.score_window(headings, window, n_threads, 2**20)
    wanted = np.zeros_like(scores)
    wanted[headings, 3:10, 10:26] = scores[headings, 3:10, 10:26]
    cell = tuple(int(index) for index in np.unravel_index(np.argmax(wanted), wanted.shape))
    found = scored.found(rest=0.0)
    assert (found.score, found.cell, scored.n_in_windows) == (wanted[cell], cell, 3 * 7 * 16)
    assert (found.moments == moments[cell]).all()
    reaching = wanted >= 0.5 * wanted.max()
    assert {*map(tuple, found.reaching.cells.tolist())} == {*map(tuple, np.argwhere(reaching).tolist())}
    assert highest_other == wanted.max(where=~reaching, initial=0.0)
    far = np.argwhere(reaching)[scored.is_beyond(np.argwhere(reaching))]
    assert scored.runner_up() == max([*wanted[tuple(far.T)], 0.0])


def test_what_is_asked_of_a_cell_where_one_is_guarded_and_where_there_is_an_incumbent():
    moments, prepared = scene(0)
    scores = Helmert().score(moments)
    guarded = tuple(int(index) for index in np.unravel_index(np.argmax(scores), scores.shape))
    highest = float(scores[guarded])
    scored = ScoredCells(prepared, Helmert(), share=0.5, guarded=guarded)
    assert (scored.best, scored.asked, scored.leader.score) == (highest, 0.5 * highest, highest)
    lower, higher = Incumbent(0.5 * highest, np.ones(4)), Incumbent(2.0 * highest, moments[guarded])
    for incumbent, score in ((lower, highest), (higher, higher.score), (None, highest)):
        known = ScoredCells(prepared, Helmert(), incumbent=incumbent)
        assert known.leader is incumbent
        if incumbent is not None:
            assert known.asked == known.best == incumbent.score
        assert (known.found(rest=1.0).score, known.found(rest=1.0).moments.tolist()) == (-np.inf, [0.0, 0.0, 0.0, 0.0])
        known.score(np.array([guarded]))
        assert known.leader.score == known.best == score
        assert (known.leader.moments == moments[guarded]).all()
    all_near = ScoredCells(prepared, Helmert(), guard_radius=100.0)
    all_near.score(some_cells(np.random.default_rng(0), 40))
    assert (all_near.best > 0.0, all_near.runner_up()) == (True, 0.0)


@pytest.mark.parametrize("per_pass", [1, 112, 250, 2**20])
def test_windows_are_scored_as_many_headings_at_a_time_as_memory_allows(per_pass):
    window, asked = Window(0, 15, 0, 6), []

    def moments_of_window(headings, window, n_threads):
        asked.append(headings)
        return np.ones((len(headings), *window.shape, 4))

    prepared = SimpleNamespace(space=SPACE, moments_of_window=moments_of_window)
    scored = ScoredCells(prepared, Count(), share=0.5)
    assert scored.score_window(np.arange(5), window, 1, per_pass) == 0.0
    assert np.concatenate(asked).tolist() == [0, 1, 2, 3, 4]
    assert max(map(len, asked)) == {1: 1, 112: 1, 250: 2, 2**20: 5}[per_pass]
    assert scored.n_in_windows == 5 * 7 * 16


def test_what_is_wanted_by_default_is_what_the_search_finds_by_default():
    parameters = inspect.signature(branch_and_bound).parameters
    of_cells = inspect.signature(ScoredCells).parameters
    wanted = {name: each.default for name, each in of_cells.items() if each.default is not inspect.Parameter.empty}
    assert wanted == {name: parameters[name].default for name in wanted}
    found = Found((0, 0, 0), 1.0, np.zeros(4), 1.0, 0.0, 1)
    assert (found.height, len(found.reaching)) == (0, 0)
