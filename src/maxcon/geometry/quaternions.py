# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Quaternions (x, y, z, w), as trajectories hold them, from and to roll, pitch and heading."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["angles_from_quaternions", "product", "quaternions_from_angles", "slerp"]


def quaternions_from_angles(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> NDArray[np.float64]:
    """Return unit quaternions (x, y, z, w), shape (..., 4), of Rz(heading) Ry(pitch) Rx(roll), angles in rad (D2)."""
    halves = np.broadcast_arrays(*(np.asarray(angle, dtype=np.float64) / 2.0 for angle in (roll, pitch, heading)))
    (cr, cp, ch), (sr, sp, sh) = np.cos(halves), np.sin(halves)
    return np.stack(
        [
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
            cr * cp * ch + sr * sp * sh,
        ],
        axis=-1,
    )


def angles_from_quaternions(quaternions_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Roll, pitch and heading, shape (..., 3), rad, of unit quaternions (x, y, z, w), shape (..., 4).

    Notes
    -----
    Pitch is in [-pi/2, pi/2]. Where it is +-pi/2, roll and heading turn about the same axis: roll is 0 there.
    """
    x, y, z, w = np.moveaxis(np.asarray(quaternions_xyzw, dtype=np.float64), -1, 0)
    forward_x, forward_y = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w)
    level = np.hypot(forward_x, forward_y)
    pitch = np.arctan2(2.0 * (y * w - x * z), level)
    is_vertical = level < 1e-9
    roll = np.where(is_vertical, 0.0, np.arctan2(2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)))
    upright = np.arctan2(2.0 * (z * w - x * y), 1.0 - 2.0 * (x * x + z * z))
    heading = np.where(is_vertical, upright, np.arctan2(forward_y, forward_x))
    return np.stack([roll, pitch, heading], axis=-1)


def slerp(first: NDArray[np.float64], second: NDArray[np.float64], part: float) -> NDArray[np.float64]:
    """Return the unit quaternion at `part` (0 to 1) of the shortest arc from `first` to `second`, shape (4,) each."""
    cosine = float(first @ second)
    if cosine < 0.0:  # q and -q are the same orientation; the nearer of the two gives the shorter arc
        second, cosine = -second, -cosine
    if cosine > 1.0 - 1e-10:  # the sine below would vanish; the chord is the arc to 1e-15 here
        mixed = (1.0 - part) * first + part * second
    else:
        arc = math.acos(cosine)
        mixed = math.sin((1.0 - part) * arc) * first + math.sin(part * arc) * second
    return np.asarray(mixed / np.linalg.norm(mixed), dtype=np.float64)


def product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products of quaternions (x, y, z, w), shape (..., 4): they rotate by `second`, then by `first`."""
    (ax, ay, az, aw), (bx, by, bz, bw) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )
