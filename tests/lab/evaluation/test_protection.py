# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Regions of the Stanford diagram, by epochs placed by hand."""

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import ALERT_LIMIT, ProtectionCounts, upper_bound

ERRORS = [0.05, -0.1, 0.2, -0.5, 0.1, 0.9, 3.0, np.nan]
LEVELS = [0.10, 0.10, 0.1, 0.10, 0.4, 0.4, np.nan, np.nan]


def test_each_epoch_lies_in_one_region():
    found = ProtectionCounts.of(ERRORS, LEVELS)
    assert found == ProtectionCounts(n_nominal=2, n_misleading=1, n_hazardous=1, n_large=2, n_withheld=2)
    assert (found.n_epochs, found.n_used, found.n_unavailable, found.n_exceeded) == (8, 4, 4, 2)
    assert found.exceeded_bound == upper_bound(2, 4)
    assert found.hazardous_bound == upper_bound(1, 4)


def test_the_alert_limit_is_that_of_local_streets_and_may_be_another():
    assert ALERT_LIMIT == 0.29
    found = ProtectionCounts.of(ERRORS, LEVELS, alert_limit=1.0)
    assert found == ProtectionCounts(n_nominal=3, n_misleading=3, n_hazardous=0, n_large=0, n_withheld=2)


def test_an_epoch_is_as_bad_as_its_worst_direction():
    errors = [[0.05, 0.05], [0.05, 0.2], [0.2, 0.5], [0.05, 0.05], [0.05, 0.05]]
    levels = [[0.10, 0.10], [0.10, 0.1], [0.1, 0.1], [0.10, 0.40], [0.10, np.nan]]
    found = ProtectionCounts.of(errors, levels)
    assert found == ProtectionCounts(n_nominal=1, n_misleading=1, n_hazardous=1, n_large=1, n_withheld=1)


def test_no_epoch_has_no_region():
    found = ProtectionCounts.of([], [])
    assert (found.n_epochs, found.exceeded_bound) == (0, 1.0)


def test_wrong_levels_are_refused():
    with pytest.raises(ArrayError, match=r"one shape \(n,\) or \(n, m\), got \(1,\) and \(2,\)"):
        ProtectionCounts.of([0.1], [0.1, 0.2])
    with pytest.raises(OptionError, match="`alert_limit` above 0 m, got 0"):
        ProtectionCounts.of([0.1], [0.1], alert_limit=0.0)
