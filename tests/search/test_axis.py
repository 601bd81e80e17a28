# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Axes are unit vectors in even steps, each with one at right angles."""

import math

import numpy as np
import pytest

from maxcon.search.axis import N_AXES, Axis


def test_the_nearest_axis_and_the_one_across():
    step = math.pi / N_AXES
    assert Axis.near(0.4 * step) == Axis.near(math.pi) == Axis.near(-math.pi) == Axis(0)
    assert Axis.near(-0.6 * step) == Axis(63)
    for azimuth in np.linspace(-7.0, 7.0, 100):
        axis = Axis.near(azimuth)
        off = (azimuth - axis.number * step + math.pi / 2) % math.pi - math.pi / 2
        assert abs(off) <= step / 2 + 1e-12
        assert np.dot(axis.vector, axis.across.vector) == pytest.approx(0.0, abs=1e-6)
        assert np.linalg.norm(axis.vector) == pytest.approx(1.0, abs=1e-6)
