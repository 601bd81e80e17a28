"""The definition, on scenes whose answer is known by hand and against loops in plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from searches import SEEDS, unit_vectors

from maxcon import Count, Helmert, MaxEigenvalue, MaximumConsensus, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError, OptionError
from maxcon.search import Weighting, reference

CELL = 0.06
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ONE_CELL = SearchSpace(0.0, CELL, 0.0, 0.5)
SMALL = SearchSpace(0.3, CELL, 0.0, 0.5)  # 10 x 10 cells
STREET = math.radians(31.0)
X, SLANTED = [1.0, 0.0, 0.0], [0.6, 0.0, 0.8]
MULTIPLICITIES = ("points", "occupied")


def by_pairs(scene, prior, space, multiplicity):
    return reference.pairs(
        scene.scan, scene.points, scene.normals, prior, space, threshold=CELL / 2, multiplicity=multiplicity
    )


def by_voxels(scene, prior, space, multiplicity):
    return reference.voxels(scene.scan, scene.point_map, prior, space, multiplicity=multiplicity)


both_models = pytest.mark.parametrize("model", [by_pairs, by_voxels])
both_multiplicities = pytest.mark.parametrize("multiplicity", MULTIPLICITIES)


def assert_only_best(accumulator, objective, cell):
    scores = accumulator.score(objective)
    assert accumulator.best_cell(objective) == cell
    assert np.count_nonzero(scores == scores.max()) == 1


# --- scenes ---
@both_models
@both_multiplicities
@pytest.mark.parametrize("objective", [Count(), Helmert(), MaxEigenvalue()])
def test_two_walls_at_right_angles_have_one_best_cell(scene, model, multiplicity, objective):
    scene.wall((-3, 5), (3, 5)).wall((4, -3), (4, 3))
    accumulator = model(scene, scene.prior(2, -3), SMALL, multiplicity)
    assert_only_best(accumulator, objective, (0, 5 - 3, 5 + 2))


@pytest.mark.parametrize("turn_deg", [0.0, 31.0])
@pytest.mark.parametrize("objective", [Helmert(), Count()])
@pytest.mark.parametrize("draw", ["wall", "street"])
def test_walls_along_one_direction_are_said_to_be_undetermined(scene, objective, turn_deg, draw):
    turn = math.radians(turn_deg)
    scene.wall((-3, 5), (3, 5), turn=turn) if draw == "wall" else bare_street(scene, turn)
    estimate = MaximumConsensus(SMALL, objective).localize(scene.scan, scene.point_map, scene.prior(1, 2))
    assert (estimate.status, estimate.is_localized) == ("undetermined", False)
    assert np.isinf(np.diag(estimate.cofactor)).all() and estimate.helmert_point_error == np.inf


def bare_street(scene, turn):
    scene.wall((-4, 5), (4, 5), turn=turn, heights=(1.02,))
    return scene.wall((-4, -6), (4, -6), turn=turn, heights=(1.02,))


@both_models
@both_multiplicities
def test_a_street_at_31_degrees_with_a_few_surfaces_across(turned_scene, model, multiplicity):
    scene = bare_street(turned_scene, STREET)
    for x, y in ((-3.1, 5.0), (2.0, 5.0), (3.7, -6.3)):
        scene.wall((x, y), (x, y + 0.3), turn=STREET, scan_step=0.1)
    space = SearchSpace(0.18, CELL, 1.0, 1.0)
    accumulator = model(scene, scene.prior(1, -2, 1.0), space, multiplicity)
    assert_only_best(accumulator, Helmert(), (2, 3 - 2, 3 + 1))


def test_uneven_map_density_draws_the_count_along_the_street_but_not_helmert(scene):
    """Figure "merged", (d) to (f), of the paper.

    A street along x, surveyed 20 times as densely from 1.2 m before the sensor on; the scan is densest there.
    """
    for y in (5.0, -6.0):
        scene.wall((-8, y), (-1.0, y)).wall((-1.0, y), (0.2, y), scan_step=0.06)
        scene.wall((0.2, y), (8, y))
        scene.wall((0.2, y), (1.4, y), repeat=20, in_scan=False)
    for x, y in ((-3.1, 5.0), (3.0, 5.0), (4.7, -6.3)):
        scene.wall((x, y), (x, y + 0.3), scan_step=0.1)
    space, middle = SearchSpace(1.8, CELL, 0.0, 0.5), (0, 30, 30)
    accumulator = by_voxels(scene, scene.prior(0, 0), space, "points")
    _, iy, ix = accumulator.best_cell(Count())
    assert iy == 30
    assert ix > 30 + 10  # along the street, by more than 0.6 m, towards the dense part
    assert_only_best(accumulator, Helmert(), middle)
    free_of_density = by_voxels(scene, scene.prior(0, 0), space, "occupied")
    assert_only_best(free_of_density, Count(), middle)
    assert_only_best(free_of_density, Helmert(), middle)


# --- the paper's closed forms ---
def unit_matches(n1, n2, turn):
    """n1 scan points on a surface with normal u, n2 on one at right angles; u at an angle to x."""
    c, s = math.cos(turn), math.sin(turn)
    u, v = [c, s, 0.0], [-s, c, 0.0]
    places = [[0.09, 0.03, 0.03], [0.33, 0.03, 0.03]]
    scan = Scan([places[0]] * n1 + [places[1]] * n2, [u] * n1 + [v] * n2)
    return scan, places, [u, v]


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.0, math.pi))
def test_unit_matches_at_right_angles(n1, n2, turn):
    scan, places, normals = unit_matches(n1, n2, turn)
    for accumulator in (
        reference.pairs(scan, places, normals, HERE, ONE_CELL, threshold=CELL / 2),
        reference.voxels(scan, PointMap.from_points(places, normals, CELL), HERE, ONE_CELL),
    ):
        score = float(accumulator.score(Helmert())[0, 0, 0])
        assert score == pytest.approx(n1 * n2 / (n1 + n2), rel=1e-5)
        if n1 == n2:
            assert score == pytest.approx(n1 / 2, rel=1e-5)
        assert accumulator.score(MaxEigenvalue())[0, 0, 0] == pytest.approx(min(n1, n2), rel=1e-5)


# --- equation (2) to the letter ---
def random_pairs(seed, n_scan, n_map, cell):
    """Scan and map points on a grid of cell / 8, exactly representable, with normals of all directions."""
    rng = np.random.default_rng(seed)
    scan_points = rng.integers(-12, 13, (n_scan, 3)) * [1, 1, 0.25] * cell / 8
    map_points = rng.integers(-24, 25, (n_map, 3)) * [1, 1, 0.25] * cell / 8
    normals = unit_vectors(rng, n_scan + n_map)
    return Scan(scan_points, normals[:n_scan]), map_points, normals[n_scan:]


def triple_loop(scan, map_points, map_normals, prior, space, threshold, *, is_signed, weighting):
    moments = np.zeros((*space.shape, 4))
    for h, heading in enumerate(space.headings):
        c, s = math.cos(prior.heading + heading), math.sin(prior.heading + heading)
        for (px, py, pz), (mx, my, mz) in zip(scan.points.tolist(), scan.normals.tolist(), strict=True):
            x, y, z = c * px - s * py + prior.x, s * px + c * py + prior.y, pz + prior.z
            ax, ay, az = c * mx - s * my, s * mx + c * my, mz
            for (qx, qy, qz), (nx, ny, nz) in zip(map_points.tolist(), map_normals.tolist(), strict=True):
                cosine = ax * nx + ay * ny + az * nz
                w = max(0.0, cosine) if is_signed else abs(cosine)
                if weighting == "one" or (mx, my, mz) == (0.0, 0.0, 0.0):
                    w = {"cosine": 0.5, "published": 0.0, "one": 1.0}[weighting]
                for iy, dy in enumerate(space.offsets):
                    for ix, dx in enumerate(space.offsets):
                        if max(abs(x + dx - qx), abs(y + dy - qy), abs(z - qz)) <= threshold:
                            moments[h, iy, ix] += [1.0, w * nx * nx, w * nx * ny, w * ny * ny]
    return moments


@given(
    SEEDS, st.integers(0, 4), st.integers(0, 6), st.sampled_from([0.5, 1.0]),
    st.floats(-math.pi, math.pi), st.booleans(), st.sampled_from(list(Weighting)),
)  # fmt: skip
def test_pairs_are_equation_2(seed, n_scan, n_map, share, heading, is_signed, weighting):
    cell = 0.0625
    scan, map_points, map_normals = random_pairs(seed, n_scan, n_map, cell)
    # 0.01 off the grid, so that rounding decides nothing
    prior = Pose(0.01, -0.01, 0.001, 0.0, 0.0, heading)
    space = SearchSpace(3 * cell, cell, 0.5, 0.5)
    options = {"is_signed": is_signed, "weighting": weighting}
    accumulator = reference.pairs(scan, map_points, map_normals, prior, space, threshold=share * cell, **options)
    wanted = triple_loop(scan, map_points, map_normals, prior, space, share * cell, **options)
    np.testing.assert_array_equal(accumulator.moments[..., 0], wanted[..., 0])
    np.testing.assert_allclose(accumulator.moments, wanted, atol=1e-6)


def test_the_threshold_itself_still_matches():
    cell = 0.0625
    space = SearchSpace(2 * cell, cell, 0.0, 0.5)
    scan = Scan([[0.0, 0.0, 0.0]], [X])
    counts = {}
    for share in (0.5, 1.0):
        accumulator = reference.pairs(scan, [[0.0, 0.0, share * cell]], [X], HERE, space, threshold=share * cell)
        counts[share] = accumulator.moments[0, ..., 0]
    # l-infinity: with the cell edge a pair votes for 3 x 3 cells, with half of it for one.
    np.testing.assert_array_equal(counts[1.0], [[0, 0, 0, 0], [0, 1, 1, 1], [0, 1, 1, 1], [0, 1, 1, 1]])
    np.testing.assert_array_equal(counts[0.5], [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]])
    accumulator = reference.pairs(scan, [[0.0, 0.0, 1.01 * cell]], [X], HERE, space, threshold=cell)
    assert not accumulator.moments.any()


@given(SEEDS, st.integers(0, 10), st.integers(1, 12))
def test_voxels_are_pairs_where_map_points_are_voxel_centres(seed, n_scan, n_map):
    """The two models agree where the rasterized map has moved no point."""
    cell = 0.0625
    rng = np.random.default_rng(seed)
    scan, _, normals = random_pairs(seed, n_scan, n_map, cell)
    centres = np.unique((rng.integers(-6, 7, (n_map, 3)) * [1, 1, 0] + 0.5) * cell, axis=0)
    repeats = rng.integers(1, 4, len(centres))
    map_points = np.repeat(centres, repeats, axis=0)
    map_normals = np.repeat(normals[: len(centres)], repeats, axis=0)
    prior = Pose(cell / 32, cell / 32, cell / 64, 0.0, 0.0, 0.0)
    space = SearchSpace(6 * cell, cell, 0.0, 0.5)
    point_map = PointMap.from_points(map_points, map_normals, cell)
    for multiplicity in MULTIPLICITIES:
        pairs = reference.pairs(
            scan, map_points, map_normals, prior, space, threshold=cell / 2, multiplicity=multiplicity
        )
        voxels = reference.voxels(scan, point_map, prior, space, multiplicity=multiplicity)
        np.testing.assert_array_equal(pairs.moments[..., 0], voxels.moments[..., 0])
        np.testing.assert_allclose(pairs.moments, voxels.moments, atol=1e-5)


# --- what a match adds ---
def matches(n_scan, n_map, *, is_signed=True, **options):
    """Moments of scan and map points with these normals in one voxel, by both models."""
    scan, places = Scan([[0.03] * 3] * len(n_scan), n_scan), [[0.03] * 3] * len(n_map)
    threshold = {"threshold": CELL / 2, "is_signed": is_signed}
    pairs = reference.pairs(scan, places, n_map, HERE, ONE_CELL, **threshold, **options).moments
    point_map = PointMap.from_points(places, n_map, CELL, is_signed=is_signed)
    voxels = reference.voxels(scan, point_map, HERE, ONE_CELL, **options).moments
    np.testing.assert_allclose(pairs, voxels, atol=1e-6)
    return pairs[0, 0, 0]


@pytest.mark.parametrize(("n_scan", "n_map", "is_signed", "weight"), [
    (X, X, True, 1.0),
    ([-1.0, 0.0, 0.0], X, True, 0.0),  # the back of a wall is counted but constrains nothing
    ([-1.0, 0.0, 0.0], X, False, 1.0),
    (SLANTED, X, True, 0.6),
    (SLANTED, SLANTED, True, 1.0),  # a roof constrains x by the square of its level part
    ([0.0, 0.0, 0.0], X, True, 0.5),  # no scan normal: the mean of the cosine over a half space
    ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], True, 0.0),  # no direction of the observation either
    (X, [0.0, 0.0, 0.0], True, 0.0),  # no map normal
])  # fmt: skip
def test_the_weight_is_the_cosine_between_the_normals(n_scan, n_map, is_signed, weight):
    expected = [1.0, weight * n_map[0] ** 2, 0.0, 0.0]
    np.testing.assert_allclose(matches([n_scan], [n_map], is_signed=is_signed), expected, atol=1e-6)


@pytest.mark.parametrize("weighting", ["cosine", "one"])
@pytest.mark.parametrize(("multiplicity", "n"), [("points", 7), ("occupied", 1)])
def test_a_voxel_of_many_points_by_hand(weighting, multiplicity, n):
    """7 map points in one voxel, 2 scan points whose normals are 0 and 60 degrees off the map's."""
    normals = [X, [0.5, math.sqrt(0.75), 0.0]]
    moments = matches(normals, [X] * 7, multiplicity=multiplicity, weighting=weighting)
    np.testing.assert_allclose(moments, [2 * n, n * (1.5 if weighting == "cosine" else 2.0), 0.0, 0.0], atol=1e-6)


