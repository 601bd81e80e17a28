# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Mounting: where scanner, antenna and odometry sit in the vehicle; the scanner's poses from those of another part."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import product, quaternions_from_angles
from maxcon.toml_file import read_toml
from maxcon.trajectory import Trajectory

__all__ = ["Mounting", "read_mounting", "sensor_trajectory"]

LARGEST_OFFSET = 100.0
"""Of a part from the vehicle's origin, m: larger ones are millimetres."""
TABLES = ("sensor", "prior", "odometry")
ANGLES = ("roll_deg", "pitch_deg", "heading_deg")
LEVEL = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Mounting:
    """Where the parts of a vehicle are in its frame: x forward, y left, z up.

    Parameters
    ----------
    T_vehicle_sensor : Pose
        The scanner.
    T_vehicle_prior : Pose
        What the prior's poses are those of: an antenna, or an IMU.
    T_vehicle_odometry : Pose or None
        What the odometry's poses are those of; None: the scanner.
    """

    T_vehicle_sensor: Pose = LEVEL
    T_vehicle_prior: Pose = LEVEL
    T_vehicle_odometry: Pose | None = None

    def of_prior(self, trajectory: Trajectory, *, has_orientations: bool = True) -> Trajectory:
        """Return T_map_sensor from a prior's poses.

        Parameters
        ----------
        trajectory : Trajectory
            T_map_prior.
        has_orientations : bool
            Whether its orientations are measured; the course over ground is that of the vehicle, however an antenna is
            turned.
        """
        T_vehicle_prior = self.T_vehicle_prior
        if not has_orientations:
            T_vehicle_prior = LEVEL.translated(T_vehicle_prior.position)
        return sensor_trajectory(trajectory, T_vehicle_prior.inverse @ self.T_vehicle_sensor)

    def of_odometry(self, trajectory: Trajectory) -> Trajectory:
        """Return T_odom_sensor from the odometry's poses."""
        if self.T_vehicle_odometry is None:
            return trajectory
        return sensor_trajectory(trajectory, self.T_vehicle_odometry.inverse @ self.T_vehicle_sensor)


def sensor_trajectory(trajectory: Trajectory, T_part_sensor: Pose) -> Trajectory:
    """Return T_map_sensor from T_map_part of a part of the same rigid vehicle, with the covariances that follow.

    Parameters
    ----------
    trajectory : Trajectory
        T_map_part. An error of its heading moves the sensor by as much as it is away.
    T_part_sensor : Pose
        The sensor in the frame of the part.
    """
    angles = trajectory.angles
    rotations = np.array([pose.rotation for pose in trajectory.poses()])
    offsets = rotations @ T_part_sensor.position
    turn = quaternions_from_angles(T_part_sensor.roll, T_part_sensor.pitch, T_part_sensor.heading)
    quaternions = product(trajectory.quaternions_xyzw, np.broadcast_to(turn, (len(angles), 4)))
    covariances = trajectory.covariances
    if covariances is not None:
        jacobians = np.tile(np.eye(3), (len(angles), 1, 1))
        jacobians[:, 0, 2], jacobians[:, 1, 2] = -offsets[:, 1], offsets[:, 0]
        covariances = jacobians @ covariances @ jacobians.transpose(0, 2, 1)
    return Trajectory(trajectory.times, trajectory.positions + offsets, quaternions, covariances)


def read_mounting(path: str | os.PathLike[str]) -> Mounting:
    """Return what a TOML file says of where scanner, prior and odometry are in the vehicle.

    Parameters
    ----------
    path : path
        Tables [sensor], [prior] and [odometry], each with `position`, x forward, y left, z up from any point of the
        vehicle (m), and roll_deg, pitch_deg, heading_deg (degrees). What is not there is 0.

    Raises
    ------
    FileError
        If it cannot be read, or says something else.
    """
    file = Path(path)
    named = read_toml(file, "a mounting", "See docs/priors.md")
    unknown = sorted(set(named) - set(TABLES))
    if unknown or not any(name in named for name in ("sensor", "prior")):
        got = ", ".join(unknown)[:80] or "neither [sensor] nor [prior]"
        raise FileError(
            f"Expected tables [sensor], [prior] and [odometry] in {file}, got {got}. See docs/priors.md."
        )
    poses = {name: _pose(file, name, named[name]) for name in TABLES if name in named}
    return Mounting(poses.get("sensor", LEVEL), poses.get("prior", LEVEL), poses.get("odometry"))


def _pose(file: Path, name: str, table: Any) -> Pose:
    """T_vehicle_part of a table."""
    if not isinstance(table, Mapping):
        raise FileError(f"Expected a table [{name}] in {file}, got {table!r:.60}. See docs/priors.md.")
    unknown = sorted(set(table) - {"position", *ANGLES})
    if unknown:
        raise FileError(
            f"Expected position, {', '.join(ANGLES)} under [{name}] in {file}, got {', '.join(unknown)[:80]}. Correct"
            " or remove it."
        )
    position = table.get("position", [0.0, 0.0, 0.0])
    if not isinstance(position, list) or len(position) != 3:
        raise FileError(
            f"Expected position under [{name}] in {file} to be [x, y, z] in m, got {position!r:.60}."
        )
    angles = [_number(file, name, key, table.get(key, 0.0), 360.0) for key in ANGLES]
    x, y, z = (_number(file, name, "position", value, LARGEST_OFFSET) for value in position)
    return Pose(x, y, z, *(math.radians(angle) for angle in angles))


def _number(file: Path, name: str, key: str, value: Any, largest: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= largest:
        raise FileError(
            f"Expected numbers of at most {largest:g} as {key} under [{name}] in {file}, got {value!r:.60}. Positions"
            " are in m, angles in degrees."
        )
    return float(value)
