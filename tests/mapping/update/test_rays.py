"""What a ray says of a voxel: scenes by hand, and the compiled walk against the plain definition."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.mapping.update.evidence import CANDIDATE, Surfaces, initial_evidence, is_hit, is_miss, stacked
from maxcon.mapping.update.observations import UpdateOptions
from maxcon.mapping.update.ray_kernels import add_observation, are_far_from_voxels, hide_known_surfaces

CELL = 0.1
MARGIN = 0.15
WEIGHTS = (0.85, -0.4, -2.0, 3.5)
FRONT = {"voxel": (50, 0, 10), "mean": (5.03, 0.05, 1.05), "normal": (-1.0, 0.0, 0.0)}
BUSH = {"voxel": (50, 0, 10), "mean": (5.05, 0.05, 1.05), "normal": (0.0, 0.0, 0.0)}
SIDE = {"voxel": (50, 0, 10), "mean": (5.05, 0.05, 1.05), "normal": (0.0, 1.0, 0.0)}


def is_missed(origin, end, voxel, mean, normal, margin=MARGIN, least_cosine=0.2, reach=50.0):
    arrays = (np.array([values]) for values in (voxel, mean, normal))
    return bool(is_miss(np.array(origin), np.array(end), *arrays, CELL, margin, least_cosine, reach)[0])


@pytest.mark.parametrize(("origin", "end", "more", "expected"), [
    ((0.0, 0.05, 1.05), (9.0, 0.05, 1.05), FRONT, True),  # the wall behind a vanished car
    ((0.0, 0.05, 1.05), (5.03, 0.05, 1.05), FRONT, False),  # ends on the surface
    ((0.0, 0.05, 1.05), (5.13, 0.05, 1.05), FRONT, False),  # ends on it but for noise
    ((0.0, 0.05, 1.05), (3.0, 0.05, 1.05), FRONT, False),  # hidden
    ((0.0, 0.15, 1.05), (9.0, 0.15, 1.05), FRONT, False),  # beside the voxel
    ((6.0, 0.05, 1.05), (9.0, 0.05, 1.05), FRONT, False),  # the other way
    ((0.0, 0.05, 1.05), (9.0, 0.05, 1.05), FRONT | {"reach": 5.0}, False),  # beyond the reach
    ((0.0, 0.05, 1.05), (9.0, 0.05, 1.05), BUSH, True),  # no normal: a close ray and twice the margin
    ((0.0, 0.05, 1.05), (5.05 + 2.0 * MARGIN + 0.01, 0.05, 1.05), BUSH, True),
    ((0.0, 0.05, 1.05), (5.05 + 2.0 * MARGIN - 0.01, 0.05, 1.05), BUSH, False),
    ((0.0, 0.002, 1.002), (9.0, 0.002, 1.002), BUSH, False),
    ((0.0, -0.05, 1.05), (20.0, 0.35, 1.05), SIDE | {"margin": 0.001}, False),  # a flat ray
])  # fmt: skip
def test_what_a_ray_says_of_a_voxel(origin, end, more, expected):
    assert is_missed(origin, end, **more) == expected


@pytest.mark.parametrize("distance", [3.0, 8.0, 20.0])
def test_a_road_seen_at_a_flat_angle_is_not_carved(distance):
    """The rays pass through voxels of the road just before they end on it."""
    height = 1.9
    road = [(x, 0, 0) for x in range(5, 300)]
    means = np.array(road) * CELL + [0.05, 0.05, 0.02]
    normals = np.tile([0.0, 0.0, 1.0], (len(road), 1))
    for shift in (-0.03, 0.0, 0.03):  # of the pose
        origin, end = np.array([0.0, 0.05, height + shift]), np.array([distance, 0.05, 0.02 + shift])
        assert not is_miss(origin, end, np.array(road), means, normals, CELL, MARGIN, 0.01, 50.0).any()


def test_an_end_meets_its_voxel_and_those_around():
    voxels = np.array([(x, y, 0) for x in range(-3, 4) for y in range(-3, 4)])
    met = is_hit(np.array([0.05, 0.05, 0.05]), voxels, CELL)
    assert {tuple(v) for v in voxels[met].tolist()} == {(x, y, 0) for x in (-1, 0, 1) for y in (-1, 0, 1)}


def random_map(rng, n=400):
    """Voxels in a small room, over the borders of tiles; a quarter of them without a normal."""
    points = rng.uniform(-2.5, 2.5, (n, 3))
    normals = rng.standard_normal((n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[rng.random(n) < 0.25] = 0.0
    point_map = PointMap.from_points(points, normals, CELL)
    return [point_map.tile(key) for key in sorted(point_map.tile_keys)]


def kept(tiles):
    """Some tiles, their voxels, and their evidence before the first observation."""
    options = UpdateOptions()
    table, evidence = stacked([Surfaces(t, initial_evidence(np.full(len(t), CANDIDATE), options)) for t in tiles])
    seen_in = np.full(len(evidence["n_hits"]), -1, np.int32)
    voxels = np.concatenate([tile.voxels for tile in tiles])
    arrays = (*evidence.values(), seen_in)
    return SimpleNamespace(tiles=tiles, voxels=voxels, table=table, evidence=evidence, arrays=arrays)


def add(within, origin, ends, look, margins, reach=4.0):
    add_observation(origin, ends, look, CELL, margins, 0.2, reach, WEIGHTS, within.table, within.arrays)


@given(st.integers(0, 2**32 - 1))
def test_the_compiled_walk_is_the_definition(seed):
    rng = np.random.default_rng(seed)
    within = kept(random_map(rng))
    tiles, voxels = within.tiles, within.voxels
    means = np.concatenate([tile.mean_points(CELL) for tile in tiles])
    normals = np.concatenate([tile.normals for tile in tiles]).astype(np.float64)
    log_odds = np.zeros(len(voxels), np.float32)
    hit_in = np.full((len(voxels), 2), -1)
    n_hits, n_misses = np.zeros(len(voxels), int), np.zeros(len(voxels), int)
    hit, miss, lowest, highest = WEIGHTS
    for look in range(4):
        origin = rng.uniform(-3.0, 3.0, 3)
        ends = rng.uniform(-4.0, 4.0, (60, 3))
        margins = rng.uniform(0.02, 0.2, len(ends))
        add(within, origin, ends, look, margins)
        near = [end for end in ends if ((end - origin) ** 2).sum() <= 16.0]
        met = np.any([is_hit(end, voxels, CELL) for end in near] or [np.zeros(len(voxels), bool)], axis=0)
        rays = zip(ends, margins, strict=True)
        missed = [is_miss(origin, end, voxels, means, normals, CELL, margin, 0.2, 4.0) for end, margin in rays]
        through = np.any(missed, axis=0) & ~met  # what an observation hit it did not miss
        n_hits, n_misses = n_hits + met, n_misses + through
        change = np.where(met, hit, np.where(through, miss, 0.0)).astype(np.float32)
        log_odds = np.clip(log_odds + change, np.float32(lowest), np.float32(highest))
        hit_in[met & (hit_in[:, 0] < 0), 0] = look
        hit_in[met, 1] = look
    wanted = {"n_hits": n_hits, "n_misses": n_misses, "log_odds": log_odds, "hit_in": hit_in}
    for name, values in wanted.items():
        np.testing.assert_array_equal(within.evidence[name], values, err_msg=name)
    assert n_misses.sum() > 0


def test_an_observation_counts_once_however_many_rays_it_has():
    within = kept(random_map(np.random.default_rng(1)))
    end = within.tiles[0].mean_points(CELL)[:1]
    add(within, np.array([5.0, 5.0, 5.0]), np.repeat(end, 10, axis=0), 0, np.full(10, 0.1), reach=50.0)
    assert within.evidence["n_hits"].max() == 1


@given(st.integers(0, 2**32 - 1))
def test_points_far_from_voxels(seed):
    rng = np.random.default_rng(seed)
    within = kept(random_map(rng))
    points = rng.uniform(-4.0, 4.0, (50, 3))
    is_far = np.empty(len(points), bool)
    are_far_from_voxels(points, 2, CELL, within.table, is_far)
    apart = np.abs(np.floor(points / CELL).astype(int)[:, None] - within.voxels).max(axis=2)
    np.testing.assert_array_equal(is_far, apart.min(axis=1) > 2)


def test_what_hides_a_wall_or_the_ground_is_told_from_what_hides_nothing():
    wall = np.stack(np.meshgrid(np.arange(-2.0, 2.0, 0.05), [4.05], np.arange(0.0, 2.0, 0.05)), -1).reshape(-1, 3)
    point_map = PointMap.from_points(wall, np.tile([0.0, -1.0, 0.0], (len(wall), 1)), CELL)
    within = kept([point_map.tile(key) for key in sorted(point_map.tile_keys)])
    ends = np.array([[0.0, 2.0, 1.0], [0.0, 3.8, 1.0], [0.0, -2.0, 1.0], [2.0, 0.0, 0.5]])
    origin, is_hiding = np.array([0.0, 0.0, 1.0]), np.empty(4, bool)
    ground = np.full((1, 40, 40), np.nan, np.float32)
    ground[0, :, 24:] = 0.0  # of cells of 0.5 m from x = 2 m on
    hide_known_surfaces(origin, ends, 0.5, 6.0, CELL, within.table, ground, np.array([-20, -20]), 0.5, is_hiding)
    assert is_hiding.tolist() == [True, False, False, True]  # before the wall; at it; away from it; over the ground
