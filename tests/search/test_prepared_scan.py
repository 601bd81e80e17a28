# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the compiled searches prepare is what plain NumPy makes of the definitions, to the last bit."""

import pickle

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from searches import SEEDS, unit_vectors

from maxcon import PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS
from maxcon.search import Multiplicity, Weighting, group_kernels
from maxcon.search.accumulator import turn, upright
from maxcon.search.group_kernels import SQUARE_VOXELS
from maxcon.search.prepared_scan import PreparedScan, _aligned_zeros

CELL = 0.25
TILE = TILE_VOXELS * CELL
SPACE = SearchSpace(2.0, CELL, 2.0, 0.5)
SIDES = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]


def random_scan(rng, n_points, spread, height):
    """Points of which some share a voxel, a quarter of them without a normal."""
    points = rng.uniform(-1.0, 1.0, (n_points, 3)) * [spread, spread, height]
    points = points[rng.integers(0, max(1, n_points // 2), n_points)] + rng.normal(0.0, CELL, (n_points, 3))
    return Scan(points, unit_vectors(rng, n_points, 0.25))


def random_map(rng, prior, n_points, spread):
    points = rng.uniform(-1.0, 1.0, (n_points, 3)) * [spread, spread, 2.0] + prior.position
    return PointMap.from_points(points, np.tile([1.0, 0.0, 0.0], (n_points, 1)), CELL)


def random_prior(rng):
    return Pose(*rng.uniform(-3 * TILE, 3 * TILE, 2), *rng.uniform(-0.1, 0.1, 3), rng.uniform(-4.0, 4.0))


def prepared_with(scan, point_map, prior, weighting=Weighting.COSINE):
    return PreparedScan.prepare(scan, point_map, prior, SPACE, Multiplicity.OCCUPIED, weighting)


def plainly(scan, prior, weighting):
    """Points, normals, columns, layers, in order; group of each; middles: as `PreparedScan` describes them."""
    scan_upright = upright(scan, prior)
    layers = voxel_indices(scan_upright.points, CELL)[:, 2]
    turned = turn(scan_upright.points, prior.heading) + [prior.x, prior.y, 0.0]
    x, y, _ = voxel_indices(turned, CELL).T
    is_plain = ~scan_upright.normals.any(axis=1) | (weighting is Weighting.ONE)
    parts = [y // SQUARE_VOXELS, x // SQUARE_VOXELS, layers]
    normals = np.where(is_plain[:, None], 0.0, scan_upright.normals)
    order = np.lexsort([x, y, is_plain, *parts[::-1]])
    _, groups = np.unique(np.array(parts)[:, order], axis=1, return_inverse=True)
    n_with_normal = np.bincount(groups, ~is_plain[order])
    points = scan_upright.points[order]
    return points, normals[order], np.array([x, y])[:, order], layers[order], groups, n_with_normal


@given(
    seed=SEEDS,
    n_points=st.integers(1, 80) | st.just(400),
    spread=st.sampled_from([0.0, 2.0, 60.0, 3000.0, 1e8]),
    height=st.sampled_from([0.0, 3.0, 1e8]),
    weighting=st.sampled_from(list(Weighting)),
)
def test_groups_and_tiles_are_those_of_the_definition(seed, n_points, spread, height, weighting):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng)
    scan = random_scan(rng, n_points, spread, height)
    point_map = random_map(rng, prior, 60, 3 * TILE)
    prepared = prepared_with(scan, point_map, prior, weighting)

    points, normals, columns, layers, groups, n_with_normal = plainly(scan, prior, weighting)
    assert (prepared.points == points[:, :2].T).all()
    assert (prepared.normals == normals.T).all()
    nx, ny, _ = upright(scan, prior).normals.T
    np.testing.assert_allclose(prepared.spread, [nx @ nx, nx @ ny, ny @ ny], atol=1e-9)
    assert prepared.starts.tolist() == [*np.flatnonzero(np.diff(groups, prepend=-1)), n_points]
    assert (prepared.middles == prepared.starts[:-1] + n_with_normal).all()
    scan_layers, ranks = np.unique(layers, return_inverse=True)
    assert (prepared.ranks == ranks[prepared.starts[:-1]]).all()

    reach = np.hypot(*points[:, :2].T) * np.abs(SPACE.headings).max() + SPACE.reach + CELL
    reach = np.maximum.reduceat(reach, prepared.starts[:-1])
    low = np.minimum.reduceat(columns, prepared.starts[:-1], axis=1) * CELL - reach
    high = (np.maximum.reduceat(columns, prepared.starts[:-1], axis=1) + 1) * CELL + reach
    edge = point_map.tile_voxels * point_map.cell
    first, last = np.floor(low.T / edge), np.floor(high.T / edge)
    met = [key for key in sorted(point_map.tile_keys) if ((first <= key) & (last >= key)).all(axis=1).any()]
    event(f"tiles: {min(len(met), 3)}, far apart: {spread > 1e6 or height > 1e6}")
    assert [tile.key for tile, _ in prepared.tiles.values()] == met
    for slot, (tile, numbers) in prepared.tiles.items():
        row, column = divmod(slot, prepared.shape[1])
        assert (prepared.corner[0] + column, prepared.corner[1] + row) == tile.key
        assert row < prepared.shape[0]
        wanted = {layer: number for number, layer in enumerate(tile.index.layers.tolist())}
        assert numbers.tolist() == [wanted.get(layer, -1) for layer in scan_layers.tolist()]


@given(seed=SEEDS, n_points=st.integers(0, 60), n_headings=st.integers(1, 4))
def test_turned_is_what_the_definition_turns(seed, n_points, n_headings):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng)
    scan = random_scan(rng, n_points, 30.0, 3.0)
    point_map = random_map(rng, prior, 10, 10.0)
    prepared = prepared_with(scan, point_map, prior)
    headings = rng.integers(0, len(SPACE.headings), n_headings)
    turns = np.array([(np.cos(a), np.sin(a)) for a in prior.heading + SPACE.headings[headings]])
    columns = group_kernels.turn_to_columns(prepared.points, turns, (prior.x, prior.y), CELL)
    turned = group_kernels.turn_normals(prepared.normals, turns)
    points = np.vstack([prepared.points, np.zeros(n_points)]).T
    for i, heading in enumerate(prior.heading + SPACE.headings[headings]):
        places = turn(points, heading) + [prior.x, prior.y, 0.0]
        assert (columns[i] == voxel_indices(places, CELL).T[:2]).all()
        assert (turned[i] == turn(prepared.normals.T, heading).T.astype(np.float32)).all()


@given(seed=SEEDS, n=st.integers(0, 300), n_bits=st.integers(0, 64), has_ties=st.booleans())
def test_keys_are_sorted_as_numpy_does(seed, n, n_bits, has_ties):
    rng = np.random.default_rng(seed)
    keys = rng.integers(0, 2**n_bits - 1, n, dtype=np.uint64, endpoint=True)
    keys = rng.choice(keys, n) if has_ties and n else keys
    wanted = np.argsort(keys, kind="stable")
    order, ordered = group_kernels.sort_keys(keys.copy())
    assert (order == wanted).all()
    assert (ordered == keys[wanted]).all()


def test_an_empty_scan_has_no_groups_and_loads_no_tile():
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    nothing = Scan(np.empty((0, 3)), np.empty((0, 3)))
    prepared = prepared_with(nothing, random_map(np.random.default_rng(1), prior, 5, 1.0), prior)
    assert prepared.starts.tolist() == [0]
    assert (prepared.points.shape, prepared.normals.shape) == ((2, 0), (3, 0))
    assert (len(prepared.middles), len(prepared.ranks), prepared.tiles, prepared.shape) == (0, 0, {}, (0, 0))


END = 2.0**30 * CELL  # indices end there


@pytest.mark.parametrize(
    ("direction", "length", "fits", "refused"),
    [  # the space reaches 2 m, and one cell more is kept free; no cell lies higher or lower
        *(([x, y, 0.0], *reach) for x, y in SIDES for reach in ((0.0, 3.0, 2.0), (4.0, 7.0, 5.5))),
        *(([0.0, 0.0, z], 0.0, 0.5, -0.5) for z in (1.0, -1.0)),
    ],
)
def test_priors_from_which_a_point_or_a_cell_reaches_beyond_all_indices_are_refused(direction, length, fits, refused):
    here = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.7)
    scan, point_map = Scan([[0.0, length, 0.0]], [[1.0, 0.0, 0.0]]), random_map(np.random.default_rng(1), here, 5, 1.0)
    near, far, out = (here.translated(at * np.array(direction)) for at in (END - fits, END - refused, 3e8))
    assert prepared_with(scan, point_map, near).n_points == 1
    with pytest.raises(ArrayError, match="of the local origin"):
        prepared_with(scan, point_map, far)
    for place, prior in ((3e8 * np.array(direction), here), ([1.0, 2.0, 3.0], out)):
        with pytest.raises(ArrayError, match=r"within 2\.68e\+08 m of the local origin, got 3e\+08 m"):
            prepared_with(Scan([place], [[1.0, 0.0, 0.0]]), point_map, prior)


def test_sums_of_cells_begin_with_a_cache_line():
    for n in range(1, 40):
        zeros = _aligned_zeros((n, 3, 4))
        assert (zeros.shape, zeros.any(), zeros.ctypes.data % 64) == ((n, 3, 4), False, 0)


@pytest.mark.parametrize("x", [-300.5, 300.5])
@pytest.mark.parametrize("y", [-200.0, 200.0])
def test_the_grid_is_as_large_as_the_tiles_in_reach_wherever_they_are(x, y):
    prior = Pose(x * TILE, y * TILE, 0.0, 0.0, 0.0, 0.3)
    rng = np.random.default_rng(2)
    scan, point_map = random_scan(rng, 50, 3.0, 1.0), random_map(rng, prior, 400, 3.0)
    prepared = prepared_with(scan, point_map, prior)
    assert [tile.key for tile, _ in prepared.tiles.values()] == [(int(x - 0.5), int(y) - 1), (int(x - 0.5), int(y))]
    assert (prepared.corner, prepared.shape) == ((int(x - 0.5), int(y) - 1), (2, 1))


@pytest.mark.parametrize("weighting", list(Weighting))
def test_the_field_of_the_points_that_constrain(weighting):
    rng = np.random.default_rng(0)
    prior = random_prior(rng)
    scan, point_map = random_scan(rng, 500, 20.0, 2.0), random_map(rng, prior, 500, 20.0)
    whole = prepared_with(scan, point_map, prior, weighting)
    part = whole.constraining()
    ends = whole.middles if weighting is Weighting.PUBLISHED else whole.starts[1:]
    numbers = [np.arange(start, end) for start, end in zip(whole.starts[:-1], ends, strict=True)]
    kept = np.concatenate(numbers)
    assert (part.points == whole.points[:, kept]).all()
    assert (part.normals == whole.normals[:, kept]).all()
    assert np.diff(part.starts).tolist() == [len(each) for each in numbers if len(each)]
    assert part.ranks.tolist() == [rank for rank, each in zip(whole.ranks, numbers, strict=True) if len(each)]
    if weighting is Weighting.PUBLISHED:
        assert (part.middles == part.starts[1:]).all()
        assert 300 < len(kept) < 450
    else:
        assert len(kept) == len(scan)


def test_a_scan_from_another_process_needs_no_other_code():
    rng = np.random.default_rng(1)
    prior = random_prior(rng)
    scan, point_map = random_scan(rng, 20, 3.0, 1.0), random_map(rng, prior, 5, 1.0)
    wanted = prepared_with(scan, point_map, prior)
    before = list(group_kernels.group_scan.signatures)
    prepared = prepared_with(pickle.loads(pickle.dumps(scan)), point_map, prior)
    assert (prepared.points == wanted.points).all() and (prepared.normals == wanted.normals).all()
    assert group_kernels.group_scan.signatures == before
