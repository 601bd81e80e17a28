"""MaximumConsensus, its accumulator and its estimates."""

import gc
import math
import pydoc
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import maxcon
from maxcon import Accumulator, Count, Estimate, Helmert, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status
from maxcon.errors import ArrayError, OptionError
from maxcon.search import Weighting

CELL = 0.06
TRUTH = Pose(5.0, -3.0, 1.5, 0.01, -0.02, 0.7)
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)
EMPTY = np.empty((0, 3))


def corner(noise_deg=0.0, seed=0, density=1):
    """Points and normals of two walls at right angles, 60 and 40 of them scanned, or more, in map axes."""
    rng, n, m = np.random.default_rng(seed), 60 * density, 40 * density
    along_x = np.column_stack([rng.uniform(0, 12, n), np.full(n, 4.03), rng.uniform(0, 3, n)])
    along_y = np.column_stack([np.full(m, 14.03), rng.uniform(-9, 3, m), rng.uniform(0, 3, m)])
    normals = np.concatenate([np.tile([0.0, -1.0, 0.0], (n, 1)), np.tile([-1.0, 0.0, 0.0], (m, 1))])
    normals += rng.normal(size=normals.shape) * math.radians(noise_deg)
    return np.concatenate([along_x, along_y]), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def as_scan(points, normals, pose=TRUTH):
    return Scan((points - pose.position) @ pose.rotation, normals @ pose.rotation)


@pytest.fixture(scope="module")
def points_and_normals():
    return corner()


@pytest.fixture(scope="module")
def point_map(points_and_normals):
    return PointMap.from_points(*points_and_normals, CELL)


@pytest.fixture
def scan(points_and_normals):
    return as_scan(*points_and_normals)


@pytest.fixture(scope="module")
def dense():
    """A scan and a map of walls without gaps: what is adjusted slides along them."""
    points, normals = corner(density=300)
    return as_scan(points[::60], normals[::60]), PointMap.from_points(points, normals, CELL)


def prior_of(cells_x, cells_y, turn_deg):
    return Pose(
        TRUTH.x - cells_x * CELL, TRUTH.y - cells_y * CELL, TRUTH.z,
        TRUTH.roll, TRUTH.pitch, TRUTH.heading - math.radians(turn_deg),
    )  # fmt: skip


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
@pytest.mark.parametrize("objective", [Count(), Helmert()])
@pytest.mark.parametrize("n_threads", [1, 3])
def test_it_finds_the_pose(scan, point_map, multiplicity, objective, n_threads):
    method = MaximumConsensus(SPACE, objective, multiplicity, n_threads, refinement=False)
    estimate = method.localize(scan, point_map, prior_of(4, -7, 0.5))
    assert estimate.status is Status.LOCALIZED and estimate.is_localized
    assert estimate.cell == (3, 10 - 7, 10 + 4)
    np.testing.assert_allclose(estimate.pose.position, TRUTH.position, atol=1e-9)
    assert estimate.pose.heading == pytest.approx(TRUTH.heading)
    assert (estimate.pose.roll, estimate.pose.pitch) == (TRUTH.roll, TRUTH.pitch)
    assert np.isinf(np.diag(estimate.covariance)).all()
    method = MaximumConsensus(SPACE, objective, multiplicity, n_threads)
    refined = method.localize(scan, point_map, prior_of(4, -7, 0.5))
    assert (refined.status, refined.cell, refined.score) == (estimate.status, estimate.cell, estimate.score)
    np.testing.assert_allclose(refined.pose.position, TRUTH.position, atol=1e-3)
    assert 0.0 < np.diag(refined.covariance).max() < np.inf
    assert max(refined.protection_level) < np.inf


def test_the_cofactor_is_the_inverse_of_n_and_the_score_that_of_its_trace(scan, point_map):
    method = MaximumConsensus(SPACE)
    accumulator = method.accumulate(scan, point_map, prior_of(0, 0, 0))
    estimate = method.conclude(accumulator, scan, point_map)
    n_x, n_y = accumulator.moments[estimate.cell][[1, 3]]
    assert n_x >= 38 and n_y >= 58
    np.testing.assert_allclose(estimate.cofactor, np.diag([1 / n_x, 1 / n_y]), rtol=1e-9, atol=1e-12)
    assert estimate.score == pytest.approx(1.0 / np.trace(estimate.cofactor), rel=1e-9)
    assert estimate.helmert_point_error == pytest.approx(math.sqrt(1 / n_x + 1 / n_y), rel=1e-9)
    np.testing.assert_allclose(accumulator.normal_matrix(estimate.cell) @ estimate.cofactor, np.eye(2), atol=1e-9)


