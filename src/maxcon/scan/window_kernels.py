"""Compiled: directions of a scan's points, and a first guess of how high a window around one must be for two rings."""

import numpy as np

from maxcon._system.kernel_cache import njit

# Half heights of windows, rad, lowest first: they suit scanners of 128 rings to those of eight.
GROWTH = 1.6
WINDOWS = tuple(np.radians(0.5 * GROWTH**k) for k in range(6))
N_WINDOWS = len(WINDOWS)
# Windows that find only one ring grow, up to this half height, rad.
HIGHEST = 0.12
# A plane needs so many points, and more than one ring: a deviation across the rings of this share of the half height.
LEAST_NEIGHBOURS = 6
LEAST_SPREAD = 0.22
# The rings of some scanners are denser in the middle: each of so many bands of elevation has a first window of its
# own, if at least LEAST_VOTES points are sampled in it.
BANDS = 32
LEAST_VOTES = 16
# Directions are sampled in at most so many strips of azimuth, of about so many points each.
MOST_STRIPS = 20
STRIP_POINTS = 64
MOST_COLUMNS = 4096
# The window that is high enough for this share of the sample is tried first.
FIRST_SHARE = 0.4

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


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def elevations_of(coordinates):
    """Elevation of each point above the xy plane, (n,), rad, of coordinates (3 n,), point by point."""
    elevations = np.empty(len(coordinates) // 3)
    for i in range(len(elevations)):
        x, y = coordinates[3 * i], coordinates[3 * i + 1]
        elevations[i] = _angle(coordinates[3 * i + 2], np.sqrt(x * x + y * y))
    return elevations


@njit(nogil=True, cache=True)
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


@njit(nogil=True, cache=True)
def _collect_strips(elevations, azimuths):
    """Elevations sampled in strips of azimuth, strip by strip; first of each strip, (n_strips + 1,); its width, rad."""
    n_columns = min(max(len(azimuths) // STRIP_POINTS, 8), MOST_COLUMNS)
    every = (n_columns + MOST_STRIPS - 1) // MOST_STRIPS
    n_strips = (n_columns + every - 1) // every
    strips = np.empty(len(azimuths), np.int32)
    starts = np.zeros(n_strips + 2, np.int64)
    for i in range(len(azimuths)):
        column = min(int((azimuths[i] + np.pi) / (2.0 * np.pi) * n_columns), n_columns - 1)
        strips[i] = column // every if column % every == 0 else n_strips
        starts[strips[i] + 1] += 1
    for strip in range(n_strips + 1):
        starts[strip + 1] += starts[strip]
    places, collected = starts.copy(), np.empty(starts[n_strips])
    for i in range(len(azimuths)):
        if strips[i] < n_strips:
            collected[places[strips[i]]] = elevations[i]
            places[strips[i]] += 1
    return collected, starts[: n_strips + 1], 2.0 * np.pi / n_columns


@njit(nogil=True, cache=True)
def _window_of(elevations, k, width):
    """Return the number of the lowest window around the k-th elevation with more than one ring; N_WINDOWS for none."""
    # It is as wide as half its height: the points of a strip, `width` (rad) wide, stand for those of the window.
    low, high = k, k
    total, square = 0.0, 0.0
    for window in range(N_WINDOWS):
        reach = WINDOWS[window]
        while low > 0 and elevations[k] - elevations[low - 1] <= reach:
            low -= 1
            offset = elevations[low] - elevations[k]
            total, square = total + offset, square + offset * offset
        while high + 1 < len(elevations) and elevations[high + 1] - elevations[k] <= reach:
            high += 1
            offset = elevations[high] - elevations[k]
            total, square = total + offset, square + offset * offset
        count = high + 1 - low
        mean = total / count
        if count < 3 or count * reach / width < LEAST_NEIGHBOURS:
            continue
        if square / count - mean * mean >= (LEAST_SPREAD * reach) ** 2:
            return window
    return N_WINDOWS


@njit(nogil=True, cache=True)
def _low_window(votes):
    """Return the number of the lowest window that is high enough for FIRST_SHARE of the votes (N_WINDOWS + 1,)."""
    so_far, total = 0, votes.sum()
    for window in range(N_WINDOWS - 1):
        so_far += votes[window]
        if so_far > FIRST_SHARE * total:
            return window
    return N_WINDOWS - 1


@njit(nogil=True, cache=True)
def first_windows(elevations, azimuths, lowest, highest, first):
    """Write the number of the window to try first in each of BANDS bands of elevation (rad); return the lowest."""
    collected, starts, width = _collect_strips(elevations, azimuths)
    votes = np.zeros((BANDS, N_WINDOWS + 1), np.int64)
    for strip in range(len(starts) - 1):
        ascending = np.sort(collected[starts[strip] : starts[strip + 1]])
        # Thousands of points in one strip are thinned: the time grows with their square.
        step = 1 + len(ascending) // (8 * STRIP_POINTS)
        ascending = ascending[::step]
        for k in range(len(ascending)):
            band = int((ascending[k] - lowest) / max(highest - lowest, 1e-9) * BANDS)
            votes[min(band, BANDS - 1), _window_of(ascending, k, width / step)] += 1
    overall = _low_window(votes.sum(axis=0))
    for band in range(BANDS):
        is_enough = votes[band].sum() >= LEAST_VOTES
        first[band] = max(overall, _low_window(votes[band])) if is_enough else overall
    return overall
