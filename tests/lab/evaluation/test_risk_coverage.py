# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rates of wrong answers in the order of trust, by hand."""

import numpy as np
import pytest

from maxcon.errors import ArrayError
from maxcon.lab.evaluation import RiskCoverage, clopper_pearson


def test_trusted_answers_go_first_and_each_by_its_runner_up():
    found = RiskCoverage.of(
        is_right=[True, False, True, False, True, False],
        is_answer=[True, True, True, True, True, False],
        is_trusted=[True, True, True, False, False, False],
        runner_up=[0.5, 0.7, 0.2, 0.1, np.nan, np.nan],
    )
    np.testing.assert_array_equal(found.n_accepted, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(found.n_wrong, [0, 0, 1, 2, 2])
    np.testing.assert_allclose(found.shares, np.arange(1, 6) / 6.0)
    np.testing.assert_allclose(found.rates, [0.0, 0.0, 1 / 3, 0.5, 0.4])
    assert (found.n_epochs, found.n_trusted, found.n_trusted_wrong) == (6, 3, 1)
    assert found.trusted_interval == clopper_pearson(1, 3)


def test_answers_of_equal_trust_are_accepted_together():
    nothing = [np.nan] * 4
    found = RiskCoverage.of([True, False, True, False], [True] * 4, [True, True, False, False], nothing)
    np.testing.assert_array_equal(found.n_accepted, [2, 4])
    np.testing.assert_array_equal(found.n_wrong, [1, 2])


def test_the_word_of_the_method_is_a_place_of_the_order():
    generator = np.random.default_rng(2)
    right, answered, trusted = (generator.random((3, 200)) < [[0.9], [0.95], [0.8]])[:3]
    found = RiskCoverage.of(right, answered, trusted, generator.random(200))
    place = np.searchsorted(found.n_accepted, found.n_trusted)
    assert (found.n_accepted[place], found.n_wrong[place]) == (found.n_trusted, found.n_trusted_wrong)


def test_without_answers_there_is_no_order():
    found = RiskCoverage.of([False], [False], [False], [np.nan])
    assert (found.n_epochs, len(found.rates), found.n_trusted) == (1, 0, 0)


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ArrayError, match=r"four arrays of one shape \(n,\), got \(1,\), \(1,\), \(1,\) and \(2,\)"):
        RiskCoverage.of([True], [True], [True], [0.1, 0.2])
