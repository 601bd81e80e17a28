# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Angles of a scan against numpy, and windows tried first, for layouts of which it is known how far rings are apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maxcon.scan import window_kernels as rules
from maxcon.scan.window_kernels import BANDS, WINDOWS, azimuths_of, elevations_of, extremes, first_windows

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


def windows_tried_first(elevations_deg, azimuths_deg):
    elevations, azimuths = np.radians(elevations_deg), np.radians(azimuths_deg)
    first = np.full(BANDS, -1)
    lowest = first_windows(elevations, azimuths, elevations.min(), elevations.max(), first)
    assert lowest == first.min()
    assert first.max() < len(WINDOWS)
    return np.degrees(WINDOWS)[first]


def ring_scan(rings_deg, step_deg=0.2, smear_deg=0.0):
    azimuths = np.arange(-180.0, 180.0, step_deg)
    elevations, azimuths = (grid.ravel() for grid in np.meshgrid(rings_deg, azimuths, indexing="ij"))
    return elevations + np.random.default_rng(0).normal(0.0, smear_deg, len(elevations)), azimuths


@pytest.mark.parametrize("smear_deg", [0.0, 0.02])
@pytest.mark.parametrize("spacing_deg", [0.5, 1.0, 1.3, 2.0, 4.0])
def test_a_window_reaches_the_next_ring_and_not_much_further(spacing_deg, smear_deg):
    found = windows_tried_first(*ring_scan(np.arange(-16.0, 15.0, spacing_deg), smear_deg=smear_deg))
    assert (found >= spacing_deg - 4 * smear_deg).all()
    assert np.median(found) <= 1.7 * max(spacing_deg, 0.5)


def test_bands_of_sparse_rings_get_higher_windows():
    rings = np.concatenate([[-25.0, -22.0, -19.0, -16.0, -13.0], np.arange(-4.0, 4.0, 0.33), [8.0, 11.0, 14.0]])
    found = windows_tried_first(*ring_scan(rings))
    middle = np.linspace(rings.min(), rings.max(), BANDS)
    assert (found[np.abs(middle) < 3.0] <= 0.9).all()
    sparse = np.isin(np.arange(BANDS), ((rings[:4] - rings.min()) / np.ptp(rings) * BANDS).astype(int))
    assert (found[sparse] >= 2.9).all()


def window_of(elevations, k, width):
    """Number of the lowest window around one of some elevations, rad, with points enough, of more than one ring."""
    for number, reach in enumerate(WINDOWS):
        inside = elevations[np.abs(elevations - elevations[k]) <= reach]
        is_enough = len(inside) >= 3 and len(inside) * reach / width >= rules.LEAST_NEIGHBOURS
        if is_enough and inside.std() >= rules.LEAST_SPREAD * reach:
            return number
    return len(WINDOWS)


def window_for_most(windows):
    """Number of the window that is high enough for FIRST_SHARE of a sample; the highest if there is none."""
    shares = [(windows <= number).sum() > rules.FIRST_SHARE * len(windows) for number in range(len(WINDOWS) - 1)]
    return shares.index(True) if any(shares) else len(WINDOWS) - 1


def windows_by_definition(elevations, azimuths):
    """Numbers of the windows tried first in each band, from a sample of strips of azimuth."""
    n_columns = min(max(len(elevations) // rules.STRIP_POINTS, 8), rules.MOST_COLUMNS)
    columns = np.minimum((azimuths + np.pi) / (2.0 * np.pi) * n_columns, n_columns - 1).astype(int)
    sample, windows = [], []
    for column in range(0, n_columns, -(-n_columns // rules.MOST_STRIPS)):
        strip = np.sort(elevations[columns == column])
        step = 1 + len(strip) // (8 * rules.STRIP_POINTS)
        strip = strip[::step]
        sample.extend(strip)
        windows.extend(window_of(strip, k, 2.0 * np.pi / n_columns / step) for k in range(len(strip)))
    share = (np.array(sample) - elevations.min()) / max(np.ptp(elevations), 1e-9)
    bands, windows = np.minimum((share * BANDS).astype(int), BANDS - 1), np.array(windows)
    overall = window_for_most(windows)
    in_bands = [windows[bands == band] for band in range(BANDS)]
    return [max(overall, window_for_most(band)) if len(band) >= rules.LEAST_VOTES else overall for band in in_bands]


@given(
    st.integers(0, 2**32), st.integers(1, 3000), st.sampled_from([0, 1, 8, 16, 64]), st.sampled_from([0.0, 1e-4, 3e-3]),
    st.sampled_from([0.02, 0.3, np.pi]),
)  # fmt: skip
def test_windows_are_as_defined(seed, n, n_rings, smear, half_width):
    """Without rings, elevations lie anyhow."""
    rng = np.random.default_rng(seed)
    rings = rng.uniform(-0.4, 0.3, n_rings) if n_rings else rng.uniform(-0.4, 0.3, n)
    elevations = rng.choice(rings, n) + rng.normal(0.0, smear, n)
    azimuths = rng.uniform(-half_width, half_width, n)
    first = np.full(BANDS, -1)
    first_windows(elevations, azimuths, elevations.min(), elevations.max(), first)
    assert first.tolist() == windows_by_definition(elevations, azimuths)
