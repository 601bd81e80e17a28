# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What does an epoch take when a drive comes through a map for the first time, its tiles read as they are met?

python benchmarks/first_pass.py DATASET [DATASET ...] -o FOLDER [--epochs 100] [--window 12:10]

The first epochs of each drive, in order, around priors wrong by up to the window: the default search space. The map is
opened twice: the drive goes through the one once before, which compiles too. Then each epoch is localized in the other,
for the first time, and in the one, for the second: whatever else the machine does, it does to both. Times are those of
latency.py: points in memory to the refined pose, on the processor; the system has the files of the map in memory. Of a
DATASET with clouds, the map is built in FOLDER as in prior_error.py.
"""

import argparse
import os
import time
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from drives import NamedDataset, points_of, prior_and_reference
from header import header
from levels import parse_level

from maxcon import MaximumConsensus, Scan
from maxcon.errors import MaxconError
from maxcon.lab.study.methods import STANDARD
from maxcon.lab.study.prior_trials import space_of


def ms_of(method, points, point_map, prior):
    """How long a method takes, from points to pose."""
    start = time.process_time()
    method.localize(Scan(points), point_map, prior)
    return 1e3 * (time.process_time() - start)


def passes_of_drive(named, folder, level, n_epochs, seed):
    """Milliseconds of each epoch in the first and in the second pass over a map, (2, n)."""
    method = MaximumConsensus(space_of(level))
    bench = named.bench_in_memory(folder, {STANDARD})
    new, known = (named.bench_in_memory(folder, {STANDARD}).maps[STANDARD] for _ in range(2))
    epochs = [
        (points_of(bench, epoch), prior_and_reference(bench, STANDARD, epoch, level, seed)[0])
        for epoch in range(min(n_epochs, len(bench.scans)))
    ]
    for points, prior in epochs:
        ms_of(method, points, known, prior)
    return np.transpose([[ms_of(method, points, each, prior) for each in (new, known)] for points, prior in epochs])


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
    print("| drive | epochs | pass | its first epoch ms | p50 ms | p95 ms | mean ms | first over second |")
    print("|---" * 8 + "|")
    for named in [NamedDataset.of_word(word) for word in arguments.datasets]:
        first, second = passes_of_drive(named, arguments.out, level, arguments.epochs, arguments.seed)
        ratio = f"{first.mean() / second.mean():.2f}"
        for words, taken, told in (("first", first, ratio), ("second", second, "")):
            print(
                f"| {named.name} | {len(taken)} | {words} | {taken[0]:.1f} | {np.median(taken):.1f} |"
                f" {np.percentile(taken, 95):.1f} | {taken.mean():.1f} | {told} |",
                flush=True,
            )


if __name__ == "__main__":
    try:
        main()
    except MaxconError as error:
        raise SystemExit(f"first_pass: {error}") from error
