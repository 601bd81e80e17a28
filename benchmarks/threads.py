# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What do threads bring: headings of one scan at once, or epochs of a drive at once? And are the answers the same?

python benchmarks/threads.py kitti-0013=kitti.toml campaign -o timings
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from drives import NamedDataset, points_of, prior_and_reference

from maxcon import MaximumConsensus, Scan
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study.methods import STANDARD
from maxcon.lab.study.prior_trials import prior_level, space_of

# Half widths of windows, m and degrees, and epochs.
WINDOWS = ((3.0, 2.0, 40), (12.0, 10.0, 40), (25.0, 15.0, 20), (60.0, 180.0, 12))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="+", metavar="DATASET", type=NamedDataset.of_word)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER", help="maps are built there")
    parser.add_argument("--threads", type=int, nargs="+", default=[2, 4, 8])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("drive, window, threads: gain of headings at once, of epochs at once; same answers")
    for named in arguments.datasets:
        bench = named.bench_in_memory(arguments.out, [STANDARD])
        for half_width, heading_deg, n_epochs in WINDOWS:
            measure(named.name, bench, prior_level(half_width, heading_deg), n_epochs, arguments)


def measure(name, bench, level, n_epochs, arguments):
    """Localize some epochs one after the other, with threads for headings, and several at once."""
    point_map = bench.maps[STANDARD]
    epochs = np.linspace(0, len(bench.scans) - 1, n_epochs).astype(int).tolist()
    jobs = [
        (points_of(bench, epoch), *prior_and_reference(bench, STANDARD, epoch, level, arguments.seed))
        for epoch in epochs
    ]

    def localize(job, n_threads=1):
        points, prior, _ = job
        return MaximumConsensus(space_of(level), n_threads=n_threads).localize(Scan(points), point_map, prior)

    def timed(run):
        start = time.perf_counter()
        answers = list(run(jobs))
        return answers, time.perf_counter() - start

    timed(partial(map, localize))  # reads tiles
    alone, seconds = timed(partial(map, localize))
    n_right = sum(pose_error(each.pose, job[2]).is_success for each, job in zip(alone, jobs, strict=True))
    window = f"{level.offset:g} m, {level.heading_deg:g} deg"
    print(f"{name}, {window}, 1: {1e3 * seconds / n_epochs:.1f} ms, right {n_right} of {n_epochs}")
    for n_threads in arguments.threads:
        of_headings, with_headings = timed(partial(map, partial(localize, n_threads=n_threads)))
        with ThreadPoolExecutor(n_threads) as pool:
            of_epochs, with_epochs = timed(partial(pool.map, localize))
        is_same = all(
            one.pose == two.pose == three.pose and one.score == two.score == three.score
            for one, two, three in zip(alone, of_headings, of_epochs, strict=True)
        )
        gains = f"{seconds / with_headings:.2f}, {seconds / with_epochs:.2f}"
        print(f"{name}, {window}, {n_threads}: {gains}; {'same' if is_same else 'OTHERS'}", flush=True)


if __name__ == "__main__":
    main()
