# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Axes are unit vectors in even steps."""

import math

import numpy as np
import pytest

from maxcon.search.bounds import N_AXES, Summand, nearest_axis


def test_the_nearest_axis():
    step = math.pi / N_AXES
    assert nearest_axis(0.4 * step) == nearest_axis(math.pi) == nearest_axis(-math.pi) == 0
    assert nearest_axis(-0.6 * step) == 63
    for azimuth in np.linspace(-7.0, 7.0, 100):
        axis = nearest_axis(azimuth)
        off = (azimuth - axis * step + math.pi / 2) % math.pi - math.pi / 2
        assert abs(off) <= step / 2 + 1e-12
        across = Summand((axis + N_AXES // 2) % N_AXES)
        assert np.dot(Summand(axis).vector, across.vector) == pytest.approx(0.0, abs=1e-6)
        assert np.linalg.norm(Summand(axis).vector) == pytest.approx(1.0, abs=1e-6)
