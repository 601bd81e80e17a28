# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Quaternions (x, y, z, w), as trajectories hold them, from and to roll, pitch and heading, by scipy."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quaternions_from_angles(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> NDArray[np.float64]:
    """Return unit quaternions (x, y, z, w), shape (..., 4), of Rz(heading) Ry(pitch) Rx(roll), angles in rad (D2)."""
    from scipy.spatial.transform import Rotation

    angles = np.stack(np.broadcast_arrays(heading, pitch, roll), axis=-1)
    quaternions = Rotation.from_euler("ZYX", angles.reshape(-1, 3)).as_quat()
    return np.asarray(quaternions.reshape(*angles.shape[:-1], 4), dtype=np.float64)


def angles_from_quaternions(quaternions_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Roll, pitch and heading, shape (..., 3), rad, of unit quaternions (x, y, z, w), shape (..., 4).

    Pitch is in [-pi/2, pi/2]. Where it is +-pi/2, roll and heading turn about the same axis: roll is 0 there.
    """
    from scipy.spatial.transform import Rotation

    quaternions = np.asarray(quaternions_xyzw, dtype=np.float64)
    R = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()
    level = np.hypot(R[:, 0, 0], R[:, 1, 0])
    is_vertical = level < 1e-9
    roll = np.where(is_vertical, 0.0, np.arctan2(R[:, 2, 1], R[:, 2, 2]))
    heading = np.where(is_vertical, np.arctan2(-R[:, 0, 1], R[:, 1, 1]), np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    angles = np.stack([roll, np.arctan2(-R[:, 2, 0], level), heading], axis=-1)
    return np.asarray(angles.reshape(*quaternions.shape[:-1], 3), dtype=np.float64)
