# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map is measured in pieces, so that it is never in memory as a whole."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.lab.simulation.drive import Drive
from maxcon.lab.simulation.sensing.ray_caster import Caster
from maxcon.lab.simulation.sensing.scanners import Echoes, ProfileScanner

__all__ = ["MapPiece", "drive_poses", "map_echoes", "map_pieces"]

LINES_PER_PIECE = 250
TRAJECTORY_STEP = 0.02
"""Between two poses of the mapping vehicle's trajectory, s."""


class MapPiece(NamedTuple):
    """At most 250 successive profiles of one scanner on one drive, from number `first` on."""

    drive: Drive
    scanner: ProfileScanner
    first: int


def map_pieces(drives: Sequence[Drive], scanners: Sequence[ProfileScanner]) -> list[MapPiece]:
    """Return all pieces of `drives`, in order of time."""
    pieces = [
        MapPiece(drive, scanner, first)
        for drive in drives
        for scanner in scanners
        for first in range(0, scanner.n_lines(drive), LINES_PER_PIECE)
    ]
    return sorted(pieces, key=lambda piece: piece.drive.times[0] + piece.first / piece.scanner.line_rate)


def map_echoes(caster: Caster, pieces: Sequence[MapPiece], seed: Sequence[int]) -> Iterator[Echoes]:
    """Measure `pieces` one by one.

    caster: the world on the day of the map.
    pieces: those of `map_pieces`.
    seed: of the noise; each piece has a stream of its own.
    """
    for i, (drive, scanner, first) in enumerate(pieces):
        n_lines = min(LINES_PER_PIECE, scanner.n_lines(drive) - first)
        yield scanner.scan(caster, drive, first, n_lines, np.random.default_rng([*seed, i]))


def drive_poses(drives: Sequence[Drive]) -> tuple[NDArray[np.float64], list[Pose]]:
    """Times (s) and poses (T_city_vehicle) of `drives`, 0.02 s apart, one drive after the other."""
    times = [np.arange(drive.times[0], drive.times[-1], TRAJECTORY_STEP) for drive in drives]
    poses = [pose for drive, t in zip(drives, times, strict=True) for pose in drive.poses(t)]
    return np.concatenate(times), poses
