# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The windows that are tried first, for layouts of which it is known how far their rings are apart."""

import numpy as np
import pytest

from maxcon.geometry.window_kernels import BANDS, WINDOWS, first_windows


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
    rings = np.concatenate(
        [[-25.0, -22.0, -19.0, -16.0, -13.0], np.arange(-4.0, 4.0, 0.33), [8.0, 11.0, 14.0]]
    )
    found = windows_tried_first(*ring_scan(rings))
    middle = np.linspace(rings.min(), rings.max(), BANDS)
    assert (found[np.abs(middle) < 3.0] <= 0.9).all()
    sparse = np.isin(np.arange(BANDS), ((rings[:4] - rings.min()) / np.ptp(rings) * BANDS).astype(int))
    assert (found[sparse] >= 2.9).all()


def test_a_lone_ring_and_points_in_one_direction_get_the_highest_window():
    for elevations, azimuths in (
        ring_scan([3.0]),
        (np.zeros(5_000), np.zeros(5_000)),
        (np.ones(1), np.ones(1)),
    ):
        assert (windows_tried_first(elevations, azimuths) == np.degrees(WINDOWS[-1])).all()


def test_the_order_of_points_does_not_matter():
    elevations, azimuths = ring_scan(np.linspace(-15.0, 15.0, 16), smear_deg=0.1)
    order = np.random.default_rng(1).permutation(len(elevations))
    np.testing.assert_array_equal(
        windows_tried_first(elevations, azimuths), windows_tried_first(elevations[order], azimuths[order])
    )
