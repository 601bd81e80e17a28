# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Angles, quantiles and histograms of a scan against those of numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maxcon.geometry.angle_kernels import azimuths_of, count_in_bins, elevations_of, extremes, quantiles

COORDINATES = st.one_of(
    st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-17, -1e-17, 5e-324, 1e-200, 1e300])
)
VALUES = st.one_of(
    st.floats(-2.0, 2.0), st.sampled_from([0.1, 0.1 + 1e-16, 0.2, -1.0]), st.floats(-1e-9, 1e-9)
)


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


@given(arrays(np.float64, st.integers(1, 300), elements=VALUES), st.floats(0.0, 1.0))
def test_quantiles_are_those_of_numpy_to_the_last_digit(values, share):
    shares = np.array([share, 0.0, 0.005, 0.5, 0.995, 1.0])
    np.testing.assert_array_equal(quantiles(values, shares), np.quantile(values, shares))
    assert extremes(values) == (values.min(), values.max())


@pytest.mark.parametrize("n", [5_000, 30_000])
def test_quantiles_of_many_values_that_are_nearly_the_same(n):
    rng = np.random.default_rng(n)
    rings = np.radians(rng.integers(-8, 8, n) * 2.0 + 1.0)
    for noise in (0.0, 1e-9, 1e-4):
        values = rings + rng.normal(0.0, 1.0, n) * noise
        shares = np.array([0.005, 0.5, 0.995])
        np.testing.assert_array_equal(quantiles(values, shares), np.quantile(values, shares))


@given(arrays(np.float64, st.integers(1, 300), elements=VALUES), st.integers(1, 40), st.data())
def test_histograms_are_those_of_numpy(values, n_bins, data):
    low = data.draw(st.sampled_from([-1.0, 0.1, float(values.min())]))
    high = low + data.draw(st.sampled_from([1e-3, 0.3, 1.1, 2.0]))
    expected, edges = np.histogram(values, n_bins, (low, high))
    np.testing.assert_array_equal(count_in_bins(values, edges), expected)
    on_edges = np.concatenate([edges, values])
    np.testing.assert_array_equal(
        count_in_bins(on_edges, edges), np.histogram(on_edges, n_bins, (low, high))[0]
    )
