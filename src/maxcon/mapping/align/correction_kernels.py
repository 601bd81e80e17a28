# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Compiled: points moved by the corrections of their passes and times. Arrays in, arrays out."""

import numpy as np

from maxcon._system.kernel_cache import njit


@njit(nogil=True, cache=True)
def _rotated(x, y, z, a, b, c):
    """Vector (x, y, z) turned by a rotation vector (a, b, c), rad (Rodrigues)."""
    square = a * a + b * b + c * c
    once, twice = 1.0, 0.5
    if square > 1e-12:
        angle = np.sqrt(square)
        once, twice = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    ux, uy, uz = b * z - c * y, c * x - a * z, a * y - b * x
    vx, vy, vz = b * uz - c * uy, c * ux - a * uz, a * uy - b * ux
    return x + once * ux + twice * vx, y + once * uy + twice * vy, z + once * uz + twice * vz


@njit(nogil=True, cache=True)
def move(points, times, passes, centres, wholes, starts, steps, firsts, knot_centres, knots, moved):
    """Move points as `Corrections.motions` says.

    points : (n, 3), global, m; times : (n,), s; passes : (n,), numbers; then the arrays of `Corrections`; moved :
    (n, 3), out, global, m.
    """
    for i in range(points.shape[0]):
        number = passes[i]
        n_knots = firsts[number + 1] - firsts[number]
        at = (times[i] - starts[number]) / steps[number]
        before = min(max(np.int64(np.floor(at)), 0), n_knots - 2)
        part = min(max(at - before, 0.0), 1.0)
        knot = firsts[number] + before
        cx = (1.0 - part) * knot_centres[knot, 0] + part * knot_centres[knot + 1, 0]
        cy = (1.0 - part) * knot_centres[knot, 1] + part * knot_centres[knot + 1, 1]
        cz = (1.0 - part) * knot_centres[knot, 2] + part * knot_centres[knot + 1, 2]
        a, b, c = wholes[number, 3], wholes[number, 4], wholes[number, 5]
        rx, ry, rz = cx - centres[number, 0], cy - centres[number, 1], cz - centres[number, 2]
        tx, ty, tz = _rotated(rx, ry, rz, a, b, c)
        tx += wholes[number, 0] - rx
        ty += wholes[number, 1] - ry
        tz += wholes[number, 2] - rz
        for k in range(2):
            share = part if k == 1 else 1.0 - part
            j = knot + k
            p, q, r = knots[j, 3], knots[j, 4], knots[j, 5]
            rx, ry, rz = cx - knot_centres[j, 0], cy - knot_centres[j, 1], cz - knot_centres[j, 2]
            tx += share * (knots[j, 0] + q * rz - r * ry)
            ty += share * (knots[j, 1] + r * rx - p * rz)
            tz += share * (knots[j, 2] + p * ry - q * rx)
            a += share * p
            b += share * q
            c += share * r
        x, y, z = _rotated(points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz, a, b, c)
        moved[i, 0], moved[i, 1], moved[i, 2] = cx + tx + x, cy + ty + y, cz + tz + z
