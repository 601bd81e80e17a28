# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a cell is worth: values, shapes, and what holds for all moments."""

import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from searches import SEEDS, OwnObjective

from maxcon import Count, Helmert, MaxEigenvalue, MaximumConsensus
from maxcon.errors import ArrayError, OptionError
from maxcon.search.objectives import OBJECTIVES, Checked, as_objective

VALUES = st.floats(-1e12, 1e12) | st.sampled_from([0.0, 1e-300, -1e-300, 1e-30, 5e-324, 1.0, 2.0**-24, 1e100])


def moments_of(normals, weights):
    """Count, Nxx, Nxy, Nyy of matches with these normals (n, 2) and weights (n,)."""
    x, y = np.asarray(normals, float).reshape(-1, 2).T
    w = np.asarray(weights, float)
    return np.array([len(w), (w * x * x).sum(), (w * x * y).sum(), (w * y * y).sum()])


def directions(seed, n, spread=np.pi):
    angles = np.random.default_rng(seed).uniform(-spread, spread, n)
    return np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize(
    ("moments", "count", "score", "eigenvalue"),
    [
        ([0, 0, 0, 0], 0, 0.0, 0.0), ([5, 2, 0, 3], 5, 1.2, 2.0), ([5, 3, 0, 2], 5, 1.2, 2.0),
        ([10, 5, 0, 5], 10, 2.5, 5.0), ([4, 2, 1, 2], 4, 0.75, 1.0), ([4, 2, -1, 2], 4, 0.75, 1.0),
        ([7, 7, 0, 0], 7, 0.0, 0.0), ([7, 3.5, 3.5, 3.5], 7, 0.0, 0.0), ([7, 0, 0, 0], 7, 0.0, 0.0),
    ],
)  # fmt: skip
def test_values_by_hand(moments, count, score, eigenvalue):
    moments = np.array(moments, float)
    assert Count().score(moments) == count
    assert Helmert().score(moments) == pytest.approx(score, rel=1e-12)
    assert MaxEigenvalue().score(moments) == pytest.approx(eigenvalue, rel=1e-12)


@given(SEEDS, st.integers(2, 60))
def test_they_are_what_the_paper_defines(seed, n):
    """1 / tr(Q) and 1 / max(lambda of Q), with Q the inverse of N; in the axes of N the bound is hardly more."""
    moments = moments_of(directions(seed, n), np.random.default_rng(seed).uniform(0.05, 1.0, n))
    normal_matrix = moments[[1, 2, 2, 3]].reshape(2, 2)
    least, most = np.linalg.eigvalsh(normal_matrix)
    assume(least >= 1e-5 * most)
    cofactor = np.linalg.inv(normal_matrix)
    helmert, smallest = Helmert().score(moments), MaxEigenvalue().score(moments)
    assert helmert == pytest.approx(1.0 / np.trace(cofactor), rel=1e-9)
    assert smallest == pytest.approx(1.0 / np.linalg.eigvalsh(cofactor)[1], rel=1e-9)
    assert smallest == pytest.approx(least, rel=1e-9)
    assert smallest / 2 * (1 - 1e-9) <= helmert <= smallest * (1 + 1e-9)
    assert helmert <= moments[0] / 4 + 1e-9  # all unit matches, half of them each way
    for objective, score in ((Helmert(), helmert), (MaxEigenvalue(), smallest)):
        bound = objective.bound_by_axes(np.array(least), np.array(most))
        assert score * (1.0 + 0.5e-9) <= bound <= score * (1.0 + 2e-9)


@given(SEEDS, st.integers(1, 40), st.floats(-10, 10))
def test_turning_the_map_changes_no_score(seed, n, angle):
    rng = np.random.default_rng(seed)
    normals, weights = directions(seed, n), rng.uniform(0.0, 1.0, n)
    c, s = np.cos(angle), np.sin(angle)
    before, after = moments_of(normals, weights), moments_of(normals @ [[c, s], [-s, c]], weights)
    for objective in OBJECTIVES:
        np.testing.assert_allclose(objective.score(after), objective.score(before), rtol=1e-7, atol=1e-5 * n)


@given(SEEDS, st.integers(0, 30), st.integers(0, 30))
def test_more_matches_never_lower_a_score(seed, n, n_more):
    """N grows in the Loewner order (design, section 3, fact 1)."""
    rng = np.random.default_rng(seed)
    normals, weights = directions(seed, n + n_more), rng.uniform(0.0, 1.0, n + n_more)
    fewer, more = moments_of(normals[:n], weights[:n]), moments_of(normals, weights)
    for objective in OBJECTIVES:
        assert objective.score(more) >= objective.score(fewer) * (1.0 - 1e-9) - 2e-6 * (n + n_more)


