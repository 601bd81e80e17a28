# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""DeskewedScans: scans of a moving sensor, each as seen from where it was at the time of the scan."""

from dataclasses import replace

from maxcon.deskew import deskew
from maxcon.errors import FileError, TrajectoryError
from maxcon.io.scans.raw_scan import RawScan, Scans
from maxcon.trajectory import Trajectory

__all__ = ["DeskewedScans"]


class DeskewedScans(Scans):
    """Scans whose points have times, deskewed by a motion when they are read.

    Parameters
    ----------
    scans : Scans
        As they were recorded.
    motion : Trajectory
        T_any_sensor in any frame that stands, on the clock of the scans.
    max_gap : float
        Largest time between two of its poses to interpolate across, s.
    """

    def __init__(self, scans: Scans, motion: Trajectory, max_gap: float = 0.5) -> None:
        self._scans, self._motion, self._max_gap = scans, motion, max_gap
        self.times = scans.times

    def name(self, i: int) -> str:
        """Return the name of scan number `i`."""
        return self._scans.name(i)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Return scan number `i`; its ranges are those that were measured.

        Raises
        ------
        FileError
            If it cannot be read, its points have no times, or the motion does not cover it.
        """
        raw = self._scans.read(i, min_range, max_range)
        if raw.point_times is None:
            raise FileError(
                f"Expected a time for each point of {raw.name}, to deskew it, got none that is understood"
                " (maxcon scans info). Leave out --deskew."
            )
        try:
            points = deskew(raw.points, raw.point_times + raw.time, self._motion, raw.time, self._max_gap)
        except TrajectoryError as error:
            raise FileError(f"{raw.name}: {error}") from error
        return replace(raw, points=points)