def test_once_takes_opposite_normals_for_the_same_where_sides_mean_nothing():
    """Map normals of no side may point either way; they must not cancel."""
    normals = [[0.0, 0.0, 0.0], X, [-1.0, 0.0, 0.0]]
    moments = matches([X], normals, multiplicity="occupied", is_signed=False)
    np.testing.assert_allclose(moments, [1.0, 1.0, 0.0, 0.0], atol=1e-6)


def test_the_prior_turns_and_raises_the_scan():
    """Roll, pitch and z come from the prior; headings turn about the sensor (D2)."""
    pose = Pose(10.0, -4.0, 1.5, 0.1, -0.2, 2.0)
    place = np.array([[13.03, -2.97, 2.13]])
    normal = np.array([[0.6, 0.0, 0.8]])
    scan = Scan((place - pose.position) @ pose.rotation, normal @ pose.rotation)
    prior = Pose(10.0 - 2 * CELL, -4.0 + CELL, 1.5, 0.1, -0.2, 2.0 + math.radians(0.5))
    space = SearchSpace(4 * CELL, CELL, 1.0, 0.5)
    for accumulator in (
        reference.pairs(scan, place, normal, prior, space, threshold=CELL / 2),
        reference.voxels(scan, PointMap.from_points(place, normal, CELL), prior, space),
    ):
        np.testing.assert_allclose(accumulator.moments[1, 4 - 1, 4 + 2], [1.0, 0.36, 0.0, 0.0], atol=1e-6)