def test_a_scan_without_normals_is_localized_but_not_as_published(scan, point_map):
    """As published all its weights are 0; the count stays what it is."""
    bare = Scan(scan.points, np.zeros_like(scan.normals))
    prior = prior_of(4, -7, 0.5)
    published, cosine, one = (MaximumConsensus(SPACE, weighting=name) for name in ("published", "cosine", "one"))
    assert MaximumConsensus(SPACE).weighting is cosine.weighting is Weighting.COSINE
    assert published.localize(bare, point_map, prior).status is Status.UNDETERMINED
    for method in (cosine, one):
        estimate = method.localize(bare, point_map, prior)
        assert (estimate.status, estimate.cell) == (Status.LOCALIZED, (3, 10 - 7, 10 + 4))
        np.testing.assert_array_equal(
            method.accumulate(bare, point_map, prior).moments[..., 0],
            published.accumulate(bare, point_map, prior).moments[..., 0],
        )


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_the_scan_is_thinned_before_the_search(points_and_normals, point_map, search):
    points, normals = points_and_normals
    beside = points + [0.001, 0.001, 0.001]  # in the same cubes, mostly
    scan = as_scan(np.concatenate([points, beside]), np.concatenate([normals, normals]))
    prior = prior_of(4, -7, 0.5)
    default, whole = (MaximumConsensus(SPACE, search=search), MaximumConsensus(SPACE, search=search, thinning=0.0))
    assert default.thinning == 0.25
    thinned = scan.thinned(0.25)
    assert len(thinned) < 120
    estimate = default.localize(scan, point_map, prior)
    by_hand = whole.localize(thinned, point_map, prior)
    assert (estimate.cell, estimate.score, estimate.share, estimate.runner_up) == (
        by_hand.cell, by_hand.score, by_hand.share, by_hand.runner_up,
    )  # fmt: skip
    assert estimate.score < whole.localize(scan, point_map, prior).score
    accumulator = default.accumulate(scan, point_map, prior)
    assert (accumulator.moments == whole.accumulate(thinned, point_map, prior).moments).all()
    assert default.conclude(accumulator, scan, point_map).share == estimate.share


@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
@pytest.mark.parametrize("turn_deg", [-1.5, 1.5])
def test_the_heading_beyond_the_space_is_scored_with_the_same_weights(scan, dense, multiplicity, turn_deg):
    """The true heading is one step past the last; with cosines a scan without normals would score 0 there."""
    bare = Scan(scan.points, np.zeros_like(scan.normals))
    method = MaximumConsensus(SPACE, multiplicity=multiplicity, weighting="one", wider=0.0)
    estimate = method.localize(bare, dense[1], prior_of(0, 0, turn_deg))
    assert estimate.cell[0] == (4 if turn_deg > 0 else 0)
    assert not SPACE.is_at_boundary(estimate.cell) and estimate.status is Status.AT_RIM


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_an_answer_at_the_boundary_is_looked_for_farther_around(dense, search):
    """The true pose lies 4.2 m beyond the space: the wider search finds it, and says that there is no cell of it."""
    scan, point_map = dense
    narrow, wide = (MaximumConsensus(SPACE, search=search, wider=reach) for reach in (0.0, 6.0))
    assert not narrow.localize(scan, point_map, prior_of(-80, 0, 0)).is_localized
    last = narrow.localize(scan, point_map, prior_of(-10, 0, 0))
    assert (last.status, last.cell[2], "Widen" in last.status.explanation) == (Status.AT_RIM, 0, True)
    for cells, column, was_widened in ((-80, None, True), (-10, 0, True), (3, 13, False)):
        estimate = wide.localize(scan, point_map, prior_of(cells, 0, 0))
        assert (estimate.status, estimate.was_widened) == (Status.LOCALIZED, was_widened)
        assert (estimate.cell and estimate.cell[2]) == column
        np.testing.assert_allclose(estimate.pose.position, TRUTH.position, atol=2e-3)


def test_an_answer_in_doubt_is_searched_for_again_twice_as_wide(dense):
    """The true pose lies 9 m off and is turned by 7 degrees: more than the first wider search reaches."""
    scan, point_map = dense
    prior = prior_of(-150, 0, 7.0)
    once, grown = (MaximumConsensus(SPACE, wider=4.0, widest=widest) for widest in (0.0, 16.0))
    assert not once.localize(scan, point_map, prior).is_localized
    estimate = grown.localize(scan, point_map, prior)
    assert (estimate.status, estimate.cell, estimate.was_widened) == (Status.LOCALIZED, None, True)
    np.testing.assert_allclose(estimate.pose.position, TRUTH.position, atol=2e-3)
    assert not replace(grown, wider=0.0).localize(scan, point_map, prior).is_localized
    lost = replace(grown, widest=5.0).localize(scan, point_map, prior)
    assert (lost.is_localized, lost.was_widened) == (False, True)
    assert lost.reason.endswith("searched for up to 5 m around")