@given(SEEDS, st.floats(-np.pi, np.pi), st.integers(1, 100_000))
def test_one_direction_however_often_scores_nothing(seed, angle, n):
    """Summed as the search sums: float32 products, rounded to multiples of 2^-24."""
    x, y = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    weights = np.random.default_rng(seed).uniform(0.0, 1.0, n).astype(np.float32).astype(np.float64)
    sums = [(np.rint(weights * float(p) * 2.0**24) / 2.0**24).sum() for p in (x * x, x * y, y * y)]
    moments = np.array([n, *sums])
    if moments[1] + moments[3] < 0.1:
        return  # a few hundred-thousandths of a match: rounding alone
    assert Helmert().score(moments) == 0.0
    assert MaxEigenvalue().score(moments) == 0.0


@given(hnp.arrays(np.float64, hnp.array_shapes(max_dims=2, max_side=6).map(lambda s: (*s, 4)), elements=VALUES))
def test_never_nan_and_never_a_warning(moments):
    """Count, Nxx and Nyy are sums of what is never negative; Nxy may be anything."""
    moments = np.where([True, True, False, True], np.abs(moments), moments)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for objective in OBJECTIVES:
            scores = objective.score(moments)
            assert scores.shape == moments.shape[:-1]
            assert scores.dtype == np.float64
            assert not np.isnan(scores).any()
            assert (scores >= 0.0).all()


@pytest.mark.parametrize(
    ("along", "across", "helmert_bound", "least"),
    [(2.0, 3.0, 1.2, 2.0), (0.3, 0.3, 0.15, 0.3), (0.0, 4.0, 0.0, 0.0), (4.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)],
)  # fmt: skip
def test_bounds_by_hand(along, across, helmert_bound, least):
    pair = np.array([along]), np.array([across])
    with np.errstate(all="raise"):
        assert Helmert().bound_by_axes(*pair) == pytest.approx([helmert_bound], rel=2e-9)
        assert MaxEigenvalue().bound_by_axes(*pair) == pytest.approx([least], rel=2e-9)
    assert Count().bound_by_count(np.array([along])) == [along]


@given(
    SEEDS, st.integers(1, 60), st.none() | st.floats(-np.pi, np.pi),
    st.sampled_from([0.0, 1e-3]) | st.floats(0.0, np.pi),
)  # fmt: skip
def test_bounds_hold_for_scores_as_they_are_computed_in_any_axes(seed, n, azimuth, spread):
    """Nearly singular, where the rounding of scores is at its largest, and in the axes of N, the tightest, too."""
    moments = moments_of(directions(seed, n, spread), np.random.default_rng(seed).uniform(0.0, 1.0, n))
    _, xx, xy, yy = moments
    azimuth = 0.5 * np.arctan2(2.0 * xy, xx - yy) if azimuth is None else azimuth
    c, s = np.cos(azimuth), np.sin(azimuth)
    along, across = c * c * xx + 2 * c * s * xy + s * s * yy, s * s * xx - 2 * c * s * xy + c * c * yy
    along, across = max(along, 0.0), max(across, 0.0)  # sums of what is never negative, but for rounding
    for objective in (Helmert(), MaxEigenvalue()):
        bound = objective.bound_by_axes(np.array([along]), np.array([across]))
        assert bound >= objective.score(moments)
        never_lower = bound * (1.0 - 1e-12)  # but for the last bits, of which the bound has more to spare
        assert objective.bound_by_axes(np.array([1.5 * along]), np.array([across])) >= never_lower
        assert objective.bound_by_axes(np.array([along]), np.array([1.5 * across])) >= never_lower
    assert Count().bound_by_count(moments[:1]) >= Count().score(moments)


@pytest.mark.parametrize("objective", [Count(), Helmert(), MaxEigenvalue()])
def test_objectives_are_told_by_name_and_two_of_a_kind_are_the_same(objective):
    assert as_objective(objective.name) == objective == type(objective)()
    assert as_objective(objective) is objective
    assert {objective: 1}[type(objective)()] == 1


@pytest.mark.parametrize("wrong", ["Helmert", "", "helmert ", 3, None, Helmert])
def test_what_is_no_objective_is_refused(wrong):
    with pytest.raises(OptionError, match=r"'count', 'helmert', 'max-eigenvalue' or an object with `score"):
        as_objective(wrong)
    with pytest.raises(OptionError, match="`objective`"):
        MaximumConsensus(objective=wrong)


@pytest.mark.parametrize(
    ("score", "words"),
    [
        (lambda moments: moments, r"shape \(2, 3\), got \(2, 3, 4\)"),
        (lambda moments: moments[..., 0].sum(axis=0), r"shape \(2, 3\), got \(3,\)"),
        (lambda moments: np.where([[1, 1, 1], [1, 0, 1]], 1.0, np.nan), "numbers, got NaN"),
        (lambda moments: np.full((2, 3), -1e-300), "0 or more .* got -1e-300"),
        (lambda moments: np.array([[5, 4, 3], [2, 1, -7]]), "0 or more .* got -7"),
    ],
)
def test_scores_that_are_not_are_refused(score, words):
    with pytest.raises(ArrayError, match=words):
        Checked(OwnObjective(score)).score(np.ones((2, 3, 4)))