# --- nothing to match, and what is refused ---
@pytest.mark.parametrize(("points", "normals", "options", "error", "words"), [
    (np.zeros((1, 3)), [X], {"weighting": 1}, OptionError, "'cosine', 'published' or 'one', got 1"),
    (np.zeros((3, 5)), np.zeros((3, 5)), {}, ArrayError, r"`points_map` .*\(n, 3\), got \(3, 5\)\. Transpose it\?"),
    (np.zeros((2, 3)), [X, [2.0, 0.0, 0.0]], {}, ArrayError, r"unit normals in `normals_map` .*length 2 in row 1"),
])  # fmt: skip
def test_what_pairs_refuse(points, normals, options, error, words):
    with pytest.raises(error, match=words):
        reference.pairs(Scan([[0.0, 0.0, 0.0]], [X]), points, normals, HERE, SMALL, threshold=CELL, **options)


def test_a_cell_of_an_open_space_is_one_of_the_map():
    point_map, one = PointMap.from_points([[0.03] * 3], [X], CELL), Scan(np.zeros((1, 3)), np.zeros((1, 3)))
    prior = Pose(0.03, 0.03, 0.03, 0.0, 0.0, 0.0)
    assert reference.consensus_set(one, point_map, prior, SearchSpace(0.0), (20, 0, 0)).tolist() == [True]
