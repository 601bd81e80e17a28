# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What does an epoch take when a drive comes through a map for the first time, its tiles read as they are met?

python benchmarks/first_pass.py DATASET [DATASET ...] -o FOLDER [--epochs 100] [--window 12:10]

The first epochs of each drive, in order, each once, around priors wrong by up to the window: the default search space.
Then once more, with all tiles in memory. All is compiled before, in a map that is opened for that. Times are those of
latency.py: points in memory to the refined pose, on the processor; the files of the map have been read before by
someone, so that the system has them. Of a DATASET with clouds, the map is built in FOLDER as in prior_error.py.
"""

import argparse
import os
import time
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from drives import NamedDataset, points_of, prior_and_reference
from scene import header

from maxcon import MaximumConsensus, Scan
from maxcon.errors import MaxconError
from maxcon.study.map_variants import STANDARD
from maxcon.study.prior_levels import parse_level, space_of


def times_of_pass(epochs, point_map, method):
    """Milliseconds of each epoch, (n,)."""
    taken = []
    for points, prior in epochs:
        start = time.process_time()
        method.localize(Scan(points), point_map, prior)
        taken.append(1e3 * (time.process_time() - start))
    return np.array(taken)


def passes_of_drive(named, folder, level, n_epochs, seed):
    """Milliseconds of each epoch in two passes over a map."""
    method = MaximumConsensus(space_of(level))
    bench = named.bench_in_memory(folder, {STANDARD})
    epochs = [
        (points_of(bench, epoch), prior_and_reference(bench, STANDARD, epoch, level, seed)[0])
        for epoch in range(min(n_epochs, len(bench.scans)))
    ]
    others = named.bench_in_memory(folder, {STANDARD}).maps[STANDARD]
    times_of_pass(epochs[:: max(1, len(epochs) // 5)], others, method)  # compiles
    return [times_of_pass(epochs, bench.maps[STANDARD], method) for _ in range(2)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="+", metavar="DATASET")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--epochs", type=int, default=100)
    parser.add_argument("--window", type=parse_level, default=parse_level("12:10"))
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    level = arguments.window
    header(f"A drive's first pass over a map, {level.offset:g} m and {level.heading_deg:g} degrees")
    print("| drive | epochs | pass | p50 ms | p95 ms | largest ms | mean ms | mean, first over second |")
    print("|---" * 8 + "|")
    for named in [NamedDataset.of_word(word) for word in arguments.datasets]:
        first, second = passes_of_drive(named, arguments.out, level, arguments.epochs, arguments.seed)
        ratio = f"{first.mean() / second.mean():.2f}"
        for words, taken, told in (("first", first, ratio), ("second", second, "")):
            print(
                f"| {named.name} | {len(taken)} | {words} | {np.median(taken):.1f} | {np.percentile(taken, 95):.1f} |"
                f" {taken.max():.1f} | {taken.mean():.1f} | {told} |",
                flush=True,
            )


if __name__ == "__main__":
    try:
        main()
    except MaxconError as error:
        raise SystemExit(f"first_pass: {error}") from error
