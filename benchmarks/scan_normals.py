# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long does a ring scan take on one core until it has normals, and which stage takes it?

python benchmarks/scan_normals.py
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from scene import header, scans, street

from maxcon.geometry.arrays import as_points
from maxcon.io.scans import open_scans
from maxcon.scan.normal_kernels import scan_planes
from maxcon.scan.normals import estimate_scan_normals
from maxcon.scan.window_kernels import BANDS, azimuths_of, elevations_of, extremes, first_windows

ROUNDS = 16
STAGES = ("reading", "checking", "angles", "first windows", "these, sorting and planes", "all but reading")


def stages_ms(folder, i):
    """Times of the stages of one scan, ms, in the order of STAGES."""
    ticks = [time.perf_counter()]
    raw = folder.read(i)
    ticks.append(time.perf_counter())
    points = as_points(raw.points, "points")
    ticks.append(time.perf_counter())
    elevations, azimuths = elevations_of(points.ravel()), azimuths_of(points.ravel())
    lowest, highest = extremes(elevations)
    ticks.append(time.perf_counter())
    first_windows(elevations, azimuths, lowest, highest, np.empty(BANDS, np.int64))
    ticks.append(time.perf_counter())
    normals = np.empty_like(points)
    scan_planes(points, elevations, azimuths, lowest, highest, normals)
    ticks.append(time.perf_counter())
    found = estimate_scan_normals(raw.points)
    ticks.append(time.perf_counter())
    return 1e3 * np.diff(ticks), len(points), found.any(axis=1).mean()


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        drive = street(Path(scratch))
        root = Path(scratch) / "scans"
        root.mkdir()
        for number, (scan, _) in enumerate(scans(drive, 8)):
            rows = np.column_stack([scan.points, np.zeros(len(scan))])
            rows.astype("<f4").tofile(root / f"{number}.bin")
        folder = open_scans(root)
        # Scan after scan, as on a drive: the same scan again and again is faster, because branches are learnt.
        found = [[stages_ms(folder, i) for i in range(len(folder))] for _ in range(ROUNDS)][1:]
        header("Normals of a VLP-16 scan: its stages")
        print(f"Medians of {ROUNDS - 1} rounds, ms.\n")
        print(f"| scan | points | with a normal | {' | '.join(STAGES)} |")
        print("|---" * (3 + len(STAGES)) + "|")
        for i in range(len(folder)):
            times = np.median([of_round[i][0] for of_round in found], axis=0)
            _, n_points, share = found[0][i]
            print(f"| {i} | {n_points:,} | {100 * share:.0f} % | {' | '.join(f'{t:.2f}' for t in times)} |")


if __name__ == "__main__":
    main()
