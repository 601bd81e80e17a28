"""Errors and stated certainty, by values computed by hand, by random errors, and by the binomial distribution."""

import dataclasses
import math

import numpy as np
import pytest

from maxcon import Pose
from maxcon.lab import evaluation


# --- errors ---
def _pose(x, y, z=0.0, heading_deg=0.0):
    return Pose(x, y, z, 0.1, -0.1, math.radians(heading_deg))


@pytest.mark.parametrize(("heading", "reference", "wanted"), [(10, 8, 2), (8, 10, -2), (179, -179, -2)])
def test_heading_is_signed_and_takes_the_shorter_way(heading, reference, wanted):
    error = evaluation.pose_error(_pose(0.0, 0.0, 0.0, heading), _pose(0.0, 0.0, 0.0, reference))
    assert math.degrees(error.heading) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(("x", "y", "reference_heading", "along", "across"), [
    (2.0, 1.0, 0.0, 2.0, 1.0),
    (-1.0, 2.0, 90.0, 2.0, 1.0),  # driving north: west is to the left
    (1.0, -2.0, 90.0, -2.0, -1.0),
    (3.0, 0.5, 180.0, -3.0, -0.5),
    (1.0, 1.0, 45.0, math.sqrt(2.0), 0.0),
    (1.0, 0.0, 30.0, math.sqrt(0.75), -0.5),
])  # fmt: skip
def test_along_and_across_are_those_of_the_reference(x, y, reference_heading, along, across):
    reference = _pose(100.0, -50.0, -9.0, reference_heading)
    error = evaluation.pose_error(_pose(100.0 + x, -50.0 + y, 9.0, reference_heading + 1.0), reference)
    assert error.along == pytest.approx(along, abs=1e-12)
    assert error.across == pytest.approx(across, abs=1e-12)
    assert error.distance == pytest.approx(math.hypot(x, y))


@pytest.mark.parametrize(("along", "across", "heading_deg", "wanted"), [
    (0.3, 0.0, 0.0, True), (0.3001, 0.0, 0.0, False), (-0.18, 0.24, 0.0, True), (0.25, 0.25, 0.0, False),
    (0.0, 0.0, -1.0, True), (0.0, 0.0, 1.001, False), (0.31, 0.0, 1.1, False), (math.nan, 0.0, 0.0, False),
])  # fmt: skip
def test_success_is_0_3_m_and_1_degree(along, across, heading_deg, wanted):
    assert evaluation.PoseError(along, across, math.radians(heading_deg)).is_success is wanted


def test_quantiles_are_of_absolute_errors():
    errors = [(-1) ** k * k / 100 for k in range(101)]
    assert evaluation.Quantiles.of(errors) == pytest.approx(evaluation.Quantiles(0.5, 0.95, 0.99, 1.0))
    assert evaluation.Quantiles.of([3.0, 0.0, -1.0]).median == 1.0


def test_quantiles_of_nothing_or_of_nan_are_nan():
    for errors in ([], [0.1, math.nan, 0.2]):
        assert all(math.isnan(value) for value in dataclasses.astuple(evaluation.Quantiles.of(errors)))


# --- what samples prove ---
def at_most(n_found, n_epochs, rate):
    """Probability of at most so many, by the sum of its terms."""
    return sum(math.comb(n_epochs, k) * rate**k * (1.0 - rate) ** (n_epochs - k) for k in range(n_found + 1))


@pytest.mark.parametrize(("n_found", "n_epochs"), [(0, 3), (1, 10), (5, 24), (24, 24), (40, 100)])
def test_the_ends_of_an_interval_have_the_probability_they_shall(n_found, n_epochs):
    low, high = evaluation.clopper_pearson(n_found, n_epochs)
    assert low <= n_found / n_epochs <= high
    if n_found == 0:
        assert low == 0.0
    else:
        assert 1.0 - at_most(n_found - 1, n_epochs, low) == pytest.approx(0.025, abs=1e-9)
    if n_found == n_epochs:
        assert high == 1.0
    else:
        assert at_most(n_found, n_epochs, high) == pytest.approx(0.025, abs=1e-9)


