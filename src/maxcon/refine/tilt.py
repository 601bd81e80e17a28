"""Roll and pitch of a scan from its own surfaces: floors are level, walls upright. No map, no prior."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose, rotation_matrices
from maxcon.scan import Scan

STEPS_DEG, N_AROUND = (3.0, 0.75, 0.2), (10, 5, 5)
"""Steps of roll and pitch, round by round, and how many to either side of the best one: up to 30 degrees at first."""
WIDTHS_DEG = (5.0, 3.3, 2.2)
"""A normal counts up to so far from up, or from level, the nearer the more."""
FEWEST_NORMALS, MOST_NORMALS = 100, 1000
KNOWN_DEG = 4.0
"""A pose whose up differs by no more has the scan's own tilt."""


def with_own_tilt(scan: Scan, pose: Pose) -> Pose | None:
    """Return a pose with the roll and pitch of the scan's own surfaces; None where it has these, or they are unknown.

    Slopes, hedges and roofs may mislead them by tens of degrees: only a fit to the map tells which tilt is right.
    """
    tilt = own_tilt(scan)
    if tilt is None:
        return None
    tilted = replace(pose, roll=tilt[0], pitch=tilt[1])
    return None if are_tilted_alike(pose, tilted) else tilted


def own_tilt(scan: Scan) -> tuple[float, float] | None:
    """Roll and pitch, rad, at which most normals of a scan are up or level; None where it has too few."""
    normals = scan.sample.normals
    normals = normals[normals.any(axis=1)]
    if len(normals) < FEWEST_NORMALS:
        return None
    normals = normals[:: max(1, len(normals) // MOST_NORMALS)]
    best = np.zeros(2)
    for step_deg, n_around, width_deg in zip(STEPS_DEG, N_AROUND, WIDTHS_DEG, strict=True):
        around = math.radians(step_deg) * np.arange(-n_around, n_around + 1)
        tilts = best + np.stack(np.meshgrid(around, around, indexing="ij"), axis=-1).reshape(-1, 2)
        best = tilts[np.argmax(_upright_sums(normals, tilts, math.radians(width_deg)))]
    return float(best[0]), float(best[1])


def _upright_sums(normals: NDArray[np.float64], tilts: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """How much of the normals, (n, 3), is up or level, summed, at each roll and pitch, (m, 2), rad."""
    up = rotation_matrices(tilts[:, 0], tilts[:, 1], 0.0)[:, 2]
    squares = np.square(normals @ up.T) / math.sin(width) ** 2  # of the cosines to up, over those of a wall that counts
    whole = 1.0 / math.sin(width) ** 2
    return np.asarray(np.maximum(0.0, 1.0 - squares).sum(axis=0) + np.maximum(0.0, 1.0 - whole + squares).sum(axis=0))


def tilt_between(one: Pose, other: Pose) -> float:
    """Angle between the up of two poses, as their sensors see it, rad."""
    return math.acos(min(1.0, float(one.rotation[2] @ other.rotation[2])))


def are_tilted_alike(one: Pose, other: Pose) -> bool:
    """Whether two poses have the same tilt, as far as that of a scan's surfaces is known."""
    return tilt_between(one, other) <= math.radians(KNOWN_DEG)
