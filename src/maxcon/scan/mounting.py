# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Mounting: where scanners, antenna and odometry sit in the vehicle; poses of one part from those of another."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maxcon._system.toml_file import read_toml
from maxcon.errors import FileError
from maxcon.geometry import Pose
from maxcon.geometry.quaternions import product, quaternions_from_angles
from maxcon.scan.trajectory import Trajectory

__all__ = ["MountedScanner", "Mounting", "read_mounting", "sensor_trajectory"]

LARGEST_OFFSET = 100.0
"""Of a part from the vehicle's origin, m: larger ones are millimetres."""
MOST_SCANNERS = 16
TABLES = ("sensor", "prior", "odometry")
SOURCES = ("topic", "scans")
"""Where the scans of one of several scanners come from."""
ANGLES = ("roll_deg", "pitch_deg", "heading_deg")
LEVEL = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class MountedScanner:
    """One of several scanners of a vehicle.

    Parameters
    ----------
    name : str
        As the file calls it.
    T_vehicle_sensor : Pose
        Where it is.
    topic : str or None
        Of its clouds in a recording.
    scans : Path or None
        Its own folder of scans, or recording; None: the one that all share.
    """

    name: str
    T_vehicle_sensor: Pose
    topic: str | None = None
    scans: Path | None = None


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
        What the odometry's poses are those of; None: the scanner, or with several the vehicle.
    scanners : tuple of MountedScanner
        Of several scanners all, in the order of the file; points and poses are in the vehicle's frame then.
    """

    T_vehicle_sensor: Pose = LEVEL
    T_vehicle_prior: Pose = LEVEL
    T_vehicle_odometry: Pose | None = None
    scanners: tuple[MountedScanner, ...] = ()

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
        vehicle (m), and roll_deg, pitch_deg, heading_deg (degrees). What is not there is 0. Instead of [sensor] one
        table [scanner.NAME] for each of several, with `topic`, or with `scans`, a path from the file on.

    Raises
    ------
    FileError
        If it cannot be read, or says something else.
    """
    file = Path(path)
    named = read_toml(file, "a mounting", "See docs/priors.md")
    unknown = sorted(set(named) - {*TABLES, "scanner"})
    if unknown or not any(name in named for name in ("sensor", "prior", "scanner")):
        got = ", ".join(unknown)[:80] or "neither [sensor] nor [prior]"
        raise FileError(f"Expected tables [sensor], [prior] and [odometry] in {file}, got {got}. See docs/priors.md.")
    poses = {name: _pose(file, name, named[name]) for name in TABLES if name in named}
    scanners = _scanners(file, named["scanner"]) if "scanner" in named else ()
    if scanners and "sensor" in named:
        raise FileError(
            f"Expected either [sensor] or [scanner.NAME] tables in {file}, got both. With several scanners poses are"
            " those of the vehicle."
        )
    return Mounting(poses.get("sensor", LEVEL), poses.get("prior", LEVEL), poses.get("odometry"), scanners)


def _scanners(file: Path, tables: Any) -> tuple[MountedScanner, ...]:
    if not isinstance(tables, Mapping) or not 1 <= len(tables) <= MOST_SCANNERS:
        raise FileError(
            f"Expected 1 to {MOST_SCANNERS} tables [scanner.NAME] in {file}, got {tables!r:.60}. See docs/priors.md."
        )
    scanners = []
    for name, table in tables.items():
        label = f"scanner.{name:.40}"
        pose = _pose(file, label, table, SOURCES)
        sources = {key: table[key] for key in SOURCES if key in table}
        if not sources or not all(isinstance(value, str) and value for value in sources.values()):
            raise FileError(
                f"Expected a topic, or scans (a path), under [{label}] in {file}, got {sources!r:.60}."
                " See docs/priors.md."
            )
        scans = sources.get("scans")
        scanners.append(
            MountedScanner(name, pose, sources.get("topic"), None if scans is None else file.parent / scans)
        )
    return tuple(scanners)


def _pose(file: Path, name: str, table: Any, others: tuple[str, ...] = ()) -> Pose:
    """T_vehicle_part of a table, which may say other things, too."""
    if not isinstance(table, Mapping):
        raise FileError(f"Expected a table [{name}] in {file}, got {table!r:.60}. See docs/priors.md.")
    unknown = sorted(set(table) - {"position", *ANGLES, *others})
    if unknown:
        known = ", ".join(("position", *ANGLES, *others))
        raise FileError(
            f"Expected {known} under [{name}] in {file}, got {', '.join(unknown)[:80]}. Correct or remove it."
        )
    position = table.get("position", [0.0, 0.0, 0.0])
    if not isinstance(position, list) or len(position) != 3:
        raise FileError(f"Expected position under [{name}] in {file} to be [x, y, z] in m, got {position!r:.60}.")
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