def test_none_of_n_proves_three_over_n():
    assert evaluation.upper_bound(0, 100) == pytest.approx(1.0 - 0.05**0.01)
    assert evaluation.upper_bound(0, 3001) == pytest.approx(3.0 / 3001, rel=0.01)
    assert at_most(2, 60, evaluation.upper_bound(2, 60)) == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize(("rate", "expected"), [(0.01, 299), (0.1, 29), (1e-3, 2995)])
def test_a_small_rate_takes_many_epochs(rate, expected):
    assert evaluation.least_to_prove(rate) == expected
    assert evaluation.upper_bound(0, expected) <= rate < evaluation.upper_bound(0, expected - 1)


# --- errors in sigmas ---
def test_errors_are_counted_within_their_own_sigmas():
    found = evaluation.Coverage.of([0.1, -0.3, 0.5, 9.0, np.nan, 1.0], [0.1, 0.2, 0.2, 1.0, 1.0, np.nan])
    assert (found.n_epochs, found.n_within) == (4, (1, 2, 3)) and found.shares == (0.25, 0.5, 0.75)
    assert found.rms == pytest.approx(math.sqrt((1.0 + 1.5**2 + 2.5**2 + 81.0) / 4.0))
    assert all(low < share < high for share, (low, high) in zip(found.shares, found.intervals, strict=True))


def test_errors_as_predicted_are_within_as_promised():
    generator = np.random.default_rng(7)
    sigmas = generator.uniform(0.01, 0.1, 20_000)
    found = evaluation.Coverage.of(sigmas * generator.standard_normal(20_000), sigmas)
    np.testing.assert_allclose(evaluation.PROMISED, [0.6827, 0.9545, 0.9973], atol=5e-5)
    np.testing.assert_allclose(evaluation.PROMISED_PLANE, [0.3935, 0.8647, 0.9889], atol=5e-5)
    np.testing.assert_allclose(found.shares, evaluation.PROMISED, atol=0.01)
    assert found.rms == pytest.approx(1.0, abs=0.02)
    radii = np.linalg.norm(generator.standard_normal((20_000, 2)), axis=1)
    found = evaluation.Coverage.of(radii, np.ones(20_000))
    np.testing.assert_allclose(found.shares, evaluation.PROMISED_PLANE, atol=0.01)


def test_no_epoch_says_nothing():
    found = evaluation.Coverage.of([np.nan], [1.0])
    assert found.n_epochs == 0 and np.isnan([*found.shares, found.rms]).all()
    assert found.intervals == ((0.0, 1.0),) * 3
    assert evaluation.clopper_pearson(0, 0) == (0.0, 1.0) and evaluation.upper_bound(0, 0) == 1.0
    counts = evaluation.ProtectionCounts.of([], [])
    assert (counts.n_used, counts.exceeded_bound) == (0, 1.0)


# --- the Stanford diagram ---
def test_each_epoch_lies_in_one_region_and_is_as_bad_as_its_worst_direction():
    errors = [[0.05, 0.05], [0.05, 0.2], [0.2, 0.5], [0.05, 0.05], [0.05, 0.05]]
    levels = [[0.10, 0.10], [0.10, 0.1], [0.1, 0.1], [0.10, 0.40], [0.10, np.nan]]
    found = evaluation.ProtectionCounts.of(errors, levels)
    assert found == evaluation.ProtectionCounts(n_nominal=1, n_misleading=1, n_hazardous=1, n_large=1, n_withheld=1)
    assert (found.n_used, found.n_unavailable, found.n_exceeded) == (3, 2, 2)
    assert (found.exceeded_bound, found.hazardous_bound) == (evaluation.upper_bound(2, 3), evaluation.upper_bound(1, 3))
