# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What simulated worlds share: the map with the errors of its trajectory, the epochs of a drive, and their priors."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.simulation.drive import Drive, PriorErrors, off_by
from maxcon.simulation.driving.georeferencing import GeoreferencingErrors
from maxcon.simulation.driving.gnss_priors import GnssErrors
from maxcon.simulation.sensing.ray_caster import RayCaster
from maxcon.simulation.sensing.scanners import Echoes, ProfileScanner
from maxcon.simulation.worlds.map_pieces import drive_poses, map_echoes, map_pieces

__all__ = [
    "ScanEpoch",
    "believed_echoes",
    "believed_poses",
    "evenly_spread_epochs",
    "gnss_priors",
    "successive_epochs",
    "uniform_priors",
]


class ScanEpoch(NamedTuple):
    """A scan to take: its number, in steps of the scanner from 0 (tick), time (s), reference pose T_city_sensor."""

    tick: int
    time: float
    reference: Pose


def believed_echoes(
    caster: RayCaster,
    drives: Sequence[Drive],
    scanners: Sequence[ProfileScanner],
    georeferencing: GeoreferencingErrors,
    seed: Sequence[int],
) -> Iterator[Echoes]:
    """Measure a map piece by piece, in order of time, and shift it by the errors of the vehicle's trajectory."""
    for echoes in map_echoes(caster, map_pieces(drives, scanners), seed):
        offsets = georeferencing.at(echoes.times)
        yield echoes._replace(points=echoes.points + offsets, origins=echoes.origins + offsets)


def believed_poses(
    drives: Sequence[Drive], georeferencing: GeoreferencingErrors
) -> tuple[NDArray[np.float64], list[Pose]]:
    """Times (s) and poses (T_city_vehicle) of the mapping vehicle, with the errors of its trajectory."""
    times, poses = drive_poses(drives)
    offsets = georeferencing.at(times)
    return times, [pose.translated(offset) for pose, offset in zip(poses, offsets, strict=True)]


def evenly_spread_epochs(
    drive: Drive, n_epochs: int, most_epochs: int, start: float, step: float
) -> list[ScanEpoch]:
    """Return `n_epochs`, evenly spread, of `most_epochs` from `start` (s) on, `step` (s) apart; with first and last."""
    return _at_ticks(drive, np.rint(np.linspace(0, most_epochs - 1, n_epochs)).astype(np.int64), start, step)


def successive_epochs(
    drive: Drive, n_epochs: int, ticks_apart: int, start: float, step: float
) -> list[ScanEpoch]:
    """Return `n_epochs` from `start` (s) on, `ticks_apart` times `step` (s) apart."""
    return _at_ticks(drive, ticks_apart * np.arange(n_epochs, dtype=np.int64), start, step)


def _at_ticks(drive: Drive, ticks: NDArray[np.int64], start: float, step: float) -> list[ScanEpoch]:
    times = np.round(start + step * ticks, 6)
    return [
        ScanEpoch(tick, time, pose)
        for tick, time, pose in zip(ticks.tolist(), times.tolist(), drive.poses(times), strict=True)
    ]


def gnss_priors(
    epochs: Sequence[ScanEpoch], errors: GnssErrors, most_epochs: int, step: float, seed: Sequence[int]
) -> list[Pose]:
    """Priors, T_city_sensor, whose errors change slowly over the drive of `most_epochs`, `step` (s) apart."""
    rows = errors.draw(most_epochs, step, seed)
    return [off_by(epoch.reference, rows[epoch.tick].tolist()) for epoch in epochs]


def uniform_priors(epochs: Sequence[ScanEpoch], errors: PriorErrors, seed: Sequence[int]) -> list[Pose]:
    """Priors, T_city_sensor, whose errors are independent from epoch to epoch."""
    return [errors.prior(epoch.reference, np.random.default_rng([*seed, epoch.tick])) for epoch in epochs]
