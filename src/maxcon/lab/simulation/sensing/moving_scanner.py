# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""MovingScanner: a scan takes a tenth of a second, in which the vehicle moves, and deskewing is not perfect."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import OptionError
from maxcon.geometry import rotation_matrices
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.sensing.ray_caster import Caster
from maxcon.lab.simulation.sensing.scanners import Echoes, RotatingScanner

__all__ = ["DeskewErrors", "MovingScanner"]

TURN_TIME = 0.1
"""Duration of one turn of the scanner, s."""


@dataclass(frozen=True, slots=True)
class DeskewErrors:
    """Bounds of the errors of the motion that a scan is deskewed by: each is uniform within plus and minus its bound.

    speed: relative, 0.02 for 2 %. At 8 m/s the first and the last points of a scan are off by up to 8 mm.
    turn_rate_deg: of the rotation about the sensor's up axis, degrees per second. With 0.3, points 20 m away at either
        end of the scan are off by up to 5 mm.
    tilt_rate_deg: of roll and of pitch, degrees per second. With 0.5, points 20 m away are off by up to 9 mm.
    """

    speed: float = 0.02
    turn_rate_deg: float = 0.3
    tilt_rate_deg: float = 0.5

    def __post_init__(self) -> None:
        if not min(self.speed, self.turn_rate_deg, self.tilt_rate_deg) >= 0.0:
            raise OptionError(f"Expected bounds of deskew errors of 0 or more, got {self}. Take 0 for none.")

    def draw(self, rng: np.random.Generator) -> tuple[float, NDArray[np.float64]]:
        """Relative error of the speed, and errors of the rates of roll, pitch and heading, shape (3,), rad/s."""
        bounds = np.array([self.tilt_rate_deg, self.tilt_rate_deg, self.turn_rate_deg]) * math.pi / 180.0
        return float(self.speed * rng.uniform(-1.0, 1.0)), bounds * rng.uniform(-1.0, 1.0, 3)


@dataclass(frozen=True, slots=True)
class MovingScanner:
    """A rotating scanner on a vehicle that moves while it turns, and the deskewing of its scans.

    scanner: gives the rays. A turn begins in driving direction, half a turn before the time of the scan.
    errors: of the motion that the scans are deskewed by.
    """

    scanner: RotatingScanner
    errors: DeskewErrors = DeskewErrors()

    def scan(self, caster: Caster, drive: Drive, time: float, rng: np.random.Generator) -> Echoes:
        """Return one scan, deskewed to `time` (s), in city metres, with the errors of the deskewing.

        Each column of rays starts where the vehicle is at the column's own time. A point is then transformed from
        the sensor at that time to the sensor at `time` by the true motion between both with errors: its
        displacement is scaled, and a small rotation added. For a vehicle that stands, and without errors, this is
        `RotatingScanner.scan`.
        """
        n_columns = self.scanner.n_columns
        offsets = ((np.arange(n_columns) + 0.5) / n_columns - 0.5) * TURN_TIME
        positions, angles = drive.at(time + offsets)
        rotations = rotation_matrices(*angles.T)
        rays = self.scanner.directions.reshape(n_columns, -1, 3)
        n_layers = rays.shape[1]
        directions = (rays @ rotations.transpose(0, 2, 1)).reshape(-1, 3)
        columns = np.repeat(np.arange(n_columns), n_layers)
        numbers = np.repeat(time + offsets, n_layers)
        echoes = self.scanner.range_finder.measure(caster, positions[columns], directions, numbers, rng)
        speed_error, rate_errors = self.errors.draw(rng)
        rows = np.rint((echoes.times - time - offsets[0]) / TURN_TIME * n_columns).astype(np.int64)
        points_sensor = np.einsum("nji,nj->ni", rotations[rows], echoes.points - echoes.origins)
        here, angles_here = (column[0] for column in drive.at([time]))
        believed = rotation_matrices(*(np.outer(rate_errors, offsets)))
        turns = rotation_matrices(*angles_here) @ believed @ rotation_matrices(*angles_here).T @ rotations
        shifts = (1.0 + speed_error) * (positions - here)
        deskewed = np.einsum("nij,nj->ni", turns[rows], points_sensor) + shifts[rows] + here
        return echoes._replace(points=deskewed)
