# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: elevations and azimuths of the points of a scan, as seen from the sensor, and their extremes."""

import numpy as np
from numba import njit

__all__ = ["azimuths_of", "elevations_of", "extremes"]

TAN_PI_8 = np.sqrt(2.0) - 1.0
# (arctan(t) / t - 1) / t^2 as a polynomial in t^2: Chebyshev interpolation up to t = tan(pi / 8); arctan(t) / t is
# off by 5e-18.
ARCTAN = (
    -0.3333333333333333, 0.1999999999999552, -0.14285714284666542, 0.11111111015256361, -0.09090904578123903,
    0.07692183190826087, -0.06664511447381948, 0.0585814891280221, -0.0508544973794026, 0.03923165829558719,
    -0.01917688711906226,
)  # fmt: skip
# pi minus np.pi: what rounding to float64 drops.
PI_REST = 1.2246467991473532e-16


@njit(nogil=True, cache=True, error_model="numpy")
def _angle(y, x):
    """arctan2(y, x), rad, with a relative error of up to 4e-16; no branch and no call, so that loops are vectorized."""
    height, width = abs(y), abs(x)
    is_high = height > width
    small, large = (width, height) if is_high else (height, width)
    is_steep = small > TAN_PI_8 * large
    numerator = small - large if is_steep else small
    denominator = small + large if is_steep else large
    t = numerator / (denominator if denominator > 0.0 else 1.0)
    square = t * t
    polynomial = 0.0
    for k in range(len(ARCTAN)):
        polynomial = polynomial * square + ARCTAN[len(ARCTAN) - 1 - k]
    angle = t + t * square * polynomial
    angle = 0.25 * np.pi + (angle + 0.25 * PI_REST) if is_steep else angle
    turned = np.copysign(angle, x)
    from_x = np.pi + (turned + PI_REST) if np.copysign(1.0, x) < 0.0 else turned
    angle = 0.5 * np.pi - (turned - 0.5 * PI_REST) if is_high else from_x
    return np.copysign(angle, y)


@njit(nogil=True, cache=True, error_model="numpy")
def elevations_of(coordinates):
    """Elevation of each point above the xy plane, (n,), rad.

    coordinates : (3 n,) float64, sensor frame: x, y, z of the first point, then those of the second, and so on.
    """
    elevations = np.empty(len(coordinates) // 3)
    for i in range(len(elevations)):
        x, y = coordinates[3 * i], coordinates[3 * i + 1]
        elevations[i] = _angle(coordinates[3 * i + 2], np.sqrt(x * x + y * y))
    return elevations


@njit(nogil=True, cache=True, error_model="numpy")
def azimuths_of(coordinates):
    """Azimuth of each point, (n,), rad from +x, -pi to pi; coordinates as for `elevations_of`."""
    azimuths = np.empty(len(coordinates) // 3)
    for i in range(len(azimuths)):
        azimuths[i] = _angle(coordinates[3 * i + 1], coordinates[3 * i])
    return azimuths


@njit(nogil=True, cache=True, fastmath={"nnan", "nsz"})
def extremes(values):
    """Return the smallest and the largest of `values`, (n,), n > 0, finite."""
    lowest, highest = values[0], values[0]
    for value in values:
        lowest = value if value < lowest else lowest
        highest = value if value > highest else highest
    return lowest, highest
