# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""DeskewedScans: scans of a moving sensor, with all points as seen from its pose at the time of the scan."""

from dataclasses import replace

from maxcon.errors import FileError, TrajectoryError
from maxcon.io.raw_scan import RawScan, Scans
from maxcon.scan.deskew import deskew, times_of_turn
from maxcon.scan.trajectory import Trajectory

__all__ = ["DeskewedScans"]


class DeskewedScans(Scans):
    """Scans whose points have times, deskewed by a motion when they are read.

    Parameters
    ----------
    scans : Scans
        As they were recorded.
    motion : Trajectory
        T_fixed_sensor in any fixed frame, on the clock of the scans.
    max_gap : float
        Largest time between two of its poses to interpolate across, s.
    turn_time : float, optional
        For scans whose points have no times: how long a turn of the scanner takes, s, clockwise seen from above, and
        negative for counter-clockwise. The time of a scan is that of the middle of its turn, which looks forward.
    """

    def __init__(self, scans: Scans, motion: Trajectory, max_gap: float = 0.5, turn_time: float | None = None) -> None:
        self._scans, self._motion, self._max_gap, self._turn_time = scans, motion, max_gap, turn_time
        self.times = scans.times

    def name(self, i: int) -> str:
        """Return the name of scan number `i`."""
        return self._scans.name(i)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`, deskewed; range limits apply to the ranges as measured.

        Raises
        ------
        FileError
            If it cannot be read, its points have no times, or the motion does not cover it.
        """
        raw = self._scans.read(i, min_range, max_range)
        offsets = raw.point_times
        if offsets is None and self._turn_time is not None:
            offsets = times_of_turn(raw.points, self._turn_time)
        if offsets is None:
            raise FileError(
                f"Expected a time for each point of {raw.name}, to deskew it, got none that is understood"
                " (maxcon scans info). If it is a turn of a spinning scanner, say how long that takes: --turn-time."
            )
        try:
            points = deskew(raw.points, offsets + raw.time, self._motion, raw.time, self._max_gap)
        except TrajectoryError as error:
            raise FileError(f"{raw.name}: {error}") from error
        return replace(raw, points=points, point_times=offsets)
