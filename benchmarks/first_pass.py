# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What does an epoch take when a drive comes through a map for the first time, its tiles read as they are met?

python benchmarks/first_pass.py STUDY [STUDY ...] [--epochs 100]

The first epochs of each study's drive, in order, each once, around the prior the study was made with; then once more,
with all tiles in memory. All is compiled before, on another map of the same study opened for that. Times are of the
search alone, points with normals in memory to the pose, on the processor.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from scene import header

from maxcon import MaximumConsensus, PointMap, Scan
from maxcon.dataset import Dataset
from maxcon.drive import DriveOptions
from maxcon.search import SearchMethod
from maxcon.study import Study
from maxcon.study.bench import BenchPlan

OPTIONS = DriveOptions()


def times_of_passes(epochs, path, method):
    """Milliseconds of each epoch in two passes over a map, (2, n)."""
    point_map = PointMap.open(path)
    taken = []
    for _ in range(2):
        for scan, prior in epochs:
            start = time.process_time()
            method.localize(scan, point_map, prior)
            taken.append(1e3 * (time.process_time() - start))
    return np.reshape(taken, (2, -1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="+", metavar="STUDY")
    parser.add_argument("--epochs", type=int, default=100)
    arguments = parser.parse_args()
    header("A drive's first pass over a map, the search alone")
    print("| drive | epochs | search | pass | p50 ms | p95 ms | mean ms | largest ms |")
    print("|---" * 8 + "|")
    for folder in arguments.studies:
        study = Study.open(folder)
        dataset = Dataset.open(study.configuration.dataset)
        path = dataset.map_path or study.folder / "maps" / "standard.map"
        bench = BenchPlan(dataset, {"standard": path}).open()
        priors, frame = bench.priors[study.table["prior"][0].as_py()], bench.maps["standard"].frame
        epochs = []
        for epoch in range(min(arguments.epochs, len(bench.scans))):
            scan = Scan(bench.scans.read(epoch, OPTIONS.min_range, OPTIONS.max_range).points)
            _ = scan.normals  # estimated when first asked for
            epochs.append((scan, frame.pose_to_local(priors.at(float(bench.scans.times[epoch])))))
        for search in SearchMethod:
            method = MaximumConsensus(search=search)
            times_of_passes(epochs[:1], path, method)  # compiles
            for words, taken in zip(("first", "second"), times_of_passes(epochs, path, method), strict=True):
                print(
                    f"| {Path(folder).stem} | {len(epochs)} | {search.value} | {words} | {np.median(taken):.1f} |"
                    f" {np.percentile(taken, 95):.1f} | {taken.mean():.1f} | {taken.max():.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
