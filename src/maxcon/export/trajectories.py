# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The localized poses as TUM and as KITTI trajectories."""

import os
from collections.abc import Sequence
from pathlib import Path

from maxcon._system.atomic import atomic_file
from maxcon.export.rows import PoseRow
from maxcon.io.trajectories import write_tum
from maxcon.scan.trajectory import Trajectory

__all__ = ["write_kitti", "write_tum_rows"]


def write_tum_rows(path: str | os.PathLike[str], rows: Sequence[PoseRow]) -> None:
    """Write the poses as lines `time x y z qx qy qz qw`, s and m."""
    times, poses = zip(*[(row.time, row.pose) for row in rows if row.pose is not None], strict=True)
    write_tum(path, Trajectory.from_poses(times, poses), "T_map_sensor, localized by maxcon")


def write_kitti(path: str | os.PathLike[str], rows: Sequence[PoseRow]) -> None:
    """Write the poses as the twelve numbers of [R t], row by row, a line each; their times beside it.

    T_map_sensor, in global coordinates: the first pose is not the origin, as in KITTI's own.
    """
    found = [(row.time, row.pose) for row in rows if row.pose is not None]
    lines = []
    for _, pose in found:
        numbers = [[*turn, place] for turn, place in zip(pose.rotation, pose.position, strict=True)]
        lines.append(" ".join(f"{value:.12g}" for row in numbers for value in row))
    times = [f"{time:.9f}" for time, _ in found]
    times_path = Path(path).with_suffix(".times.txt")
    with atomic_file(times_path) as times_partial, atomic_file(path) as poses_partial:
        for partial, text in ((poses_partial, lines), (times_partial, times)):
            partial.write_text("\n".join(text) + "\n", encoding="utf-8", newline="\n")
        times_path.unlink(missing_ok=True)  # a kill from here on leaves poses without times, not with those of others
