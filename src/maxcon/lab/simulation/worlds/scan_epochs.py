# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ScanEpoch: when and where the scans of a drive are taken, and their priors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.driving.gnss_priors import GnssErrors
from maxcon.lab.simulation.driving.prior_errors import PriorErrors, off_by

__all__ = [
    "EPOCH_STEP",
    "SCAN_START",
    "ScanEpoch",
    "evenly_spread_epochs",
    "gnss_priors",
    "successive_epochs",
    "uniform_priors",
]

SCAN_START = 386_400.0
"""Seconds of the GPS week: the car comes a day after the mapping vehicle."""
EPOCH_STEP = 0.1
"""Between two epochs when all are taken, s: the scanner turns ten times a second."""


class ScanEpoch(NamedTuple):
    """A scan to take: its number, in steps of the scanner from 0 (tick), time (s), reference pose T_city_sensor."""

    tick: int
    time: float
    reference: Pose


def evenly_spread_epochs(drive: Drive, n_epochs: int, most_epochs: int, start: float) -> list[ScanEpoch]:
    """Return `n_epochs`, evenly spread, of `most_epochs` from `start` (s) on; with the first and the last."""
    return _at_ticks(drive, np.rint(np.linspace(0, most_epochs - 1, n_epochs)).astype(np.int64), start)


def successive_epochs(drive: Drive, n_epochs: int, ticks_apart: int, start: float) -> list[ScanEpoch]:
    """Return `n_epochs` from `start` (s) on, `ticks_apart` steps of the scanner apart."""
    return _at_ticks(drive, ticks_apart * np.arange(n_epochs, dtype=np.int64), start)


def _at_ticks(drive: Drive, ticks: NDArray[np.int64], start: float) -> list[ScanEpoch]:
    times = np.round(start + EPOCH_STEP * ticks, 6)
    return [
        ScanEpoch(tick, time, pose)
        for tick, time, pose in zip(ticks.tolist(), times.tolist(), drive.poses(times), strict=True)
    ]


def gnss_priors(epochs: Sequence[ScanEpoch], errors: GnssErrors, most_epochs: int, seed: Sequence[int]) -> list[Pose]:
    """Priors, T_city_sensor, whose errors change slowly over the drive of `most_epochs`."""
    rows = errors.draw(most_epochs, EPOCH_STEP, seed)
    return [off_by(epoch.reference, rows[epoch.tick].tolist()) for epoch in epochs]


def uniform_priors(epochs: Sequence[ScanEpoch], errors: PriorErrors, seed: Sequence[int]) -> list[Pose]:
    """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
    return [errors.prior(epoch.reference, np.random.default_rng([*seed, epoch.tick])) for epoch in epochs]
