# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which arrays are points, and which matrices are covariances of x, y and heading."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from maxcon.errors import ArrayError
from maxcon.geometry.arrays import as_points, first_covariance_fault

GOOD = np.diag([1.0, 0.0, 1e-6])


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((3, 7)), r"`points` to have shape \(n, 3\), got \(3, 7\)\. Transpose it\?"),
        ([1.0, 2.0, 3.0], r"to have shape \(n, 3\), got \(3,\)\.$"),
        ([[0.0, 0.0, 0.0], [0.0, math.nan, 0.0]], r"got 1 of 2 rows with NaN or infinity\. Drop those rows"),
        ([["a", "b", "c"]], "to be numbers"),
    ],
)
def test_what_are_no_points_is_refused(points, words):
    with pytest.raises(ArrayError, match=words):
        as_points(points, "points")


@given(
    st_np.arrays(np.float64, (4, 3, 3), elements=st.floats(-1.0, 1.0).map(lambda value: round(value, 9))),
    st.tuples(*[st.floats(1e-4, 1e4)] * 3),
)
def test_what_is_made_of_factors_is_a_covariance(factors, scales):
    factors = factors * np.array(scales)[:, None]
    assert first_covariance_fault(factors @ factors.transpose(0, 2, 1)) is None
    assert first_covariance_fault(factors[:0]) is None


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, np.nan, 0.1]),
        np.diag([1.0, 1.0, -0.1]),
        [[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 0.1]],
        [[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 0.1]],
        [[1e-300, 1e300, 0.0], [1e300, 1e-300, 0.0], [0.0, 0.0, 0.1]],
    ],
)
def test_the_first_that_is_none_is_named(matrix):
    row, words = first_covariance_fault(np.array([GOOD, matrix, matrix]))
    assert row == 1
    assert f"positive semidefinite, got {np.array(matrix).tolist()}" in words
