# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive without priors: each scan is looked for in the whole map, or in a circle, independently of the others."""

import time
from collections.abc import Iterator
from dataclasses import replace

from maxcon.drive.localize import DriveOptions, EpochEstimate, answered, read_epoch, scan_of
from maxcon.estimate import Status
from maxcon.io.scans import Scans
from maxcon.relocalization import Relocalizer

__all__ = ["relocalize_drive"]


def relocalize_drive(
    scans: Scans, relocalizer: Relocalizer, options: DriveOptions | None = None, *, first: int = 0
) -> Iterator[EpochEstimate]:
    """Return an iterator over the estimates of all scans, in order of time; errors as below come before the first.

    Parameters
    ----------
    scans : Scans
        The scans; one is in memory at a time.
    relocalizer : Relocalizer
        The map, and where in it they are looked for.
    options : DriveOptions, optional
        Range limits.
    first : int
        Number of the epoch to begin with.

    Raises
    ------
    MapError
        If there is no ground in the map where scanners are looked for, or a tile cannot be read.

    Notes
    -----
    A scan that cannot be read is an epoch with that status and the reason, and the drive goes on.
    """
    options = options or DriveOptions()
    relocalizer.check()
    return (_relocalize_epoch(epoch, scans, relocalizer, options) for epoch in range(first, len(scans)))


def _relocalize_epoch(epoch: int, scans: Scans, relocalizer: Relocalizer, options: DriveOptions) -> EpochEstimate:
    raw, unreadable = read_epoch(scans, epoch, options)
    scan = scan_of(raw)
    if unreadable or len(scan) == 0:
        status = Status.UNREADABLE if unreadable else Status.NO_POINTS
        return EpochEstimate(epoch, raw, status, 0.0, scan, reason=unreadable)
    start = time.perf_counter()
    found = relocalizer.search(scan)
    milliseconds = 1e3 * (time.perf_counter() - start)
    told = answered(epoch, raw, scan, None, found.estimate, milliseconds, relocalizer.map)
    return told if found.places else replace(told, estimate=None)
