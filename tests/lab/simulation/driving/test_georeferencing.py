# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of the mapping trajectory: 2 cm, smooth, and new in each round."""

import numpy as np

from maxcon.lab.simulation import draw_georeferencing_errors

LONG = draw_georeferencing_errors(1, 1000.0, 101_000.0)


def test_errors_are_2_cm_per_axis():
    offsets = LONG.at(np.arange(1000.0, 101_000.0, 10.0))
    np.testing.assert_allclose(offsets.std(axis=0), 0.02, rtol=0.08)
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=0.003)


def test_errors_are_smooth_and_forgotten_after_a_round():
    times = np.arange(1000.0, 100_000.0, 1.0)
    here, soon, late = (LONG.at(times + wait).ravel() for wait in (0.0, 30.0, 170.0))
    assert np.abs(np.diff(LONG.at(times), axis=0)).max() < 0.004
    assert abs(np.corrcoef(here, soon)[0, 1] - np.exp(-0.25)) < 0.05
    assert abs(np.corrcoef(here, late)[0, 1]) < 0.1


def test_errors_are_seeded():
    times = np.arange(0.0, 60.0)
    first, second, other = (draw_georeferencing_errors(seed, 0.0, 60.0).at(times) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, second)
    assert not np.allclose(first, other)


def test_deviation_can_be_chosen():
    assert (draw_georeferencing_errors(1, 0.0, 100.0, deviation=0.0).offsets == 0.0).all()
