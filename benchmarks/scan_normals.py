# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long do the normals of a ring scan take on one core?

python benchmarks/scan_normals.py
"""

import tempfile
from pathlib import Path

import numpy as np
from scene import header, scans, street, times_ms

from maxcon.geometry.scan_normals import estimate_scan_normals


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        drive = street(Path(folder))
        header("Normals of a VLP-16 scan")
        print("| scan | points | with a normal | ms, median of 15 | least | most |")
        print("|---|---|---|---|---|---|")
        for number, (scan, _) in enumerate(scans(drive, 8)):
            taken = times_ms(lambda scan=scan: estimate_scan_normals(scan.points))
            share = scan.normals.any(axis=1).mean()
            print(
                f"| {number} | {len(scan):,} | {100 * share:.0f} % | {np.median(taken):.1f} | {taken.min():.1f}"
                f" | {taken.max():.1f} |"
            )


if __name__ == "__main__":
    main()