@pytest.mark.parametrize(("half_width", "turn_deg", "wider", "widest", "wanted"), [
    (3.0, 2.0, 12.0, 0.0, [(12.0, 4.0)]),
    (3.0, 2.0, 0.0, 24.0, []),
    (1.0, 1.0, 12.0, 24.0, [(12.0, 10.0), (24.0, 20.0)]),
    (1.0, 1.0, 5.0, 24.0, [(5.0, 10.0), (10.0, 20.0), (20.0, 20.0), (24.0, 20.0)]),
    (18.0, 30.0, 12.0, 24.0, [(18.0, 30.0), (24.0, 30.0)]),
    (24.0, 10.0, 12.0, 24.0, [(24.0, 20.0)]),
])  # fmt: skip
def test_wider_spaces_double_until_the_widest(half_width, turn_deg, wider, widest, wanted):
    method = MaximumConsensus(SearchSpace(half_width, heading_half_width_deg=turn_deg), wider=wider, widest=widest)
    spaces = list(method._wider_spaces())
    assert [(space.half_width, space.heading_half_width_deg) for space in spaces] == wanted
    assert all(space.is_open for space in spaces)


@pytest.mark.parametrize("objective", [Count(), Helmert()])
def test_without_a_match_the_prior_is_given_back(scan, point_map, objective):
    no_scan, no_map = Scan(EMPTY), PointMap.from_points(EMPTY, EMPTY, CELL)
    places = [(scan, point_map, TRUTH.translated(by)) for by in ([1000, 0, 0], [0, 0, 99])]
    for a_scan, a_map, prior in (*places, (no_scan, point_map, TRUTH), (scan, no_map, TRUTH), (no_scan, no_map, TRUTH)):
        estimate = MaximumConsensus(SPACE, objective).localize(a_scan, a_map, prior)
        assert (estimate.status, estimate.pose, estimate.score) == (Status.NO_MATCH, prior, 0.0)
        assert np.isinf(np.diag(estimate.cofactor)).all()
    far = MaximumConsensus(SPACE).localize(scan, point_map, TRUTH.translated([5e5, 5e6, 0.0]))
    assert "in its local frame" in far.reason and "no match" in repr(far)


def test_every_status_explains_itself():
    for status in Status:
        assert status.explanation.endswith((".", "?")) and status.value == str(status)


# --- objectives of the user's own ---
def test_an_objective_of_ones_own_needs_no_registration(scan, point_map):
    trace = SimpleNamespace(score=lambda moments: moments[..., 1] + moments[..., 3])
    estimate = MaximumConsensus(SPACE, trace).localize(scan, point_map, prior_of(2, 3, 0.0))
    assert (estimate.cell, estimate.status) == ((2, 10 + 3, 10 + 2), Status.LOCALIZED)
    assert estimate.score == pytest.approx(len(scan.thinned(0.25)), abs=1e-3)
    for dtype in (np.float32, np.int64):  # any type of number
        own = SimpleNamespace(score=lambda moments, dtype=dtype: moments[..., 0].astype(dtype))
        estimate = MaximumConsensus(SPACE, own).localize(scan, point_map, TRUTH)
        assert (estimate.cell, type(estimate.score)) == ((2, 10, 10), float)


# --- what is refused ---
@pytest.mark.parametrize(("options", "words"), [
    ({"multiplicity": "both"}, "Expected `multiplicity` to be 'occupied' or 'points', got 'both'"),
    ({"search": "bbs"}, "Expected `search` to be 'exhaustive' or 'branch-and-bound', got 'bbs'"),
    ({"thinning": -1.0}, "`thinning` to be an edge >= 0 m, got -1.0"),
    ({"wider": math.nan}, "`wider` to be a half width >= 0 m, got nan"),
    ({"widest": -1.0}, "`widest` to be a half width >= 0 m, got -1.0"),
    ({"risk": 0.0}, "`risk` above 0 and below 1, got 0.0"),
])  # fmt: skip
def test_options_that_are_refused(options, words):
    with pytest.raises(OptionError, match=words):
        MaximumConsensus(**options)


def test_moments_that_do_not_fit_are_refused():
    with pytest.raises(ArrayError, match=r"`moments` to have shape \(5, 20, 20, 4\), got \(4, 20, 20, 5\)"):
        Accumulator(np.zeros((4, 20, 20, 5)), SPACE, TRUTH)


