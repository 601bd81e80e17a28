# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Odometry as of wheels and a gyroscope: smooth, in a frame of its own, with an error that grows with distance."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.seed import Seed

__all__ = ["OdometryErrors"]


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Errors of the motions that odometry measures.

    scale: relative error of all distances, 0.01 for 1 %; its sign is drawn at random.
    heading_drift_deg: bias of the gyroscope while the vehicle moves, degrees per second; its sign is drawn at random.
    heading_walk_deg: random walk of the heading: standard deviation, degrees per square root of a metre.
    walk: random walk of the position along each axis: standard deviation, m per square root of a metre.
    tilt_deg: standard deviation of roll and pitch, degrees; gravity keeps them from drifting.
    """

    scale: float = 0.01
    heading_drift_deg: float = 0.05
    heading_walk_deg: float = 0.1
    walk: float = 0.005
    tilt_deg: float = 0.02

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 <= value < math.inf:
                raise OptionError(
                    f"Expected `{field.name}` of odometry errors to be a number >= 0, got {value}. Leave it out?"
                )

    def draw(self, drive: Drive, times: ArrayLike, seed: Seed) -> list[Pose]:
        """Return the poses that odometry gives: the first is at the origin, heading along x.

        drive: the true poses.
        times: shape (n,); times of the poses, s, rising.
        seed: the same seed gives the same errors.
        Returns T_odometry_sensor.
        """
        rng = np.random.default_rng(seed)
        wanted = np.asarray(times, dtype=np.float64)
        positions, angles = drive.at(wanted)
        scale, drift = np.array([self.scale, math.radians(self.heading_drift_deg)]) * rng.choice([-1.0, 1.0], 2)
        steps = np.diff(positions, axis=0)
        ways = np.linalg.norm(steps, axis=1)
        turns = np.diff(angles[:, 2]) + np.where(ways > 0.0, drift, 0.0) * np.diff(wanted)
        turns += math.radians(self.heading_walk_deg) * np.sqrt(ways) * rng.standard_normal(len(ways))
        headings = np.concatenate([[0.0], np.cumsum(turns)])
        cosine, sine = np.cos(headings[:-1] - angles[:-1, 2]), np.sin(headings[:-1] - angles[:-1, 2])
        moved = (1.0 + scale) * steps
        moved += self.walk * np.sqrt(ways)[:, None] * rng.standard_normal(steps.shape)
        turned = np.column_stack(
            [cosine * moved[:, 0] - sine * moved[:, 1], sine * moved[:, 0] + cosine * moved[:, 1], moved[:, 2]]
        )
        places = np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)])
        tilts = angles[:, :2] + math.radians(self.tilt_deg) * rng.standard_normal((len(wanted), 2))
        return [Pose(*row) for row in np.column_stack([places, tilts, headings]).tolist()]
