"""The compiled search equals the definition, to the last bit (D7), whatever the order and the threads (D8)."""

import itertools

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from searches import OPTIONS, SEEDS, unit_vectors

from maxcon import Count, PointMap, Pose, Scan, SearchSpace
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS
from maxcon.search import consensus_set, exhaustive, reference
from maxcon.search.accumulator import CONTRIBUTION_STEP, turn, upright
from maxcon.search.objectives import OBJECTIVES

X = [1.0, 0.0, 0.0]
CORNERS = st.integers(-100, 100) | st.sampled_from([-2604, 2604])  # with voxels whose products exceed 2^31


def random_scene(seed, n_scan, n_map, cell, space, *, corner=(0, 0), is_signed=True, tilt=0.2, spread=20):
    """Map points around a tile's corner; scan points that fall on some of them at one cell, and elsewhere."""
    rng = np.random.default_rng(seed)
    voxels = rng.integers(-spread, spread, (n_map, 3)) // [1, 1, 8]
    voxels[:, :2] += np.array(corner) * TILE_VOXELS
    points_map = (voxels + rng.random((n_map, 3))) * cell
    normals_map = unit_vectors(rng, n_map)
    roll, pitch = rng.uniform(-tilt, tilt, 2)
    position = np.array([*corner, 0]) * TILE_VOXELS * cell + rng.uniform(-30, 30, 3) * cell
    prior = Pose(*position, roll, pitch, rng.uniform(-4, 4))
    truth = space.pose(tuple(int(rng.integers(n)) for n in space.shape), prior)
    n_hits = min(n_scan - n_scan // 4, n_map)
    hit = rng.integers(0, n_map, n_hits) if n_map else np.empty(0, int)
    outside = rng.uniform(-200, 200, (n_scan - len(hit), 3)) * cell
    points = np.concatenate([(points_map[hit] - truth.position) @ truth.rotation, outside])
    scan = Scan(points, unit_vectors(rng, n_scan))
    return scan, PointMap.from_points(points_map, normals_map, cell, is_signed=is_signed), prior


def by_votes(scan, point_map, prior, space, multiplicity="occupied", weighting="cosine"):
    """The same moments the other way round: each scan point votes with each voxel of its height."""
    indices, counts, normals_map = point_map.all_voxels()
    scan_upright = upright(scan, prior)
    n_headings, ny, nx = space.shape
    moments = np.zeros((*space.shape, 4))
    outer = (normals_map[:, [0, 0, 1]] * normals_map[:, [0, 1, 1]]).astype(np.float64)
    times = np.ones(len(counts)) if multiplicity == "occupied" else counts.astype(np.float64)
    for h in range(n_headings):
        heading = prior.heading + space.headings[h]
        base = voxel_indices(turn(scan_upright.points, heading) + [prior.x, prior.y, 0.0], point_map.cell)
        normals = turn(scan_upright.normals, heading).astype(np.float32)
        for voxel, normal in zip(base.astype(np.int64), normals, strict=True):
            ix, iy = indices[:, 0] - voxel[0] + nx // 2, indices[:, 1] - voxel[1] + ny // 2
            is_in = (indices[:, 2] == voxel[2]) & (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
            a, b = normal * normals_map[is_in], np.zeros(is_in.sum(), np.float32)
            cosine = (a[:, 0] + a[:, 1]) + a[:, 2]
            weight = np.maximum(b, cosine) if point_map.is_signed else np.abs(cosine)
            if weighting == "one":
                weight = np.ones_like(cosine)
            elif not normal.any():
                weight = np.full_like(cosine, {"cosine": 0.5, "published": 0.0}[weighting])
            added = (times[is_in] * weight.astype(np.float64))[:, None] * outer[is_in]
            added = np.rint(added / CONTRIBUTION_STEP) * CONTRIBUTION_STEP
            np.add.at(moments[h], (iy[is_in], ix[is_in]), np.column_stack([times[is_in], added]))
    return moments


def assert_same(accumulator, moments):
    __tracebackhide__ = True
    assert accumulator.moments.dtype == np.float64 and accumulator.moments.shape == moments.shape
    assert (accumulator.moments == moments).all()


@given(
    seed=SEEDS, n_scan=st.integers(0, 16), n_map=st.integers(0, 60), cell=st.sampled_from([0.03, 0.06, 0.1, 0.25, 0.5]),
    n_steps=st.integers(0, 9), turns=st.sampled_from([(0.0, 0.5), (0.5, 0.5), (2.0, 2.0)]),
    corner=st.tuples(st.sampled_from([-3, -1, 0, 2]), st.sampled_from([-2, 0, 1])), options=OPTIONS,
    is_signed=st.booleans(), n_threads=st.integers(1, 4),
)  # fmt: skip
def test_it_equals_the_definition(seed, n_scan, n_map, cell, n_steps, turns, corner, options, is_signed, n_threads):
    space = SearchSpace(n_steps * cell, cell, *turns)
    scene = random_scene(seed, n_scan, n_map, cell, space, corner=corner, is_signed=is_signed, spread=8)
    accumulator = exhaustive(*scene, space, **options, n_threads=n_threads)
    wanted = reference.voxels(*scene, space, **options)
    event(f"matches: {bool(wanted.moments.any())}")
    assert_same(accumulator, wanted.moments)
    assert_same(accumulator, by_votes(*scene, space, **options))
    for objective in OBJECTIVES:
        assert accumulator.best_cell(objective) == wanted.best_cell(objective)


@given(
    seed=SEEDS, n_scan=st.integers(1, 60), n_map=st.integers(1, 400),
    cell=st.sampled_from([0.03, 0.06, 0.0625, 0.5]) | st.floats(0.03, 0.5), n_steps=st.sampled_from([7, 8, 9, 31, 100]),
    spread=st.sampled_from([5, 40, 600]), corner=st.tuples(CORNERS, CORNERS),
    options=OPTIONS, is_signed=st.booleans(), n_threads=st.integers(1, 4), factor=st.sampled_from([1, 1, 4, 32]),
)  # fmt: skip
def test_it_equals_the_votes_of_large_windows(
    seed, n_scan, n_map, cell, n_steps, spread, corner, options, is_signed, n_threads, factor
):
    space = SearchSpace(n_steps * cell * factor, cell * factor, 1.0, 1.0)
    scan, point_map, prior = random_scene(
        seed, n_scan, n_map, cell, space, corner=corner, is_signed=is_signed, spread=spread
    )
    scene = scan, point_map.level(factor), prior, space
    moments = by_votes(*scene, **options)
    event(f"matches: {bool(moments.any())}")
    assert_same(exhaustive(*scene, **options, n_threads=n_threads), moments)


@given(
    seed=SEEDS, n_steps=st.sampled_from([0, 1, 12, 35]),
    turns=st.sampled_from([(0.0, 0.5), (2.0, 1.0), (60.0, 20.0), (180.0, 9.0)]), options=OPTIONS,
    is_signed=st.booleans(), n_threads=st.integers(1, 5),
)  # fmt: skip
def test_crowded_voxels_and_scans(seed, n_steps, turns, options, is_signed, n_threads):
    """Hundreds of voxels about each scan point, many points in a voxel, points and voxels without a normal."""
    cell = 0.0625
    rng = np.random.default_rng(seed)
    voxels = rng.integers(-25, 25, (3000, 3)) // [1, 1, 25]
    normals_map, normals = unit_vectors(rng, 3000, 0.46), unit_vectors(rng, 50, 0.46)
    point_map = PointMap.from_points((voxels + rng.random((3000, 3))) * cell, normals_map, cell, is_signed=is_signed)
    points = np.repeat(rng.uniform(-1.0, 1.0, (10, 3)) * [1, 1, 0.03], 5, axis=0) + rng.uniform(0.0, 0.03, (50, 3))
    scan = Scan(points[rng.permutation(50)], normals)
    prior = Pose(0.3, -0.2, 0.0, 0.01, -0.02, rng.uniform(-4, 4))
    scene = scan, point_map, prior, SearchSpace(n_steps * cell, cell, *turns)
    accumulator = exhaustive(*scene, **options, n_threads=n_threads)
    assert n_steps < 12 or accumulator.moments[..., 0].max() >= 5
    assert_same(accumulator, by_votes(*scene, **options))


def test_tiles_far_apart_at_once():
    """A map of two places 40 km apart, and a scan that reaches both."""
    cell = 0.5
    places = np.array([[0.25, 0.25, 0.25], [40_000.25, -40_000.25, 0.25]])
    point_map = PointMap.from_points(places, [X, X], cell)
    space = SearchSpace(2.0, cell, 0.0, 0.5)
    prior = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    moments = exhaustive(Scan(places, [X, X]), point_map, prior, space).moments
    np.testing.assert_array_equal(moments[0, 4, 4], [2.0, 2.0, 0.0, 0.0])
    assert moments[..., 0].sum() == 2


def test_a_voxel_of_a_million_points_weighs_a_million():
    place = [[0.03, 0.03, 0.03]]
    n = 1_000_000
    point_map = PointMap.from_points(place * n, np.tile([0.6, 0.8, 0.0], (n, 1)), 0.06)
    space, prior = SearchSpace(0.06, 0.06, 0.0, 0.5), Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    scan = Scan(place * 3, [X] * 3)
    accumulator = exhaustive(scan, point_map, prior, space, multiplicity="points")
    assert_same(accumulator, reference.voxels(scan, point_map, prior, space, multiplicity="points").moments)
    np.testing.assert_allclose(accumulator.moments[0, 1, 1], 3e6 * np.array([1, 0.216, 0.288, 0.384]), rtol=1e-6)


def test_ties_go_to_the_first_cell_in_index_order():
    """A point on a floor matches equally everywhere; two equal points tie in two cells."""
    cell = 0.0625
    floor = np.array([[x, y, 0] for x, y in itertools.product(range(-20, 20), repeat=2)]) * cell + cell / 2
    point_map = PointMap.from_points(floor, np.tile(X, (len(floor), 1)), cell)
    space, prior = SearchSpace(4 * cell, cell, 1.0, 1.0), Pose(cell / 2, cell / 2, cell / 2, 0.0, 0.0, 0.0)
    for n_threads in (1, 3):
        accumulator = exhaustive(Scan([[0.0] * 3], [X]), point_map, prior, space, n_threads=n_threads)
        assert (accumulator.moments[..., 0] == 1).all()
        assert accumulator.best_cell(Count()) == (0, 0, 0)
    two = PointMap.from_points(np.array([[2, 1, 0], [1, 2, 0]]) * cell + cell / 2, [X, X], cell)
    accumulator = exhaustive(Scan([[0.0] * 3], [X]), two, prior, space)
    assert accumulator.best_cell(Count()) == (0, 4 + 1, 4 + 2)


def test_the_cell_edges_may_differ_by_rounding_only():
    """0.1 + 0.2 is not 0.3; both searches must then use the same edge."""
    map_cell, space = 0.1 + 0.2, SearchSpace(3.0, 0.3, 0.0, 0.5)
    rng = np.random.default_rng(1)
    points = np.round(rng.uniform(-9, 9, (3000, 3)) / 0.3) * 0.3  # on the borders of voxels
    normals = unit_vectors(rng, len(points))
    point_map = PointMap.from_points(points, normals, map_cell)
    scan, prior = Scan(points[:50], normals[:50]), Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    wanted = reference.voxels(scan, point_map, prior, space)
    assert_same(exhaustive(scan, point_map, prior, space), wanted.moments)
    for cell in ((0, 10, 10), (0, 3, 12)):
        matched = consensus_set(scan, point_map, prior, space, cell)
        assert matched.sum() == wanted.moments[cell][0]


@given(SEEDS, st.integers(0, 20), st.integers(0, 200))
def test_the_consensus_set_of_a_cell_is_what_its_count_counts(seed, n_scan, n_map):
    space = SearchSpace(0.3, 0.06, 1.0, 1.0)
    scan, point_map, prior = random_scene(seed, n_scan, n_map, 0.06, space, spread=8, corner=(-1, 1))
    accumulator = exhaustive(scan, point_map, prior, space)
    voxels = {tuple(index) for index in point_map.all_voxels()[0].tolist()}
    best = accumulator.best_cell(Count())
    for cell in (best, (0, 0, 0), (2, 9, 4)):
        matched = consensus_set(scan, point_map, prior, space, cell)
        assert matched.shape == (len(scan),) and matched.sum() == accumulator.moments[cell][0]
    pose = space.pose(best, prior)
    inner = np.floor(pose.apply(scan.points) / 0.06).astype(int)
    is_in_map = np.array([tuple(index) in voxels for index in inner.tolist()], dtype=bool)
    n_other = np.count_nonzero(is_in_map != consensus_set(scan, point_map, prior, space, best))
    assert n_other <= 1  # a point on the border of two voxels may fall to either side
