# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A search over heights: exhaustive equals the definition, and branch and bound the exhaustive one (D7)."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from maxcon import Count, Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import SearchSpaceError
from maxcon.search import Weighting, accumulators, branch_and_bound, exhaustive, highest_of, reference
from maxcon.search.objectives import OBJECTIVES

CELL = 0.1
SEEDS = st.integers(0, 2**32)


class OwnObjective:
    """One that knows no bounds."""

    def score(self, moments):
        return np.sqrt(moments[..., 1] * moments[..., 3])


def yard(seed, space, *, n_walls=6, n_points=120):
    """Walls that end at different heights, as a scan sees them from some pose and height of the space; and clutter."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for number in range(n_walls):
        along = np.array([1.0, 0.0]) if number % 2 else np.array([0.0, 1.0])
        facing = along[::-1]
        start = rng.uniform(-4.0, 4.0, 2)
        steps = np.arange(0.0, rng.uniform(0.5, 3.0), CELL / 2)
        bottom, top = np.sort(rng.uniform(-0.8, 0.8, 2))
        for height in np.arange(bottom, top, CELL):
            points.append(np.column_stack([start + steps[:, None] * along, np.full(len(steps), height)]))
            noisy = np.array([*facing, 0.0]) + rng.normal(0.0, 0.05, (len(steps), 3))
            normals.append(noisy / np.linalg.norm(noisy, axis=1, keepdims=True))
    points = np.concatenate([*points, rng.uniform(-3.0, 3.0, (40, 3)) * [1.0, 1.0, 0.3]])
    normals = np.concatenate([*normals, np.zeros((40, 3))])
    point_map = PointMap.from_points(points, normals, CELL)
    prior = Pose(*rng.uniform(-0.5, 0.5, 3), *rng.uniform(-0.02, 0.02, 2), rng.uniform(-4.0, 4.0))
    cell = tuple(int(rng.integers(n)) for n in space.shape)
    truth = space.pose(cell, space.raised(prior, int(rng.integers(space.n_heights))))
    seen = rng.permutation(len(points))[:n_points]
    normals_scan = normals[seen] @ truth.rotation
    normals_scan[rng.random(len(seen)) < 0.4] = 0.0
    return Scan((points[seen] - truth.position) @ truth.rotation, normals_scan), point_map, prior


@given(seed=SEEDS, n_heights=st.integers(0, 3), objective=st.sampled_from(OBJECTIVES))
@settings(max_examples=25, deadline=None)
def test_exhaustive_over_heights_is_the_definition(seed, n_heights, objective):
    space = SearchSpace(3 * CELL, CELL, 0.5, 0.5, n_heights * CELL)
    scene = yard(seed, space)
    defined = list(accumulators(reference.voxels, *scene, space))
    fast = list(accumulators(exhaustive, *scene, space))
    assert len(defined) == len(fast) == space.n_heights
    for height, (one, other) in enumerate(zip(defined, fast, strict=True)):
        np.testing.assert_array_equal(one.moments, other.moments)
        assert one.prior == other.prior == space.raised(scene[2], height)
    number, best = highest_of(fast, objective)
    # All heights in one array of the index order: the first highest cell is the answer (D8).
    scores = np.stack([accumulator.score(objective) for accumulator in defined], axis=1)
    heading, height, y, x = np.unravel_index(np.argmax(scores), scores.shape)
    assert (number, best.best_cell(objective)) == (height, (heading, y, x))


@given(
    seed=SEEDS,
    n_heights=st.integers(0, 5),
    n_steps=st.sampled_from([0, 2, 10]),
    objective=st.sampled_from([*OBJECTIVES, OwnObjective()]),
    multiplicity=st.sampled_from(["occupied", "points"]),
    weighting=st.sampled_from(list(Weighting)),
    share=st.sampled_from([1.0, 0.8, 0.3]),
)
@settings(max_examples=120, deadline=None)
def test_branch_and_bound_over_heights_finds_what_the_exhaustive_search_finds(
    seed, n_heights, n_steps, objective, multiplicity, weighting, share
):
    space = SearchSpace(n_steps * CELL, CELL, 0.5, 0.5, n_heights * CELL)
    scene = yard(seed, space)
    options = {"multiplicity": multiplicity, "weighting": weighting}
    found = branch_and_bound(*scene, space, objective, share=share, **options)
    height, accumulator = highest_of(accumulators(exhaustive, *scene, space, **options), objective)
    cell = accumulator.best_cell(objective)
    event(f"steps from the prior's height: {abs(height - space.n_heights // 2)}")
    assert (found.height, found.cell) == (height, cell)
    assert found.score == accumulator.score(objective)[cell] == found.bound
    np.testing.assert_array_equal(found.moments, accumulator.moments[cell])
    # The runner-up is that of the same height.
    alone = branch_and_bound(*scene[:2], space.raised(scene[2], height), space.plane, objective, share=share, **options)
    scores = accumulator.score(objective)
    distance = np.hypot(*np.meshgrid(*(np.arange(n) - at for n, at in zip(space.shape[1:], cell[1:], strict=True))))
    runner_up = scores.max(axis=0).max(where=distance.T * CELL > 0.3, initial=0.0)
    assert found.rest >= runner_up
    assert alone.cell == found.cell
    if runner_up >= share * found.score:
        assert found.rest == runner_up == alone.rest


def test_ties_of_heights_are_broken_in_index_order():
    """A wall as high as the space: every height sees the same; the lowest wins, but for a heading that comes before."""
    x, z = np.meshgrid(np.arange(-2.0, 2.0, CELL / 2), np.arange(-3.0, 3.0, CELL / 2))
    wall = np.column_stack([x.ravel(), np.full(x.size, 2.05), z.ravel()])
    point_map = PointMap.from_points(wall, np.tile([0.0, -1.0, 0.0], (len(wall), 1)), CELL)
    scan = Scan([[0.0, 2.05, 0.05]], [[0.0, -1.0, 0.0]])
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    space = SearchSpace(2 * CELL, CELL, 1.0, 1.0, 3 * CELL)
    found = branch_and_bound(scan, point_map, prior, space, Count())
    assert (found.height, found.cell[0]) == (0, 0)
    assert (found.height, found.cell) == _best(scan, point_map, prior, space, Count())


def _best(scan, point_map, prior, space, objective):
    height, accumulator = highest_of(accumulators(exhaustive, scan, point_map, prior, space), objective)
    return height, accumulator.best_cell(objective)


def test_where_nothing_matches_the_first_cell_of_the_lowest_height_is_found():
    scan = Scan([[0.0, 2.0, 50.0]], [[0.0, -1.0, 0.0]])
    point_map = PointMap.from_points([[0.0, 2.0, 0.0]], [[0.0, -1.0, 0.0]], CELL)
    space = SearchSpace(2 * CELL, CELL, 0.5, 0.5, 2 * CELL)
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    found = branch_and_bound(scan, point_map, prior, space, Helmert())
    assert (found.height, found.cell, found.score) == (0, (0, 0, 0), 0.0)
    assert (found.height, found.cell) == _best(scan, point_map, prior, space, Helmert())


@pytest.mark.parametrize("search", [exhaustive, reference.voxels])
def test_one_accumulator_is_of_one_height(search):
    space = SearchSpace(2 * CELL, CELL, 0.5, 0.5, 2 * CELL)
    scan, point_map, prior = yard(0, space)
    with pytest.raises(SearchSpaceError, match="one height, got 5"):
        search(scan, point_map, prior, space)
    search(scan, point_map, prior, replace(space, height_half_width=0.0))


def test_no_heights_have_no_highest():
    with pytest.raises(SearchSpaceError, match="at least one height"):
        highest_of([], Helmert())
