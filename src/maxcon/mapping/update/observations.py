# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localized drives, and those of their scans that an update uses: its observations."""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import sha256_of_file
from maxcon.errors import FileError
from maxcon.export import PARQUET, PoseRow, read_rows
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.mapping.update.options import UpdateOptions

# Times of the table are written to the nanosecond, those of scans are read from text.
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True)
class Observation:
    """One scan that an update uses."""

    drive: int  # Number of its drive
    epoch: int  # Number of the scan in it
    time: float  # s
    pose: Pose  # T_map_sensor, local frame of the map
    # Largest standard deviations of the position along an axis, m, and of an angle, rad; None where not known
    sigma_position: float | None
    sigma_angle: float | None

    def ends(self, drives: "Sequence[LocalizedDrive]", options: UpdateOptions) -> NDArray[np.float64]:
        """Read where its rays ended, local frame of the map, shape (n, 3), m."""
        raw = drives[self.drive].scans.read(self.epoch, options.min_range, options.max_range)
        return np.ascontiguousarray(self.pose.apply(raw.points))


@dataclass(frozen=True, slots=True)
class LocalizedDrive:
    """Scans with poses.

    scans: read when they are asked for.
    rows: number of the scan, and row of the table of poses, of each localized epoch.
    n_epochs: how many scans there are.
    name: name of the file that the poses were read from.
    sha256: checksum of that file.
    """

    scans: Scans
    rows: tuple[tuple[int, PoseRow], ...]
    n_epochs: int
    name: str
    sha256: str

    @classmethod
    def open(cls, scans: Scans | str | os.PathLike[str], poses: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans, or of a folder or recording of them, and the table of poses made of them.

        FileError if either cannot be read, or the table is of other scans, or no epoch in it is localized.
        """
        opened = scans if isinstance(scans, Scans) else open_scans(scans)
        table = Path(poses)
        rows = tuple(_with_scans(opened, read_rows(table), table))
        if not rows:
            raise FileError(
                f"Expected a localized epoch in {table}, got none: an update learns from what is localized. Localize"
                " the drive again, or leave it out."
            )
        name = table.name if table.suffix.lower() != PARQUET else f"{table.absolute().parent.name}/{table.name}"
        return cls(opened, rows, len(opened), name, sha256_of_file(table))

    @classmethod
    def of_reference(cls, scans: Scans, reference: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans with the poses of a reference trajectory at their times.

        FileError or TrajectoryError if the trajectory cannot be read, or has no pose at the time of a scan.
        """
        trajectory = read_trajectory(reference)
        nearest = nearest_in_time(trajectory.times, scans.times)
        is_there = np.abs(trajectory.times[nearest] - scans.times) <= SAME_TIME
        rows = tuple(
            (i, PoseRow(float(scans.times[i]), trajectory.pose(int(nearest[i])), "localized", "", {}))
            for i in np.flatnonzero(is_there).tolist()
        )
        if not rows:
            raise FileError(
                f"Expected reference poses at the times of the scans in {reference}, got none. Correct its times."
            )
        return cls(scans, rows, len(scans), Path(reference).name, sha256_of_file(Path(reference)))


def observations_of(drives: Sequence[LocalizedDrive], frame: LocalFrame, options: UpdateOptions) -> list[Observation]:
    """Return the observations of all drives, in order: epochs before which the sensor moved by `least_motion`."""
    observations = list[Observation]()
    for number, drive in enumerate(drives):
        last = np.full(3, np.inf)
        for epoch, row in drive.rows:
            pose = frame.pose_to_local(row.pose) if row.pose is not None else None
            if pose is None or np.linalg.norm(pose.position - last) < options.least_motion:
                continue
            last = pose.position
            sigmas = (_largest_sigma(row, names) for names in (("x", "y", "z"), ("roll", "pitch", "heading")))
            observations.append(Observation(number, epoch, row.time, pose, *sigmas))
    return observations


def _largest_sigma(row: PoseRow, names: Sequence[str]) -> float | None:
    """Largest standard deviation of some coordinates of a pose; None if one is not known."""
    variances = [row.numbers.get(f"cov_{name}_{name}") for name in names]
    known = [value for value in variances if value is not None]
    return math.sqrt(max(known)) if len(known) == len(variances) else None


def _with_scans(scans: Scans, rows: Sequence[PoseRow], path: Path) -> Iterator[tuple[int, PoseRow]]:
    """Pair localized rows with their scans by time."""
    for row in rows:
        i = int(np.searchsorted(scans.times, row.time - SAME_TIME))
        if i == len(scans) or abs(float(scans.times[i]) - row.time) > SAME_TIME:
            raise FileError(
                f"Expected {path} to be a table of the scans beside it, got a row at {row.time:.6f} s, when there is no"
                " scan. Name the scans that were localized."
            )
        if row.status == "localized" and row.pose is not None:
            yield i, row