# --- scans ---
def test_a_scan_takes_lists_and_estimates_normals_if_it_has_none():
    scan = Scan([[1, 2, 3], [4, 5, 6]], [[1, 0, 0], [0, 0, 0]], time=7)
    assert (len(scan), scan.time, scan.points.dtype) == (2, 7.0, np.float64)
    np.testing.assert_array_equal(scan.normals, [[1, 0, 0], [0, 0, 0]])
    assert Scan(EMPTY).normals.shape == (0, 3)
    assert Scan([[1.0, 2.0, 3.0]]).normals.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(("arguments", "words"), [
    ((np.zeros((2, 3)), np.zeros((1, 3))), "`normals` to have one row per point, 2, got 1"),
    ((np.zeros((1, 3)), [[1.0, 1.0, 0.0]]), r"unit normals in `normals` .*got length 1\.41 in row 0\. Divide"),
    ((np.zeros((1, 3)), None, math.nan), "finite `time` of the scan, got nan"),
])  # fmt: skip
def test_scans_that_are_refused(arguments, words):
    with pytest.raises(ArrayError, match=words):
        Scan(*arguments)


# --- the public face ---
def test_every_public_name_loads_and_help_begins_with_what_it_is_for():
    for name in maxcon.__all__:
        assert getattr(maxcon, name) is not None
    assert dir(maxcon) == maxcon.__all__
    with pytest.raises(AttributeError, match="module 'maxcon' has no attribute 'Nothing'"):
        maxcon.Nothing  # noqa: B018
    assert maxcon.search.exhaustive is not None and Estimate is maxcon.estimate.Estimate
    text = pydoc.plain(pydoc.render_doc(maxcon))
    overview = text[: text.index("PACKAGE CONTENTS")]
    assert [name for name in maxcon.__all__ if not name.startswith("_") and f"`{name}`" not in overview] == []
    assert "numpy.dtype[" not in text and "typing.Any" not in text


@pytest.mark.parametrize("noise_deg", [0.5, 1.0, 2.0])
def test_a_wall_with_noisy_normals_is_still_undetermined(noise_deg):
    """Normals that are off by a degree or two must not pass for surfaces across the street."""
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-9, 9, 60_000), np.full(60_000, 5.01), rng.uniform(0, 4, 60_000)])
    angles = np.radians(noise_deg) * rng.normal(size=len(points))
    normals = np.column_stack([np.sin(angles), -np.cos(angles), np.zeros(len(points))])
    point_map = PointMap.from_points(points, normals)
    scan = Scan(points[:8000], normals[:8000])
    space = SearchSpace(half_width=0.6, heading_half_width_deg=0.5)
    estimate = MaximumConsensus(space).localize(scan, point_map, Pose(0, 0, 0, 0, 0, 0))
    assert estimate.status is Status.UNDETERMINED


@pytest.mark.parametrize("objective", [Helmert(), Count(), maxcon.MaxEigenvalue()])
@pytest.mark.parametrize("multiplicity", ["occupied", "points"])
@pytest.mark.parametrize("offset", [0.0, 0.5, 3.0, 500.0])
def test_both_searches_give_the_same_estimate(objective, multiplicity, offset):
    """Near the truth, at the rim, beyond it and outside the map."""
    points, normals = corner(noise_deg=3.0)
    around = np.repeat(points, 20, axis=0) + np.random.default_rng(1).uniform(-0.02, 0.02, (20 * len(points), 3))
    point_map = PointMap.from_points(around, np.repeat(normals, 20, axis=0))
    scan, prior = as_scan(points, normals), TRUTH.translated([offset, -0.2, 0.0])
    wanted, found = (
        MaximumConsensus(SPACE, objective, multiplicity, search=search).localize(scan, point_map, prior)
        for search in ("exhaustive", "branch-and-bound")
    )
    assert (found.pose, found.cell, found.score) == (wanted.pose, wanted.cell, wanted.score)
    assert (found.status, found.share) == (wanted.status, wanted.share)
    assert (found.cofactor == wanted.cofactor).all() and found.runner_up >= wanted.runner_up
    assert found.runner_up <= max(wanted.runner_up, maxcon.Trust().largest_runner_up)


@pytest.mark.parametrize("search", ["exhaustive", "branch-and-bound"])
def test_memory_does_not_grow_from_epoch_to_epoch(search):
    points, normals = corner(noise_deg=3.0)
    point_map, method = PointMap.from_points(points, normals), MaximumConsensus(SPACE, search=search)

    def held_after(n_epochs):
        for number in range(n_epochs):
            prior = TRUTH.translated([0.01 * (number % 7), 0.0, 0.0])
            assert method.localize(as_scan(points, normals), point_map, prior).score > 0.0
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    held_after(3)
    tracemalloc.start()
    try:
        before = held_after(3)
        assert held_after(20) - before < 40_000  # an accumulator of this space takes 64,000 bytes, a scan 4,800
    finally:
        tracemalloc.stop()
