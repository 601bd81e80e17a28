"""Mounting: where scanners, antenna and odometry sit in the vehicle; poses of one part from those of another."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from maxcon._system.checked import checked, read_toml
from maxcon.geometry import Pose
from maxcon.geometry.pose import quaternions_from_angles
from maxcon.scan.trajectory import Trajectory

LARGEST_OFFSET = 100.0  # of a part from the vehicle's origin, m: larger ones are millimetres
MOST_SCANNERS = 16
ADVICE = "Positions are in m, angles in degrees; see docs/priors.md"
LEVEL = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class MountedScanner:
    """One of several scanners of a vehicle: the topic of its clouds in a recording, or its own scans."""

    name: str
    T_vehicle_sensor: Pose
    topic: str | None = None  # of its clouds in a recording
    scans: Path | None = None  # its own folder of scans, or recording; None for the one that all share


@dataclass(frozen=True, slots=True)
class Mounting:
    """Where the parts of a vehicle are in its frame: x forward, y left, z up."""

    T_vehicle_sensor: Pose = LEVEL  # the scanner
    T_vehicle_prior: Pose = LEVEL  # what the prior's poses are those of: an antenna, or an IMU
    T_vehicle_odometry: Pose | None = None  # None: the scanner, or with several the vehicle
    scanners: tuple[MountedScanner, ...] = ()  # of several all; points and poses are in the vehicle's frame then

    def of_prior(self, trajectory: Trajectory, *, has_orientations: bool = True) -> Trajectory:
        """Return T_map_sensor from a prior's T_map_prior; orientations not measured are the vehicle's course."""
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
    """Return T_map_sensor from T_map_part of a part of the same rigid vehicle, with the covariances that follow."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_quat(trajectory.quaternions_xyzw)
    offsets = turns.apply(T_part_sensor.position)
    turn = quaternions_from_angles(T_part_sensor.roll, T_part_sensor.pitch, T_part_sensor.heading)
    covariances = trajectory.covariances
    if covariances is not None:
        jacobians = np.tile(np.eye(3), (len(trajectory), 1, 1))
        jacobians[:, 0, 2], jacobians[:, 1, 2] = -offsets[:, 1], offsets[:, 0]
        covariances = jacobians @ covariances @ jacobians.transpose(0, 2, 1)
    quaternions = (turns * Rotation.from_quat(turn)).as_quat()
    return Trajectory(trajectory.times, trajectory.positions + offsets, quaternions, covariances)


def read_mounting(path: str | os.PathLike[str]) -> Mounting:
    """Return what a TOML file says of where scanner, prior and odometry are in the vehicle (docs/priors.md)."""
    from msgspec import Meta, Struct

    Metres = Annotated[float, Meta(ge=-LARGEST_OFFSET, le=LARGEST_OFFSET)]
    Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
    Source = Annotated[str, Meta(min_length=1)]

    class Part(Struct, forbid_unknown_fields=True):
        position: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
        roll_deg: Degrees = 0.0
        pitch_deg: Degrees = 0.0
        heading_deg: Degrees = 0.0

        @property
        def pose(self) -> Pose:
            angles = self.roll_deg, self.pitch_deg, self.heading_deg
            return Pose(*self.position, *map(math.radians, angles))

    class Scanner(Part):
        topic: Source | None = None
        scans: Source | None = None

        def __post_init__(self) -> None:
            if self.topic is None and self.scans is None:
                raise ValueError("a topic, or scans (a path), is missing")

    class Tables(Struct, forbid_unknown_fields=True):
        sensor: Part | None = None
        prior: Part | None = None
        odometry: Part | None = None
        scanner: Annotated[dict[str, Scanner], Meta(min_length=1, max_length=MOST_SCANNERS)] | None = None

        def __post_init__(self) -> None:
            if self.sensor is None and self.prior is None and self.scanner is None:
                raise ValueError("it has neither [sensor] nor [prior]")
            if self.sensor is not None and self.scanner is not None:
                raise ValueError(
                    "it has both [sensor] and [scanner.NAME]; with several scanners poses are those of the vehicle"
                )

    file = Path(path)
    tables = checked(read_toml(file, "a mounting", ADVICE), Tables, file, "a mounting", ADVICE)
    scanners = {} if tables.scanner is None else tables.scanner
    return Mounting(
        LEVEL if tables.sensor is None else tables.sensor.pose,
        LEVEL if tables.prior is None else tables.prior.pose,
        None if tables.odometry is None else tables.odometry.pose,
        tuple(
            MountedScanner(name, each.pose, each.topic, None if each.scans is None else file.parent / each.scans)
            for name, each in scanners.items()
        ),
    )
