# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""UncertainPose: a pose with its covariance, moved and adjusted (an extended Kalman filter)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.drive.tracking.motion import Motion, MotionNoise
from maxcon.geometry import Pose, wrap_angle

__all__ = ["UncertainPose"]

PLANAR = [0, 1, 5]
"""x, y and heading among x, y, z, roll, pitch and heading."""


@dataclass(frozen=True, slots=True, eq=False)
class UncertainPose:
    """A pose and how well it is known.

    Parameters
    ----------
    pose : Pose
        T_map_sensor, local frame of the map.
    covariance : array, shape (6, 6)
        Of x, y, z, roll, pitch and heading, map axes, m^2, m rad and rad^2.
    """

    pose: Pose
    covariance: NDArray[np.float64]

    @property
    def planar_covariance(self) -> NDArray[np.float64]:
        """Covariance of x, y and heading, shape (3, 3)."""
        return self.covariance[np.ix_(PLANAR, PLANAR)]

    @property
    def sigma(self) -> float:
        """Standard deviation of the position in the direction that is known worst, m."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))

    def moved(self, motion: Motion, noise: MotionNoise) -> UncertainPose:
        """Return where the sensor is after a motion: the prediction of the filter, F P F' + G Q G'."""
        moved = self.pose @ motion.pose
        rotation = self.pose.rotation
        way = rotation @ motion.pose.position
        cosine, sine = math.cos(self.pose.heading), math.sin(self.pose.heading)
        axes = np.array([rotation[:, 0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])  # of roll, pitch and heading
        by_state = np.eye(6)
        by_state[:3, 3:] = np.cross(axes, way).T
        # Tilts stay where they are while the sensor turns; to first order in the tilt.
        turn = motion.pose.heading
        by_state[3:5, 3:5] = [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
        by_motion = np.eye(6)
        by_motion[:3, :3] = rotation
        covariance = by_state @ self.covariance @ by_state.T + by_motion @ noise.covariance(motion) @ by_motion.T
        return UncertainPose(moved, covariance)

    def adjusted(self, measured: Pose, covariance: NDArray[np.float64]) -> UncertainPose:
        """Return the pose that a measurement of it leaves: the update of the filter, in Joseph's form.

        Parameters
        ----------
        measured : Pose
            Local frame.
        covariance : array, shape (6, 6)
            Of the measurement; what it does not measure has an infinite variance.
        """
        known = np.flatnonzero(np.isfinite(np.diag(covariance)))
        observed = np.eye(6)[known]
        noise = covariance[np.ix_(known, known)]
        gain = np.linalg.solve(observed @ self.covariance @ observed.T + noise, observed @ self.covariance).T
        change = gain @ difference(measured, self.pose)[known]
        left = np.eye(6) - gain @ observed
        pose = Pose(*(self.pose.values + change).tolist())
        return UncertainPose(pose, left @ self.covariance @ left.T + gain @ noise @ gain.T)


def difference(pose: Pose, other: Pose) -> NDArray[np.float64]:
    """x, y, z, roll, pitch and heading of one pose less those of another, shape (6,), m and rad; turns wrapped."""
    values = pose.values - other.values
    values[3:] = [wrap_angle(turn) for turn in values[3:].tolist()]
    return values
