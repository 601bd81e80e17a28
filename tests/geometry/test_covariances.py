# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which matrices are covariances of x, y and heading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from maxcon.geometry.covariances import first_covariance_fault

GOOD = np.diag([1.0, 0.0, 1e-6])


@given(st_np.arrays(np.float64, (4, 3, 3), elements=st.floats(-1.0, 1.0)), st.tuples(*[st.floats(1e-4, 1e4)] * 3))
def test_what_is_made_of_factors_is_a_covariance(factors, scales):
    factors = factors * np.array(scales)[:, None]
    assert first_covariance_fault(factors @ factors.transpose(0, 2, 1)) is None


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1.0, np.nan, 0.1]), "finite numbers"),
        (np.diag([1.0, 1.0, -0.1]), "variances >= 0 on the diagonal of a covariance, got -0.1"),
        ([[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 0.1]], "symmetric"),
        ([[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 0.1]], "positive semidefinite"),
        ([[1e-300, 1e300, 0.0], [1e300, 1e-300, 0.0], [0.0, 0.0, 0.1]], "positive semidefinite"),
    ],
)
def test_the_first_that_is_none_is_named(matrix, words):
    fault = first_covariance_fault(np.array([GOOD, matrix, matrix]))
    assert fault.row == 1
    assert words in fault.words


def test_none_of_none():
    assert first_covariance_fault(np.empty((0, 3, 3))) is None
