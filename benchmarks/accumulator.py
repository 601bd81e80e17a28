# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long do all four moments of the paper's search space take on one core?

python benchmarks/accumulator.py
"""

import tempfile
from pathlib import Path

import numpy as np
from scene import header, scans, street, times_ms

import maxcon

SPACE = maxcon.SearchSpace()


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        drive = street(Path(folder))
        n_voxels = len(drive.point_map.all_voxels()[0])
        header("All four moments, 9 x 100 x 100 cells of 6 cm")
        print(f"{n_voxels:,} voxels; ms, medians of 15 calls, normals known\n")
        print("| scan | points | matches | occupied | points | ratio | 2 threads | ratio |")
        print("|---|---|---|---|---|---|---|---|")
        medians = []
        for number, (scan, prior) in enumerate(scans(drive, 8)):
            assert scan.normals is not None

            def search(scan=scan, prior=prior, **options):
                return maxcon.search.exhaustive(scan, drive.point_map, prior, SPACE, **options)

            once = times_ms(search)
            points = times_ms(lambda search=search: search(multiplicity="points"))
            two = times_ms(lambda search=search: search(n_threads=2))
            a, b, c = (float(np.median(taken)) for taken in (once, points, two))
            n_matches = search().moments[..., 0].sum()
            medians.append(a)
            print(
                f"| {number} | {len(scan):,} | {n_matches / 1e6:.1f} M | {a:.1f} | {b:.1f} | {b / a:.2f}"
                f" | {c:.1f} | {c / a:.2f} |"
            )
        print(
            f"\nmedian over the scans {np.median(medians):.1f} ms, worst {max(medians):.1f} ms, on one core"
        )


if __name__ == "__main__":
    main()
