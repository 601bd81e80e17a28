# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors against a reference pose, and how many epochs succeed."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from maxcon.geometry import Pose, wrap_angle

SUCCESS_DISTANCE = 0.3
SUCCESS_HEADING = math.radians(1.0)
SUCCESS_WORDS = f"{SUCCESS_DISTANCE:g} m and {math.degrees(SUCCESS_HEADING):g}°"
"""The limits of success, in words: "within ... of the reference"."""


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far a pose is from the reference, in x, y and heading.

    along, across: in the direction of the reference's heading, and to the left of it, signed, m.
    heading: counter-clockwise, signed, rad.
    """

    along: float
    across: float
    heading: float

    @property
    def distance(self) -> float:
        """Horizontal distance from the reference, m."""
        return math.hypot(self.along, self.across)

    @property
    def is_success(self) -> bool:
        """Within 0.3 m and 1 degree of the reference (design, section 4)."""
        return self.distance <= SUCCESS_DISTANCE and abs(self.heading) <= SUCCESS_HEADING


def pose_error(pose: Pose, reference: Pose) -> PoseError:
    """Return the error of `pose`; both in the same frame."""
    dx, dy = pose.x - reference.x, pose.y - reference.y
    cosine, sine = math.cos(reference.heading), math.sin(reference.heading)
    return PoseError(
        along=dx * cosine + dy * sine,
        across=dy * cosine - dx * sine,
        heading=wrap_angle(pose.heading - reference.heading),
    )


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Quantiles of absolute errors, in the unit of the errors; all NaN where there is no error.

    median, p95, p99: the error that 50, 95 and 99 % of the epochs do not exceed, interpolated linearly between the two
        epochs next to that rank. Of fewer than 100 epochs, `p99` is nearly the worst.
    worst: the largest.
    """

    median: float
    p95: float
    p99: float
    worst: float

    @classmethod
    def of(cls, errors: Iterable[float]) -> "Quantiles":
        """Return the quantiles of the absolute values of `errors`; NaN among them makes all NaN."""
        absolute = np.abs(list(errors))
        if len(absolute) == 0:
            return cls(math.nan, math.nan, math.nan, math.nan)
        median, p95, p99, worst = np.quantile(absolute, [0.5, 0.95, 0.99, 1.0])
        return cls(float(median), float(p95), float(p99), float(worst))


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of a method over the epochs it localized.

    n_epochs: all epochs, those without an answer too.
    n_success: localized within 0.3 m and 1 degree.
    distance, along, across: of the absolute errors of the epochs that were localized, m.
    heading: of the absolute heading errors of these epochs, rad.
    """

    n_epochs: int
    n_success: int
    distance: Quantiles
    along: Quantiles
    across: Quantiles
    heading: Quantiles


def summarize(errors: Sequence[PoseError | None]) -> Accuracy:
    """Summarize the errors of all epochs, None for those that were not localized."""
    known = [error for error in errors if error is not None]
    return Accuracy(
        n_epochs=len(errors),
        n_success=sum(error.is_success for error in known),
        distance=Quantiles.of(error.distance for error in known),
        along=Quantiles.of(error.along for error in known),
        across=Quantiles.of(error.across for error in known),
        heading=Quantiles.of(error.heading for error in known),
    )
