# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors against a reference pose, and how many epochs succeed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maxcon.geometry import Pose, wrap_angle

__all__ = ["SUCCESS_DISTANCE", "SUCCESS_HEADING", "Accuracy", "PoseError", "pose_error", "summarize"]

SUCCESS_DISTANCE = 0.3
SUCCESS_HEADING = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far a pose is from the reference.

    Parameters
    ----------
    distance : float
        In x and y, m.
    heading : float
        Signed, rad.
    """

    distance: float
    heading: float

    @property
    def is_success(self) -> bool:
        """Within 0.3 m and 1 degree of the reference (design, section 4)."""
        return self.distance <= SUCCESS_DISTANCE and abs(self.heading) <= SUCCESS_HEADING


def pose_error(pose: Pose, reference: Pose) -> PoseError:
    """Return the error of `pose`; both in the same frame."""
    distance = math.hypot(pose.x - reference.x, pose.y - reference.y)
    return PoseError(distance, wrap_angle(pose.heading - reference.heading))


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of a method over the epochs it localized.

    Parameters
    ----------
    n_epochs : int
        All epochs.
    n_success : int
        Localized within 0.3 m and 1 degree.
    median_distance, worst_distance : float
        m; NaN where nothing was localized.
    worst_heading : float
        Largest absolute error, rad; NaN where nothing was localized.
    """

    n_epochs: int
    n_success: int
    median_distance: float
    worst_distance: float
    worst_heading: float


def summarize(errors: Sequence[PoseError | None]) -> Accuracy:
    """Summarize the errors of all epochs, None for those that were not localized."""
    known = [error for error in errors if error is not None]
    distances = [error.distance for error in known] or [math.nan]
    headings = [abs(error.heading) for error in known] or [math.nan]
    n_success = sum(error.is_success for error in known)
    return Accuracy(len(errors), n_success, float(np.median(distances)), max(distances), max(headings))
