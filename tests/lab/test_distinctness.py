"""How distinct a peak is, on accumulators made by hand."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from maxcon import Accumulator, Count, Pose, SearchSpace
from maxcon.errors import ArrayError
from maxcon.lab.distinctness import distinctness, peak_ratio, significant_ray

CELL = 0.06
HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(5 * CELL, CELL, 0.5, 0.5)  # 3 headings of 10 x 10 cells
MIDDLE = (1, 5, 5)
ALONG_Y = (9.0, 0.0, 0.0)
ALONG_X = (0.0, 0.0, 9.0)  # Nxx, Nxy, Nyy of facades along x: they leave x open
ROOT_2 = math.sqrt(2.0)
LAPLACE = np.exp(-ROOT_2 * np.abs(np.arange(-5, 5)))
NO_DIRECTION = ((0.0, 0.0, 0.0), (4.0, 0.0, 4.0))


def made(scores, normal_sums=ALONG_X, space=SPACE):
    """An accumulator whose counts are `scores`, with the same N in each cell."""
    moments = np.zeros((*space.shape, 4))
    moments[..., 0] = scores
    moments[..., 1:] = normal_sums
    return Accumulator(moments, space, HERE)


def row(values):
    """Scores of nothing but one row, y = 0, of the middle heading."""
    scores = np.zeros(SPACE.shape)
    scores[1, 5] = values
    return scores


def measured(scores):
    return distinctness(made(scores), Count())


# --- kurtosis ---
@pytest.mark.parametrize(("values", "wanted"), [
    ([0, 0, 0, 0, 1, 6, 1, 0, 0, 0], 4.0),  # variance 1/4, fourth moment 1/4
    ([0, 0, 1, 0, 0, 6, 0, 0, 1, 0], 4.0),  # wider, but of the same shape
    ([0, 0, 0, 0, 0, 2, 2, 0, 0, 0], 1.0),  # two places
    ([3, 0, 0, 0, 0, 0, 0, 0, 0, 1], 7 / 3),  # about its mean: 1 / (p q) - 3 with p = 1/4
])  # fmt: skip
def test_kurtosis_by_hand(values, wanted):
    assert measured(row(values)).kurtosis == pytest.approx(wanted, rel=1e-12)


# --- divergence ---
def test_divergence_by_hand_also_where_the_laplace_distribution_underflows():
    values = [0, 0, 0, 0, 1, 6, 1, 0, 0, 0]
    total = 1 + 2 * sum(math.exp(-ROOT_2 * k) for k in (1, 2, 3, 4)) + math.exp(-ROOT_2 * 5)
    at_peak, beside = 1 / total, math.exp(-ROOT_2) / total
    wanted = 6 / 8 * math.log(6 / 8 / at_peak) + 2 * (1 / 8 * math.log(1 / 8 / beside))
    assert wanted > 0.05 and measured(row(values)).divergence == pytest.approx(wanted, rel=1e-12)
    assert math.exp(-ROOT_2 * 600) == 0.0
    space = SearchSpace(600 * CELL, CELL, 0.0, 0.5)
    scores = np.zeros(space.shape)
    scores[0, 600, 600], scores[0, 600, 0] = 1.0, 0.5
    found = distinctness(made(scores, space=space), Count())
    wanted = 2 / 3 * math.log(2 / 3) + 1 / 3 * math.log(1 / 3) + 600 * ROOT_2 / 3
    wanted += math.log(1 / math.tanh(ROOT_2 / 2))  # the sum of the density
    assert found.divergence == pytest.approx(wanted, rel=1e-9)


# --- peak ratio and spread ---
def test_the_peak_ratio_is_second_over_highest_beyond_0_3_m():
    scores = row([4.0, 0, 0, 0, 7.9, 8.0, 0, 0, 0, 0])
    scores[2, 5, 9] = 6.0  # 0.24 m away, at another heading
    assert measured(scores).peak_ratio == 0.0  # on the radius itself it does not count
    scores[0, 0, 0] = 3.0
    assert measured(scores).peak_ratio == 3.0 / 8.0


def test_a_slope_is_no_second_best_and_without_a_score_there_is_no_ratio():
    """Cells beyond the guard radius that only lead up to the peak are no candidates of their own."""
    space = SearchSpace(0.6, 0.06, 0.0)
    y, x = np.mgrid[:20, :20]
    scores = 20.0 - np.hypot(y - 10, x - 10)[None]
    assert peak_ratio(scores, (0, 10, 10), space, 0.3) == 0.0
    scores[0, 0, 0], scores[0, 1, 1] = 14.0, 15.0  # the corner is a slope of its neighbour
    assert peak_ratio(scores, (0, 10, 10), space, 0.3) == 15.0 / 20.0
    with np.errstate(all="raise"):
        for each in (np.zeros(space.shape), np.eye(20)[None]):
            assert peak_ratio(each, (0, 0, 3), space, 0.3) == math.inf


@pytest.mark.parametrize(("others", "wanted"), [
    ([], 0.0),
    ([((1, 5, 6), 9.0)], CELL),  # 90 % themselves reach it
    ([((1, 5, 6), 8.99)], 0.0),
    ([((0, 1, 8), 9.5), ((1, 5, 4), 9.5)], 5 * CELL),  # 3 and 4 cells away, at another heading
    ([((2, 5, 5), 9.9)], 0.0),  # the same place at another heading
    ([((1, 0, 0), 10.0)], 5 * ROOT_2 * CELL),
])  # fmt: skip
def test_the_spread_is_the_farthest_cell_of_90_per_cent(others, wanted):
    scores = np.zeros(SPACE.shape)
    scores[MIDDLE] = 10.0
    for cell, value in others:
        scores[cell] = value
    assert measured(scores).spread == pytest.approx(wanted, abs=1e-12)


# --- where there is little to measure ---
def test_a_peak_alone_one_cell_a_corner_and_no_peak_tell_little():
    found = measured(row([0, 0, 0, 0, 0, 5, 0, 0, 0, 0]))
    assert (found.peak_ratio, found.spread) == (0.0, 0.0) and math.isnan(found.kurtosis)
    assert found.divergence == pytest.approx(math.log(LAPLACE.sum()), rel=1e-12)
    found = distinctness(made(3.0, space=SearchSpace(0.0, CELL, 0.0, 0.5)), Count())
    assert (found.peak_ratio, found.spread) == (0.0, 0.0)
    assert math.isnan(found.kurtosis) and math.isnan(found.divergence)
    scores = np.ones(SPACE.shape)
    scores[1, 0, 0] = 4.0
    accumulator = made(scores, (1.0, 1.0, 1.0))  # along (1, -1)
    assert [part.tolist() for part in significant_ray(accumulator, scores, (1, 0, 0))] == [[0.0], [4.0]]
    found = distinctness(accumulator, Count())
    assert (found.peak_ratio, found.spread) == (0.25, 0.0)
    assert math.isnan(found.kurtosis) and math.isnan(found.divergence)
    assert all(math.isnan(value) for value in dataclasses.astuple(measured(np.zeros(SPACE.shape))))


# --- all four ---
@given(st.integers(0, 2**32), st.sampled_from([2.0**-20, 0.5, 4.0, 2.0**30]))
def test_the_unit_of_the_score_does_not_matter(seed, factor):
    rng = np.random.default_rng(seed)
    scores, normals = rng.random(SPACE.shape), rng.normal(size=2)
    scores[MIDDLE] = 1.5
    accumulator = made(scores, (normals[0] ** 2, normals[0] * normals[1], normals[1] ** 2))
    once = distinctness(accumulator, Count())
    assert distinctness(accumulator, Count(), scores=scores) == once
    assert distinctness(accumulator, Count(), scores=factor * scores) == once
    assert once.divergence >= 0.0 and once.kurtosis >= 1.0
    assert 0.0 <= once.peak_ratio <= 1.0


# --- what is refused ---
@pytest.mark.parametrize(("value", "words"), [
    (-0.5, r"finite scores >= 0 .*got -0\.5 to 8\. Let the objective score 0 where nothing matches"),
    (math.nan, "scores of .* that are numbers, got NaN"),
])  # fmt: skip
def test_scores_that_have_no_shares_are_refused(value, words):
    scores = row(8.0)
    scores[2, 0, 0] = value
    with pytest.raises(ArrayError, match=words):
        distinctness(made(scores), Count())
    with pytest.raises(ArrayError, match=words):
        significant_ray(made(scores), scores, MIDDLE)


# --- the significant ray ---
@pytest.mark.parametrize("cell", [(1, 3, 6), (1, 0, 0), (1, 0, 9), (1, 9, 0), (1, 9, 9)])
def test_the_ray_of_a_street_along_an_axis_is_not_cut_by_rounding_at_the_boundary(cell):
    scores, (_, y, x) = np.arange(300.0).reshape(SPACE.shape), cell
    rays = [(normal_sums, scores[1, y], x) for normal_sums in (ALONG_X, (1.0, 0.0, 9.0))]
    rays += [(normal_sums, scores[1, :, x], y) for normal_sums in (ALONG_Y, (9.0, 0.0, 1.0), *NO_DIRECTION)]
    for normal_sums, wanted, at in rays:
        offsets, along = significant_ray(made(0.0, normal_sums), scores, cell)
        np.testing.assert_array_equal(along, wanted)
        np.testing.assert_allclose(offsets, (np.arange(10) - at) * CELL, atol=1e-15)


@given(st.integers(0, 2**32), st.integers(0, 9), st.integers(0, 9))
def test_the_ray_is_the_eigenvector_of_the_largest_eigenvalue_of_q(seed, iy, ix):
    normals = np.random.default_rng(seed).normal(size=(3, 2))
    normal_matrix = normals.T @ normals
    values, vectors = np.linalg.eigh(np.linalg.inv(normal_matrix))
    assume(values[1] > 1.1 * values[0])
    y, x = (np.broadcast_to(plane, SPACE.shape).astype(float) for plane in np.mgrid[:10, :10])
    accumulator = made(0.0, normal_matrix[[0, 0, 1], [0, 1, 1]])
    offsets, at_x = significant_ray(accumulator, x, (1, iy, ix))  # scores that say where they are
    _, at_y = significant_ray(accumulator, y, (1, iy, ix))
    open_x, open_y = vectors[:, 1] * (1 if vectors[0, 1] > 0 else -1)
    np.testing.assert_allclose(at_x, ix + offsets / CELL * open_x, atol=1e-9)
    np.testing.assert_allclose(at_y, iy + offsets / CELL * open_y, atol=1e-9)
    _, products = significant_ray(accumulator, x * y, (1, iy, ix))  # bilinear in every cell
    np.testing.assert_allclose(products, at_x * at_y, atol=1e-9)
    steps = np.rint(offsets / CELL)
    assert (np.diff(steps) == 1).all()
    for beyond in (steps[0] - 1, steps[-1] + 1):  # it goes on as far as the space
        end_x, end_y = ix + beyond * open_x, iy + beyond * open_y
        assert min(end_x, end_y) < 1e-9 or max(end_x, end_y) > 9 - 1e-9
