"""Compiled: the fit of the ground of a scan to that of the map. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit

# Steps with all points, after those from each start.
N_LAST = 3


@njit(nogil=True, cache=True)
def _ground_at(heights, x, y, z):
    """Height nearest to z, bilinear at x, y (cells from the first corner); NaN where less than half is known."""
    left, low = np.floor(x - 0.5), np.floor(y - 0.5)
    total, weights = 0.0, 0.0
    for row in range(2):
        for column in range(2):
            iy, ix = np.int64(low) + row, np.int64(left) + column
            if iy < 0 or iy >= heights.shape[1] or ix < 0 or ix >= heights.shape[2]:
                continue
            weight = (1.0 - abs(y - 0.5 - low - row)) * (1.0 - abs(x - 0.5 - left - column))
            best = np.nan
            for level in range(heights.shape[0]):
                height = heights[level, iy, ix]
                if not (abs(height - z) >= abs(best - z)) and not np.isnan(height):
                    best = height
            if not np.isnan(best):
                total += weight * best
                weights += weight
    return total / weights if weights >= 0.5 else np.nan


@njit(nogil=True, cache=True)
def heights_below(points, heights, corner, edge, position, turn, height, below):
    """Find how far each point lies under the ground of the map; NaN where there is no ground.

    points : (m, 3) float64, tilt applied, about the sensor, m; heights : (levels, ny, nx) float32; corner : (x, y) of
    the first cell, m; edge : of a cell, m; position : of the sensor, (x, y, z), m; turn : cosine and sine of its
    heading; height : the level nearest to the point, raised by this, is its ground, m; below : (m,), out.
    """
    cosine, sine = turn
    for i in range(points.shape[0]):
        z = position[2] + points[i, 2]
        x = (position[0] + cosine * points[i, 0] - sine * points[i, 1] - corner[0]) / edge
        y = (position[1] + sine * points[i, 0] + cosine * points[i, 1] - corner[1]) / edge
        below[i] = _ground_at(heights, x, y, z + height) - z


@njit(nogil=True, cache=True)
def most_frequent(points, below, near, reach, width):
    """Find how far most points near the sensor lie below the ground, m: a median; 0 if there are none.

    points : (m, 3) float64, tilt applied, about the sensor, m; below : (m,), m; near : points farther than this,
    horizontally, are left out, m; reach : also those more than this below or above the ground, m; width : of a bin, m.
    The fullest bin is looked for with its two neighbours on both sides, weighted 1, 2, 3, 2, 1; the median is that of
    the points in these five.
    """
    counts = np.zeros(np.int64(np.round(2.0 * reach / width)) + 1 + 4)  # with two empty ones at both ends
    some = np.empty(points.shape[0])
    n = 0
    for i in range(points.shape[0]):
        if np.hypot(points[i, 0], points[i, 1]) <= near and abs(below[i]) <= reach:
            some[n] = below[i]
            n += 1
            counts[np.int64((below[i] + reach) / width) + 2] += 1.0
    if n == 0:
        return 0.0
    fullest, most = 0, -1.0
    for k in range(counts.shape[0] - 4):
        around = counts[k] + 2.0 * counts[k + 1] + 3.0 * counts[k + 2] + 2.0 * counts[k + 3] + counts[k + 4]
        if around > most:
            fullest, most = k, around
    middle = (fullest + 0.5) * width - reach
    in_bins = some[:n][np.abs(some[:n] - middle) <= 2.5 * width]
    return np.median(in_bins)


@njit(nogil=True, cache=True, fastmath={"reassoc", "contract"})
def _sums(x, y, below, square, plane):
    """What points agree on a plane by, and the sums of their normal equations; arguments as of `_step`."""
    agreed, offset, slope_x, slope_y = 0.0, plane[0], plane[1], plane[2]
    n00, n01, n02, n11, n12, n22, r0, r1, r2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(x.shape[0]):
        off = below[i] - offset - slope_x * x[i] - slope_y * y[i]
        weight = square / (square + off * off)
        agreed += weight
        weight *= weight
        weight_x, weight_y, weight_off = weight * x[i], weight * y[i], weight * off
        n00 += weight
        n01 += weight_x
        n02 += weight_y
        n11 += weight_x * x[i]
        n12 += weight_x * y[i]
        n22 += weight_y * y[i]
        r0 += weight_off
        r1 += weight_off * x[i]
        r2 += weight_off * y[i]
    return agreed, (n00 + 1e-9, n01, n02, n11, n12, n22), (r0, r1, r2)


@njit(nogil=True, cache=True)
def _step(x, y, below, square, stiffness, plane, normal):
    """One step of reweighted least squares towards the plane; returns what the points have agreed by before it."""
    agreed, (n00, n01, n02, n11, n12, n22), (r0, r1, r2) = _sums(x, y, below, square, plane)
    agreed -= 0.5 * stiffness * (plane[1] ** 2 + plane[2] ** 2) / square
    n11, n22, r1, r2 = n11 + stiffness, n22 + stiffness, r1 - stiffness * plane[1], r2 - stiffness * plane[2]
    normal[0, 0], normal[0, 1], normal[0, 2], normal[1, 1], normal[1, 2], normal[2, 2] = n00, n01, n02, n11, n12, n22
    normal[1, 0], normal[2, 0], normal[2, 1] = n01, n02, n12
    # Elimination, of the height first: the matrix is positive definite.
    over_x, over_y = n01 / n00, n02 / n00
    n11, n12, n22 = n11 - over_x * n01, n12 - over_x * n02, n22 - over_y * n02
    r1, r2 = r1 - over_x * r0, r2 - over_y * r0
    slope_y = (r2 - n12 / n11 * r1) / (n22 - n12 / n11 * n12)
    slope_x = (r1 - n12 * slope_y) / n11
    plane[0] += r0 / n00 - over_x * slope_x - over_y * slope_y
    plane[1] += slope_x
    plane[2] += slope_y
    return agreed


@njit(nogil=True, cache=True)
def fit_planes(points, below, starts, scales, stiffness, stride, plane, cofactors):
    """Fit the plane (height, slope along x, slope along y) to add to the points so that most lie on the ground.

    From each start by reweighted least squares with Geman and McClure's weights, whose scale goes down step by step:
    what lies far off the rest has no weight in the end. The plane that most points agree on is taken.
    points : (m, 3) float64, tilt applied, about the sensor, m; below : (m,), how far each lies under the ground, m;
    starts : (s, 3) float64; scales : (k,), m; stiffness : weight that holds the slopes at 0, in cells m^2; stride : of
    so many points one is looked at before the last steps; plane : (3,), out; cofactors : (3, 3), out, inverse of the
    normal matrix of the last step.
    """
    x, y = points[:, 0].copy(), points[:, 1].copy()
    some_x, some_y, some_below = x[::stride].copy(), y[::stride].copy(), below[::stride].copy()
    here, trial = np.empty((3, 3)), np.empty(3)
    most = -np.inf
    for start in range(starts.shape[0]):
        trial[:] = starts[start]
        agreed = 0.0
        for scale in scales:
            agreed = _step(some_x, some_y, some_below, scale * scale, stiffness / stride, trial, here)
        if agreed > most:
            most = agreed
            plane[:] = trial
    for _ in range(N_LAST):
        _step(x, y, below, scales[-1] * scales[-1], stiffness, plane, here)
    cofactors[:] = np.linalg.inv(here)
