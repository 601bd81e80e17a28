# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""FiringScanner: a VLP-16 whose lasers fire one after the other while it turns, with the timing of its packets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.sensing.ray_caster import Caster
from maxcon.lab.simulation.sensing.scanners import Echoes, RotatingScanner

__all__ = ["BLOCK_STEP_DEG", "BLOCK_TIME", "FIRING_TIME", "LASER_TIME", "FiringScanner"]

BLOCK_TIME, FIRING_TIME, LASER_TIME = 110.592e-6, 55.296e-6, 2.304e-6
"""Time from one block of a packet to the next, from one firing of all lasers to the next, from laser to laser, s."""
BLOCK_STEP_DEG = 0.4
"""Rotation from one block to the next: 900 blocks make a turn of 99.5 ms."""


@dataclass(frozen=True, slots=True)
class FiringScanner(RotatingScanner):
    """A VLP-16 at ten turns a second, with the direction of each laser when it fires, and the height of its beam.

    It turns clockwise, seen from above. As for any `RotatingScanner`, scans are free of ego-motion.

    Notes
    -----
    Lasers fire in the order -15, 1, -13, 3, ... degrees; one shot of each of the 16 is a firing. Their beams leave the
    scanner at heights that fall with the elevation, from 11.2 mm above its middle (-15 degrees) to as much below it.
    """

    @property
    def order(self) -> NDArray[np.int64]:
        """Place of each layer in the order of a firing, from 0, lowest layer first, shape (16,)."""
        return np.concatenate([np.arange(0, 16, 2), np.arange(1, 16, 2)])

    @property
    def heights(self) -> NDArray[np.float64]:
        """Where the beam of each layer leaves the scanner, above its middle, shape (16,), m."""
        return (
            np.array([11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7, -0.7, -2.2, -3.7, -5.1, -6.6, -8.1, -9.7, -11.2]) / 1e3
        )

    @property
    def lags_deg(self) -> NDArray[np.float64]:
        """How far the scanner turns from the beginning of a firing until each layer's shot, shape (16,), degrees."""
        return np.asarray(self.order * (LASER_TIME / BLOCK_TIME * BLOCK_STEP_DEG), dtype=np.float64)

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit rays of one turn in the sensor frame, firing by firing, shape (n_columns * 16, 3)."""
        clockwise = np.radians((np.arange(self.n_columns) * self.azimuth_step_deg)[:, None] + self.lags_deg)
        level, up = np.cos(self.elevations), np.sin(self.elevations)
        rays = np.stack(
            [level * np.cos(clockwise), -level * np.sin(clockwise), np.broadcast_to(up, clockwise.shape)], axis=2
        )
        return rays.reshape(-1, 3)

    def scan(self, caster: Caster, pose: Pose, time: float, rng: np.random.Generator) -> Echoes:
        """Return one scan from `pose` (T_city_sensor) at `time` (s)."""
        directions = self.directions @ pose.rotation.T
        origins = pose.position + np.tile(self.heights, self.n_columns)[:, None] * pose.rotation[:, 2]
        return self.range_finder.measure(caster, origins, directions, np.full(len(directions), time), rng)
