"""What goes into a map update: localized drives, those of their scans that are observations, and the options."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import sha256_of_file
from maxcon.errors import FileError, OptionError
from maxcon.export import PARQUET, PoseRow, read_rows
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans, check_range, open_scans
from maxcon.io.trajectories import read_trajectory

SAME_TIME = 1e-6  # s: times of the table are written to the nanosecond, those of scans are read from text


@dataclass(frozen=True, slots=True)
class UpdateOptions:
    """Which scans are observations, how they are weighed, and when a surface is gone or new."""

    min_range: float = 1.0  # m; points nearer or farther than these are left out
    max_range: float = 120.0
    reach: float = 30.0  # m; surfaces farther away are not judged: an angle of 0.1 degrees is 5 cm there
    least_motion: float = 0.5  # m, of the sensor since the last observation: while it stands, its rays say the same
    sigma_range: float = 0.03  # m, of a range
    sigma_position: float = 0.03  # m, of a pose along any axis, where the table of poses has none
    sigma_angle_deg: float = 0.1  # of its angles, degrees
    sigmas: float = 3.0  # a ray misses a surface if it ended so many standard deviations behind it
    least_cosine: float = 0.1  # of the angle between a ray and a surface's normal; flatter rays are no evidence
    hit: float = 0.85  # log-odds that an observation adds to a surface that it hit, and to one that it missed
    miss: float = -0.4
    start: float = 0.4  # log-odds of a surface of the map before the first observation; new ones begin at 0
    lowest: float = -2.0  # log-odds stay between these: what was seen a hundred times can change within a few
    highest: float = 3.5
    gone_at: float = -0.3  # a surface of the map is gone at most at these log-odds, its neighbourhood's mean too
    new_at: float = 1.7  # a surface that the map does not have is new at least at these
    least_looks: int = 2  # fewest observations for either
    least_time: float = 1.0  # s, between hits of a new surface by a single drive: what passes is not new
    least_share: float = 0.7  # a neighbourhood is gone if at least this ratio of its observations missed it
    least_voxels: int = 6  # that changed the same way in a neighbourhood: single ones are noise

    def __post_init__(self) -> None:
        check_range(self.min_range, self.max_range)
        if not (all(map(math.isfinite, astuple(self))) and self.reach > 0.0 and self.least_looks >= 1):
            raise OptionError(
                "Expected numbers as options of an update, `reach` above 0 and `least_looks` of 1 or more, got"
                f" {asdict(self)}. Leave them out for the defaults."
            )

    def margins(
        self, sigma_position: float | None, sigma_angle: float | None, sigma_map: float, distances: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How far behind a surface rays (n,) must end to be a miss of it, m; sigmas are the options' if None."""
        position = self.sigma_position if sigma_position is None else sigma_position
        angle = math.radians(self.sigma_angle_deg) if sigma_angle is None else sigma_angle
        variances = self.sigma_range**2 + position**2 + sigma_map**2 + (angle * distances) ** 2
        return np.asarray(self.sigmas * np.sqrt(variances))


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
    """Scans with poses."""

    scans: Scans  # Read when they are asked for
    rows: tuple[tuple[int, PoseRow], ...]  # Number of the scan, and row of the table of poses, of each localized epoch
    name: str  # Name of the file that the poses were read from
    sha256: str  # Checksum of that file

    @classmethod
    def open(cls, scans: Scans | str | os.PathLike[str], poses: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans, or of a folder or recording of them, and the table of poses made of them."""
        opened = scans if isinstance(scans, Scans) else open_scans(scans)
        table = Path(poses)
        rows = tuple(_with_scans(opened, read_rows(table), table))
        if not rows:
            raise FileError(
                f"Expected a localized epoch in {table}, got none: an update learns from what is localized. Localize"
                " the drive again, or leave it out."
            )
        name = table.name if table.suffix.lower() != PARQUET else f"{table.absolute().parent.name}/{table.name}"
        return cls(opened, rows, name, sha256_of_file(table))

    @classmethod
    def of_reference(cls, scans: Scans, reference: str | os.PathLike[str]) -> "LocalizedDrive":
        """Return the drive of scans with the poses of a reference trajectory at their times."""
        trajectory = read_trajectory(reference)
        nearest = nearest_in_time(trajectory.times, scans.times)
        is_there = np.abs(trajectory.times[nearest] - scans.times) <= SAME_TIME
        poses = {i: trajectory.pose(int(nearest[i])) for i in np.flatnonzero(is_there).tolist()}
        if not poses:
            raise FileError(
                f"Expected reference poses at the times of the scans in {reference}, got none. Correct its times."
            )
        return cls.of_poses(scans, poses, Path(reference))

    @classmethod
    def of_poses(cls, scans: Scans, poses: Mapping[int, Pose], path: Path) -> "LocalizedDrive":
        """Return the drive of scans with poses, by their numbers, which come from a file, if there is one."""
        times = scans.times.tolist()
        rows = tuple((i, PoseRow(times[i], pose, "localized", "", {})) for i, pose in poses.items())
        return cls(scans, rows, path.name, sha256_of_file(path) if path.is_file() else "")


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
