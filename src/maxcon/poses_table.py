# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv: one row per epoch of a drive, localized or not."""

import csv
import math
import os
from collections.abc import Sequence

import numpy as np

from maxcon.atomic import atomic_file
from maxcon.drive import EpochEstimate
from maxcon.trajectory import Trajectory

__all__ = ["COLUMNS", "localized_trajectory", "write_poses"]

UNKNOWNS = ("x", "y", "z", "roll", "pitch", "heading")
COVARIANCES = tuple(f"cov_{UNKNOWNS[row]}_{UNKNOWNS[column]}" for row in range(6) for column in range(row, 6))
COLUMNS = (
    "time", *UNKNOWNS, "score", "status", "ms", "protection_along", "protection_across", *COVARIANCES, "reason",
)  # fmt: skip


def write_poses(path: str | os.PathLike[str], epochs: Sequence[EpochEstimate]) -> None:
    """Write time (s), pose (global, m, rad), score, status and milliseconds of every epoch, and how sure it is.

    That is the protection level along and across the heading, m, and the upper triangle of the covariance of x, y, z,
    roll, pitch and heading, row by row, axes of the CRS, m^2, m rad and rad^2. Pose, level and covariance are empty
    unless the status is "localized": a row cannot be mistaken for a pose. The reason is empty where the status says
    all.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    with atomic_file(path) as partial, partial.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(_row(epoch) for epoch in epochs)


def _row(epoch: EpochEstimate) -> list[str]:
    pose = epoch.pose_global
    position = ["", "", ""] if pose is None else [f"{value:.4f}" for value in (pose.x, pose.y, pose.z)]
    angles = (
        ["", "", ""] if pose is None else [f"{value:.9f}" for value in (pose.roll, pose.pitch, pose.heading)]
    )
    score = "" if epoch.estimate is None else f"{epoch.estimate.score:.6g}"
    return [
        f"{epoch.raw.time:.9f}", *position, *angles, score, epoch.status.value, f"{epoch.milliseconds:.2f}",
        *_certainty(epoch), " ".join(epoch.reason.split()),
    ]  # fmt: skip


def _certainty(epoch: EpochEstimate) -> list[str]:
    """Protection level and covariance; empty where there is no pose, or they are not known."""
    nothing = [""] * (2 + len(COVARIANCES))
    if epoch.pose_global is None or epoch.estimate is None:
        return nothing
    covariance = epoch.estimate.covariance[np.triu_indices(6)]
    if not np.isfinite(covariance).all():
        return nothing
    level = ["" if math.isinf(each) else f"{each:.4f}" for each in epoch.estimate.protection_level]
    return level + [f"{each:.6g}" for each in covariance]


def localized_trajectory(epochs: Sequence[EpochEstimate]) -> Trajectory | None:
    """Return the localized poses as a trajectory, None if there is none."""
    found = [(epoch.raw.time, epoch.pose_global) for epoch in epochs if epoch.pose_global is not None]
    if not found:
        return None
    return Trajectory.from_poses([time for time, _ in found], [pose for _, pose in found])
