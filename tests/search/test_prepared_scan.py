"""What the compiled searches prepare is what plain NumPy makes of the definitions, to the last bit."""

import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st
from searches import SEEDS, unit_vectors

from maxcon import PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS
from maxcon.search import Multiplicity, Weighting
from maxcon.search.accumulator import turn, upright
from maxcon.search.prepared_scan import SQUARE_BITS, PreparedScan, _aligned_zeros

CELL = 0.25
TILE = TILE_VOXELS * CELL
SPACE = SearchSpace(2.0, CELL, 2.0, 0.5)
SIDES = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
END = 2.0**30 * CELL  # indices end there


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


@given(
    seed=SEEDS, n_points=st.integers(1, 80) | st.just(400), spread=st.sampled_from([0.0, 2.0, 60.0, 3000.0, 1e8]),
    height=st.sampled_from([0.0, 3.0, 1e8]), weighting=st.sampled_from(list(Weighting)),
)  # fmt: skip
def test_groups_are_of_one_square_and_layer_and_have_their_tiles(seed, n_points, spread, height, weighting):
    rng = np.random.default_rng(seed)
    prior = random_prior(rng)
    scan = random_scan(rng, n_points, spread, height)
    point_map = random_map(rng, prior, 60, 3 * TILE)
    prepared = prepared_with(scan, point_map, prior, weighting)
    # The same points, in another order.
    aligned = upright(scan, prior)
    normals = np.zeros_like(aligned.normals) if weighting is Weighting.ONE else aligned.normals
    layers = np.repeat(prepared.layers, np.diff(prepared.starts))
    wanted = np.column_stack([aligned.points[:, :2], voxel_indices(aligned.points, CELL)[:, 2], normals])
    got = np.column_stack([prepared.points.T, layers, prepared.normals.T])
    assert (got[np.lexsort(got.T)] == wanted[np.lexsort(wanted.T)]).all()
    nx, ny, _ = aligned.normals.T
    np.testing.assert_allclose(prepared.spread, [nx @ nx, nx @ ny, ny @ ny], atol=1e-9)
    # Each group has one square; near each other, each square and layer has one group.
    places = turn(np.vstack([prepared.points, np.zeros(n_points)]).T, prior.heading) + [prior.x, prior.y, 0.0]
    columns = voxel_indices(places, CELL)[:, :2]
    groups = np.repeat(np.arange(len(prepared.layers)), np.diff(prepared.starts))
    parts = np.column_stack([columns >> SQUARE_BITS, layers])
    assert (parts == parts[prepared.starts[:-1]][groups]).all()
    assert max(spread, height) > 1e6 or len(np.unique(parts, axis=0)) == len(prepared.layers)
    is_bare = ~prepared.normals.any(axis=0)
    assert (is_bare == (np.arange(n_points) >= prepared.middles[groups])).all()
    # Points of one voxel follow each other, those with a normal and those without.
    kinds = np.column_stack([columns, layers, is_bare])
    assert max(spread, height) > 1e6 or (
        len(np.unique(kinds, axis=0)) == 1 + np.count_nonzero((np.diff(kinds, axis=0) != 0).any(axis=1))
    )

    reach = np.hypot(*prepared.points) * np.abs(SPACE.headings).max() + SPACE.reach + CELL
    reach = np.maximum.reduceat(reach, prepared.starts[:-1])[:, None]
    edge = point_map.tile_voxels * point_map.cell
    first = np.floor((np.minimum.reduceat(columns, prepared.starts[:-1]) * CELL - reach) / edge)
    last = np.floor(((np.maximum.reduceat(columns, prepared.starts[:-1]) + 1) * CELL + reach) / edge)
    met = [key for key in sorted(point_map.tile_keys) if ((first <= key) & (last >= key)).all(axis=1).any()]
    event(f"tiles: {min(len(met), 3)}, far apart: {spread > 1e6 or height > 1e6}")
    assert [tile.key for tile in prepared.tiles.values()] == met
    for slot, tile in prepared.tiles.items():
        row, column = divmod(slot, prepared.shape[1])
        assert (prepared.corner[0] + column, prepared.corner[1] + row) == tile.key
        assert row < prepared.shape[0]


@pytest.mark.parametrize(("direction", "length", "fits", "refused"), [
    # The space reaches 2 m, and one cell more is kept free; no cell lies higher or lower.
    *(([x, y, 0.0], *reach) for x, y in SIDES for reach in ((0.0, 3.0, 2.0), (4.0, 7.0, 5.5))),
    *(([0.0, 0.0, z], 0.0, 0.5, -0.5) for z in (1.0, -1.0)),
])  # fmt: skip
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


def test_an_empty_scan_has_no_groups_and_loads_no_tile():
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    nothing = Scan(np.empty((0, 3)), np.empty((0, 3)))
    prepared = prepared_with(nothing, random_map(np.random.default_rng(1), prior, 5, 1.0), prior)
    assert prepared.starts.tolist() == [0]
    assert (prepared.points.shape, prepared.normals.shape) == ((2, 0), (3, 0))
    assert (len(prepared.middles), len(prepared.layers), prepared.tiles, prepared.shape) == (0, 0, {}, (0, 0))


def test_sums_of_cells_begin_with_a_cache_line():
    for n in range(1, 40):
        zeros = _aligned_zeros((n, 3, 4))
        assert (zeros.shape, zeros.any(), zeros.ctypes.data % 64) == ((n, 3, 4), False, 0)


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
    assert part.layers.tolist() == [layer for layer, each in zip(whole.layers, numbers, strict=True) if len(each)]
    if weighting is Weighting.PUBLISHED:
        assert (part.middles == part.starts[1:]).all() and 300 < len(kept) < 450
    else:
        assert len(kept) == len(scan)
