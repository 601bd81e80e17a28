# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""LocalizedDrive: the scans of a drive with the poses found for them; looks: those of them that an update uses."""

import hashlib
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError
from maxcon.export import PARQUET, PoseRow, read_rows
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.mapping.update.update_options import UpdateOptions

__all__ = ["LocalizedDrive", "Look", "looks_of"]

# Times of the table are written to the nanosecond, those of scans are read from text.
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True)
class Look:
    """One scan that an update uses.

    Parameters
    ----------
    drive : int
        Number of its drive.
    epoch : int
        Number of the scan in it.
    time : float
        s.
    pose : Pose
        T_map_sensor, local frame of the map.
    sigma_position, sigma_angle : float
        Largest standard deviations of the position along an axis, m, and of an angle, rad; None where not known.
    """

    drive: int
    epoch: int
    time: float
    pose: Pose
    sigma_position: float | None
    sigma_angle: float | None


@dataclass(frozen=True, slots=True)
class LocalizedDrive:
    """Scans with poses.

    Parameters
    ----------
    scans : Scans
        Read when they are asked for.
    rows : tuple of (int, PoseRow)
        Number of the scan, and row of the table of poses, of each localized epoch.
    n_epochs : int
        How many scans there are.
    name : str
        Name of the file that the poses were read from.
    sha256 : str
        Checksum of that file.
    """

    scans: Scans
    rows: tuple[tuple[int, PoseRow], ...]
    n_epochs: int
    name: str
    sha256: str

    @classmethod
    def open(cls, scans: Scans | str | os.PathLike[str], poses: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans, or of a folder or recording of them, and the table of poses made of them.

        Raises
        ------
        FileError
            If either cannot be read, or the table is of other scans, or no epoch in it is localized.
        """
        opened = scans if isinstance(scans, Scans) else open_scans(scans)
        rows = tuple(_with_scans(opened, read_rows(poses), Path(poses)))
        if not rows:
            raise FileError(
                f"Expected a localized epoch in {poses}, got none: an update learns from what is localized. Localize"
                " the drive again, or leave it out."
            )
        table = Path(poses)
        name = table.name if table.suffix.lower() != PARQUET else f"{table.absolute().parent.name}/{table.name}"
        return cls(opened, rows, len(opened), name, _sha256(table))

    @classmethod
    def of_reference(cls, scans: Scans, reference: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans with the poses of a reference trajectory at their times.

        Raises
        ------
        FileError, TrajectoryError
            If the trajectory cannot be read, or has no pose at the time of a scan.
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
        return cls(scans, rows, len(scans), Path(reference).name, _sha256(Path(reference)))


def looks_of(drives: Sequence[LocalizedDrive], frame: LocalFrame, options: UpdateOptions) -> list[Look]:
    """Return the looks of all drives, drive by drive: epochs before which the sensor moved by `least_motion`."""
    looks = list[Look]()
    for number, drive in enumerate(drives):
        last = np.full(3, np.inf)
        for epoch, row in drive.rows:
            pose = frame.pose_to_local(row.pose) if row.pose is not None else None
            if pose is None or np.linalg.norm(pose.position - last) < options.least_motion:
                continue
            last = pose.position
            looks.append(Look(number, epoch, row.time, pose, *_sigmas(row)))
    return looks


def read_look(look: Look, drives: Sequence[LocalizedDrive], options: UpdateOptions) -> NDArray[np.float64]:
    """Return where the rays of a look ended, local frame of the map, shape (n, 3), m."""
    raw = drives[look.drive].scans.read(look.epoch, options.min_range, options.max_range)
    return np.ascontiguousarray(look.pose.apply(raw.points))


def _sigmas(row: PoseRow) -> tuple[float | None, float | None]:
    """Largest standard deviation of position and of angles in a row; None where it has none."""
    position = [row.numbers.get(f"cov_{name}_{name}") for name in ("x", "y", "z")]
    angles = [row.numbers.get(f"cov_{name}_{name}") for name in ("roll", "pitch", "heading")]
    return _largest_sigma(position), _largest_sigma(angles)


def _largest_sigma(variances: Sequence[float | None]) -> float | None:
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


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
