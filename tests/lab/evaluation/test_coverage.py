# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors in sigmas, by values computed by hand and by errors drawn as they were predicted."""

import math

import numpy as np
import pytest

from maxcon.errors import ArrayError
from maxcon.lab.evaluation import PROMISED, PROMISED_PLANE, Coverage, MeanSquare


def test_errors_are_counted_within_their_own_sigmas():
    found = Coverage.of([0.1, -0.3, 0.5, 9.0, np.nan, 1.0], [0.1, 0.2, 0.2, 1.0, 1.0, np.nan])
    assert (found.n_epochs, found.n_within) == (4, (1, 2, 3))
    assert found.shares == (0.25, 0.5, 0.75)
    assert found.rms == pytest.approx(math.sqrt((1.0 + 1.5**2 + 2.5**2 + 81.0) / 4.0))
    assert found.median == pytest.approx(2.0)
    assert all(low < share < high for share, (low, high) in zip(found.shares, found.intervals, strict=True))


def test_errors_as_predicted_are_within_as_promised():
    generator = np.random.default_rng(7)
    sigmas = generator.uniform(0.01, 0.1, 20_000)
    found = Coverage.of(sigmas * generator.standard_normal(20_000), sigmas)
    np.testing.assert_allclose(found.shares, PROMISED, atol=0.01)
    assert found.rms == pytest.approx(1.0, abs=0.02)
    radii = np.linalg.norm(generator.standard_normal((20_000, 2)), axis=1)
    np.testing.assert_allclose(Coverage.of(radii, np.ones(20_000)).shares, PROMISED_PLANE, atol=0.01)


def test_shares_promised_are_those_of_the_normal_distribution():
    np.testing.assert_allclose(PROMISED, [0.6827, 0.9545, 0.9973], atol=5e-5)
    np.testing.assert_allclose(PROMISED_PLANE, [0.3935, 0.8647, 0.9889], atol=5e-5)


def test_no_epoch_says_nothing():
    found = Coverage.of([np.nan], [1.0])
    assert found.n_epochs == 0 and np.isnan([*found.shares, found.rms, found.median]).all()
    assert found.intervals == ((0.0, 1.0),) * 3
    assert np.isnan(MeanSquare.of([np.nan]).mean)


def test_wrong_sigmas_are_refused():
    with pytest.raises(ArrayError, match="sigmas above 0, got 0"):
        Coverage.of([1.0, 1.0], [1.0, 0.0])
    with pytest.raises(ArrayError, match=r"one shape \(n,\), got \(1,\) and \(2,\)"):
        Coverage.of([1.0], [1.0, 1.0])


def test_mean_square_is_halved():
    found = MeanSquare.of([1.0, 2.0, 9.0, np.nan])
    assert (found.n_epochs, found.mean) == (3, 2.0)
    assert found.median == pytest.approx(2.0 / (2.0 * math.log(2.0)))


def test_mean_squares_as_predicted_lie_between_the_limits():
    generator = np.random.default_rng(3)
    squares = (generator.standard_normal((2_000, 40, 2)) ** 2).sum(axis=2)
    found = [MeanSquare.of(drive) for drive in squares]
    inside = np.mean([one.low <= one.mean <= one.high for one in found])
    assert inside == pytest.approx(0.95, abs=0.02)
    assert np.mean([one.median for one in found]) == pytest.approx(1.0, abs=0.03)
