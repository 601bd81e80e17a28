# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Gauss-Markov errors: their spread, their memory and their bounds."""

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.simulation import GnssErrors


@pytest.fixture(scope="module")
def long_errors():
    return GnssErrors().draw(200_000, 0.1, 0)


def test_spread_of_each_error(long_errors):
    x, y, z, roll, pitch, heading = long_errors.std(axis=0)
    assert x == pytest.approx(1.17, rel=0.06)
    assert y == pytest.approx(1.17, rel=0.06)
    assert z == pytest.approx(0.0146, rel=0.06)
    assert np.degrees(heading) == pytest.approx(0.6, rel=0.06)
    np.testing.assert_allclose(np.degrees([roll, pitch]), 0.05, rtol=0.06)


def test_no_error_is_beyond_its_bound(long_errors):
    worst = np.abs(long_errors).max(axis=0)
    assert (worst <= GnssErrors().bounds).all()
    assert (worst > 0.95 * GnssErrors().bounds).all()
    assert worst[0] < 3.0  # the paper's search range


def test_errors_are_remembered_for_20_s(long_errors):
    heading = long_errors[:, 5]
    for wait in (1.0, 20.0, 40.0):
        lag = round(wait / 0.1)
        found = np.corrcoef(heading[:-lag], heading[lag:])[0, 1]
        assert found == pytest.approx(np.exp(-wait / 20.0), abs=0.06)
    assert np.abs(np.diff(long_errors[:, 0])).max() < 0.8  # no jumps, at the bounds neither


def test_axes_know_nothing_of_each_other(long_errors):
    correlations = np.corrcoef(long_errors.T)
    assert np.abs(correlations - np.eye(6)).max() < 0.1


def test_what_follows_changes_nothing():
    errors = GnssErrors()
    np.testing.assert_array_equal(errors.draw(50, 0.1, 7), errors.draw(3001, 0.1, 7)[:50])
    assert not np.array_equal(errors.draw(50, 0.1, 8), errors.draw(50, 0.1, 7))


@pytest.mark.parametrize("wrong", [{"offset": 0.0}, {"correlation_time": 0.0}, {"heading_bound_deg": 0.1}])
def test_wrong_errors_are_refused(wrong):
    with pytest.raises(OptionError, match=r"Expected standard deviations .* Leave them out"):
        GnssErrors(**wrong)
