# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What so many epochs prove, against the binomial distribution itself; Wilson's interval, by hand and its equation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.errors import OptionError
from maxcon.lab.evaluation import clopper_pearson, least_to_prove, upper_bound, wilson_interval


def at_most(n_found, n_epochs, rate):
    """Probability of at most so many, by the sum of its terms."""
    return sum(math.comb(n_epochs, k) * rate**k * (1.0 - rate) ** (n_epochs - k) for k in range(n_found + 1))


@pytest.mark.parametrize(("n_found", "n_epochs"), [(0, 3), (1, 10), (5, 24), (24, 24), (40, 100)])
def test_the_ends_of_an_interval_have_the_probability_they_shall(n_found, n_epochs):
    low, high = clopper_pearson(n_found, n_epochs)
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
    assert upper_bound(0, 100) == pytest.approx(1.0 - 0.05**0.01)
    assert upper_bound(0, 3001) == pytest.approx(3.0 / 3001, rel=0.01)
    assert at_most(2, 60, upper_bound(2, 60)) == pytest.approx(0.05, abs=1e-9)


def test_no_epoch_proves_nothing():
    assert clopper_pearson(0, 0) == (0.0, 1.0)
    assert upper_bound(0, 0) == 1.0


@pytest.mark.parametrize(("rate", "expected"), [(0.01, 299), (0.1, 29), (1e-3, 2995)])
def test_a_small_rate_takes_many_epochs(rate, expected):
    assert least_to_prove(rate) == expected
    assert upper_bound(0, expected) <= rate < upper_bound(0, expected - 1)


def test_impossible_counts_are_refused():
    with pytest.raises(OptionError, match="from 0 to 3 of 3 epochs, got 4"):
        clopper_pearson(4, 3)
    with pytest.raises(OptionError, match="`confidence` above 0 and below 1, got 1"):
        clopper_pearson(1, 3, 1.0)
    with pytest.raises(OptionError, match=r"`confidence` above 0\.5 and below 1, got 0\.5\."):
        upper_bound(1, 3, 0.5)
    with pytest.raises(OptionError, match="`rate` above 0 and below 1, got 0"):
        least_to_prove(0.0)


def test_wilson_interval_of_95_percent():
    low, high = wilson_interval([8], [10])
    assert (low[0], high[0]) == (pytest.approx(0.4902, abs=5e-5), pytest.approx(0.9433, abs=5e-5))


@pytest.mark.filterwarnings("error")
def test_wilson_interval_of_no_trials_is_unknown():
    assert np.isnan(wilson_interval([0], [0])).all()


@given(st.integers(1, 4000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_solves_its_equation(case):
    k, n = case
    for end in np.concatenate(wilson_interval([k], [n])):
        # The ends are where the observed rate is z standard deviations off: (p - x)^2 = z^2 x (1 - x) / n.
        assert (k / n - end) ** 2 == pytest.approx(1.959963984540054**2 * end * (1 - end) / n, abs=1e-12)
