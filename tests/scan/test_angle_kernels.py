# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Angles of a scan against those of numpy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maxcon.scan.window_kernels import azimuths_of, elevations_of, extremes

COORDINATES = st.one_of(
    st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-17, -1e-17, 5e-324, 1e-200, 1e300])
)
VALUES = st.one_of(st.floats(-2.0, 2.0), st.sampled_from([0.1, 0.1 + 1e-16, 0.2, -1.0]), st.floats(-1e-9, 1e-9))


@given(arrays(np.float64, st.tuples(st.integers(0, 40), st.just(3)), elements=COORDINATES))
def test_angles_are_those_of_numpy(points):
    with np.errstate(over="ignore"):
        level = np.sqrt(points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1])
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    for angles, expected in (
        (elevations, np.arctan2(points[:, 2], level)),
        (azimuths, np.arctan2(points[:, 1], points[:, 0])),
    ):
        np.testing.assert_allclose(angles, expected, rtol=5e-16, atol=1e-323)
        np.testing.assert_array_equal(np.signbit(angles), np.signbit(expected))
        assert (np.abs(angles) <= np.pi).all()


def test_angles_all_around():
    true = np.random.default_rng(0).uniform(-np.pi, np.pi, 100_000)
    points = np.column_stack([np.cos(true), np.sin(true), np.zeros(len(true))])
    azimuths = azimuths_of(points.ravel())
    np.testing.assert_allclose(azimuths, np.arctan2(points[:, 1], points[:, 0]), rtol=4e-16, atol=0.0)


@given(arrays(np.float64, st.integers(1, 300), elements=VALUES))
def test_extremes_are_those_of_numpy(values):
    assert extremes(values) == (values.min(), values.max())
