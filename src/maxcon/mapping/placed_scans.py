# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map from a drive: scans become one more source of points, each placed by its pose; what moved is found by rays."""

import os
from collections.abc import Generator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from shutil import rmtree

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import atomic_folder, check_replaceable, lift
from maxcon._system.engine import Engine
from maxcon._system.regular_file import sha256_of_file
from maxcon.errors import OptionError, TrajectoryError
from maxcon.export import PoseRow
from maxcon.geometry import Pose
from maxcon.io.clouds import Bounds, CloudChunk, CloudHeader, CloudReader
from maxcon.io.raw_scan import Scans
from maxcon.map.manifest import MAP_NAMES, Manifest
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.update import LocalizedDrive, UpdateOptions, update_map
from maxcon.scan.trajectory import Trajectory

COUNTED_INTERVAL = 0.1  # s; between scans whose times are whole numbers: they were counted, a turn takes as long
NEVER = 1e6  # log-odds that nothing reaches: whatever the rays hit is in the map already, or was left out on purpose
AS_PLACED = "scans-as-placed"


class PlacedScans(CloudReader):
    """Scans of a drive as one cloud, each where its pose (T_map_sensor) puts it, with the time of the scan.

    Scans without a pose, for which one must be known `margin` (s) before and after, too, are left out;
    TrajectoryError if all are.
    """

    def __init__(
        self, scans: Scans, poses: Trajectory, path: str | os.PathLike[str], *, min_range: float = 1.0,
        max_range: float = 120.0, margin: float = 0.0, poses_path: str | os.PathLike[str] = "",
    ) -> None:  # fmt: skip
        super().__init__()
        self.scans, self.ranges, self.poses_path = scans, (min_range, max_range), Path(poses_path)
        self.poses = dict[int, Pose]()
        for i, time in enumerate(scans.times.tolist()):
            with suppress(TrajectoryError):  # no pose is near: counted, and told
                self.poses[i] = [poses.at(time + offset) for offset in (-margin, margin, 0.0)][-1]
        if not self.poses:
            raise TrajectoryError(
                f"Expected poses at the times of the scans in {path}, {scans.times[0]:.3f} to {scans.times[-1]:.3f} s,"
                f" got some from {poses.times[0]:.3f} to {poses.times[-1]:.3f} s, and none at any of them. Do both use"
                " the same clock? Poses without times, one per scan, are given as KITTI has them: 12 numbers a line."
            )
        # Not from 0 on: LAS files whose times are all 0 have none.
        self._times = COUNTED_INTERVAL * (scans.times + 1.0) if self.are_counted else scans.times
        first = len(scans.read(next(iter(self.poses)), min_range, max_range).points)
        self.header = CloudHeader(Path(path), first * len(self.poses), has_times=True)

    @property
    def are_counted(self) -> bool:
        """Whether the times of the scans are but numbers, 0, 1, 2, not seconds."""
        return len(self.scans) > 1 and bool((self.scans.times % 1.0 == 0.0).all())

    @property
    def words(self) -> str:
        """How many scans have a pose, and how their times were understood, in a line."""
        n_without = len(self.scans) - len(self.poses)
        without = f"; {n_without:,} have no pose at their time, and are left out" if n_without else ""
        counted = f"; their times are whole numbers, taken as {COUNTED_INTERVAL:g} s apart" if self.are_counted else ""
        return f"scans: {len(self.poses):,} of {len(self.scans):,} placed by their poses{without}{counted}"

    @property
    def trajectory(self) -> Trajectory:
        """Where the sensor was at the times of the points."""
        rows = list(self.poses)
        return Trajectory.from_poses(self._times[rows], list(self.poses.values()))

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        points, times = list[NDArray[np.float64]](), list[NDArray[np.float64]]()
        for i, pose in self.poses.items():
            points.append(pose.apply(self.scans.read(i, *self.ranges).points))
            times.append(np.full(len(points[-1]), self._times[i]))
            is_last = i == next(reversed(self.poses))
            if (n := sum(map(len, points))) >= max_points or (is_last and n):  # a scan is not cut
                yield CloudChunk(np.concatenate(points), times=np.concatenate(times))
                points, times = [], []


def map_of_drive(
    placed: PlacedScans, out: str | os.PathLike[str], options: MapOptions | None = None, *, keep_moving: bool = False,
    overwrite: bool = False, n_threads: int | None = None, engine: Engine | None = None,
    progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Build a map of the scans of a drive, as `build_map`; what later rays went through is gone, or stays."""
    options = replace(options or MapOptions(), trajectory=placed.trajectory)
    if options.to_crs is not None:
        raise OptionError("Expected poses in the CRS of the map, got --to-crs with scans. Leave it out; see --crs.")
    if keep_moving:
        return build_map(
            [placed], out, options, overwrite=overwrite, n_threads=n_threads, engine=engine, progress=progress
        )
    rows = tuple(
        (i, PoseRow(float(placed.scans.times[i]), pose, "localized", "", {})) for i, pose in placed.poses.items()
    )
    checksum = sha256_of_file(placed.poses_path) if placed.poses_path.is_file() else ""
    drive = LocalizedDrive(placed.scans, rows, placed.poses_path.name, checksum)
    judged = UpdateOptions(min_range=placed.ranges[0], max_range=placed.ranges[1], new_at=NEVER)
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        before, after = folder / AS_PLACED, folder / "map"
        build_map([placed], before, options, n_threads=n_threads, engine=engine, progress=progress)
        manifest = update_map(before, [drive], after, judged, progress=progress)
        rmtree(before)
        lift(after)
    return manifest
