"""A search over heights: exhaustive equals the definition, and branch and bound the exhaustive one (D7)."""

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, OwnObjective

from maxcon import Count, Helmert, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import SearchSpaceError
from maxcon.search import accumulators, branch_and_bound, exhaustive, highest_of, reference
from maxcon.search.objectives import OBJECTIVES

CELL = 0.1
TO_WALL = [0.0, -1.0, 0.0]


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
@settings(max_examples=25)
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
    seed=SEEDS, n_heights=st.integers(0, 5), n_steps=st.sampled_from([0, 2, 10]),
    objective=st.sampled_from([*OBJECTIVES, OwnObjective()]), options=OPTIONS, ratio=st.sampled_from([1.0, 0.8, 0.3]),
)  # fmt: skip
def test_branch_and_bound_over_heights_is_exhaustive(seed, n_heights, n_steps, objective, options, ratio):
    space = SearchSpace(n_steps * CELL, CELL, 0.5, 0.5, n_heights * CELL)
    scene = yard(seed, space)
    found = branch_and_bound(*scene, space, objective, ratio=ratio, **options)
    height, accumulator = highest_of(accumulators(exhaustive, *scene, space, **options), objective)
    cell, scores = accumulator.best_cell(objective), accumulator.score(objective)
    event(f"steps from the prior's height: {abs(height - space.n_heights // 2)}")
    assert (found.height, found.cell) == (height, cell)
    assert found.score == scores[cell] == found.bound
    np.testing.assert_array_equal(found.moments, accumulator.moments[cell])
    # The second best is that of the same height.
    alone = branch_and_bound(*scene[:2], space.raised(scene[2], height), space.plane, objective, ratio=ratio, **options)
    y, x = (np.arange(n) - at for n, at in zip(space.shape[1:], cell[1:], strict=True))
    is_far = np.hypot(y[:, None], x) * CELL > 0.3
    second_best = scores.max(axis=0).max(where=is_far, initial=0.0)
    assert (alone.cell, found.second_best >= second_best) == (found.cell, True)
    if second_best >= ratio * found.score:
        assert found.second_best == second_best == alone.second_best


def test_ties_of_heights_are_broken_in_index_order():
    """A wall as high as the space: every height sees the same; the lowest wins, but for a heading that comes before."""
    x, z = np.meshgrid(np.arange(-2.0, 2.0, CELL / 2), np.arange(-3.0, 3.0, CELL / 2))
    wall = np.column_stack([x.ravel(), np.full(x.size, 2.05), z.ravel()])
    point_map = PointMap.from_points(wall, np.tile(TO_WALL, (len(wall), 1)), CELL)
    space = SearchSpace(2 * CELL, CELL, 1.0, 1.0, 3 * CELL)
    found = best_by_both(Scan([[0.0, 2.05, 0.05]], [TO_WALL]), point_map, space, Count())
    assert (found.height, found.cell[0]) == (0, 0)
    point_map = PointMap.from_points([[0.0, 2.0, 0.0]], [TO_WALL], CELL)
    space = SearchSpace(2 * CELL, CELL, 0.5, 0.5, 2 * CELL)
    found = best_by_both(Scan([[0.0, 2.0, 50.0]], [TO_WALL]), point_map, space, Helmert())
    assert (found.height, found.cell, found.score) == (0, (0, 0, 0), 0.0)
    with pytest.raises(SearchSpaceError, match="at least one height"):
        highest_of([], Helmert())


def best_by_both(scan, point_map, space, objective):
    """What branch and bound finds, which is what the exhaustive search does."""
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    height, accumulator = highest_of(accumulators(exhaustive, scan, point_map, prior, space), objective)
    found = branch_and_bound(scan, point_map, prior, space, objective)
    assert (found.height, found.cell) == (height, accumulator.best_cell(objective))
    return found
