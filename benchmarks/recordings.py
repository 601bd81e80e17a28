# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How fast scans are read from recordings: `python benchmarks/recordings.py [--points 120000] [--scans 100]`."""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from maxcon.geometry import Pose
from maxcon.io.recordings.recording import RecordingKind, write_recording
from maxcon.io.scans import RawScan, Scans, open_scans
from maxcon.lab.simulation.recordings import drive_messages
from maxcon.scan.trajectory import Trajectory


class TurnsOfAScanner(Scans):
    """Turns of 64 layers in a room of random distances, with a time for each point."""

    def __init__(self, n_scans: int, n_points: int) -> None:
        self.times = 1.7e9 + 0.1 * np.arange(n_scans)
        self._n_points = n_points

    def name(self, i: int) -> str:
        """Its number."""
        return str(i)

    def read(self, i: int, min_range: float = 1.0, max_range: float = 120.0) -> RawScan:
        """Make it; ranges are what they are."""
        rng = np.random.default_rng(i)
        azimuths = np.linspace(np.pi, -np.pi, self._n_points)
        elevations = np.radians(np.resize(np.linspace(-20, 10, 64), self._n_points))
        ranges = rng.uniform(3.0, 60.0, self._n_points)
        level = ranges * np.cos(elevations)
        points = np.column_stack([level * np.cos(azimuths), level * np.sin(azimuths), ranges * np.sin(elevations)])
        offsets = np.linspace(-0.05, 0.05, self._n_points)
        return RawScan(points, float(self.times[i]), str(i), len(points), 0, 0, 0, offsets)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=120_000)
    parser.add_argument("--scans", type=int, default=100)
    options = parser.parse_args()
    made = TurnsOfAScanner(options.scans, options.points)
    prior = Trajectory.from_poses([1.7e9], [Pose(550_000, 5_802_000, 60, 0, 0, 0)])
    for kind in RecordingKind:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"drive.{kind}"
            write_recording(path, kind, drive_messages(made, prior, "EPSG:25832"))
            scans = open_scans(path)
            begin = time.perf_counter()
            n_scans = len(scans)  # the pass that finds their times
            middle = time.perf_counter()
            for raw in scans.scans(1.0, 120.0):
                assert len(raw.points) > 0.9 * options.points
            end = time.perf_counter()
            size = path.stat().st_size / 1e6
            print(
                f"{kind.value:<5} {n_scans} scans of {options.points:,} points, {size:.0f} MB:"
                f" times {n_scans / (middle - begin):.0f} scans/s, reading {n_scans / (end - middle):.0f} scans/s,"
                f" both {n_scans / (end - begin):.0f} scans/s; at most"
                f" {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB of memory, writing included"
            )


if __name__ == "__main__":
    main()
