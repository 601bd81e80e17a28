# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long do all four moments of the paper's search space take on one core, and on what?

python benchmarks/accumulator.py [STUDY --every N]

On scans of the street that the benchmarks share, or on every N-th of a study. All calls for a scan take turns.
"Roofline" is what it cannot be faster than, its additions alone (see roofline.py). The parts: preparation (turn,
sort and group the scan, find its tiles), turning (voxels and normals at each heading, which voxels to visit), kernel,
and the rest (memory for the sums, and the copy of them that is returned).
"""

import argparse
import tempfile
import time
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np
from roofline import add_all, addresses_of_matches
from scene import header, scans, street

import maxcon
from maxcon.lab.dataset import Dataset
from maxcon.lab.study import Study
from maxcon.lab.study.bench import Bench
from maxcon.search import exhaustive, group_kernels, visit_kernels, window_kernels
from maxcon.search.prepared_scan import PreparedScan

SPACE = maxcon.SearchSpace.paper()
N_CALLS = 11
PARTS = {
    "preparation": ["PreparedScan.prepare"],
    "turning": ["turn_to_columns", "turn_normals", "plan_visits", "visits_of_tiles", "stops_in_tile"],
    "kernel": ["accumulate_tile"],
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", nargs="?")
    parser.add_argument("--every", type=int, default=20)
    arguments = parser.parse_args()
    header("All four moments, 9 x 100 x 100 cells of 6 cm, on one core")
    if arguments.study:
        report(*of_study(arguments.study, arguments.every))
    else:
        with tempfile.TemporaryDirectory() as folder:
            drive = street(Path(folder))
            report(drive.point_map, scans(drive, 8))


def of_study(folder, every):
    """Map, and every N-th scan with its prior, of a study."""
    study = Study.open(folder)
    dataset = Dataset.open(study.configuration.dataset)
    maps = {"standard": dataset.map_path or study.folder / "maps" / "standard.map"}
    bench = Bench.open(dataset, maps)
    point_map = bench.maps["standard"]
    found = []
    for epoch in range(every // 2, len(bench.scans), every):
        raw = bench.scans.read(epoch)
        prior = point_map.frame.pose_to_local(bench.priors[next(iter(dataset.priors))].at(raw.time))
        found.append((maxcon.Scan(raw.points), prior))
    return point_map, found


def report(point_map, epochs):
    print("ms, medians of calls that take turns; normals known; ns and G/s per match\n")
    print(
        "| scan | points | matches | search | ns | G/s | preparation | turning | kernel | rest"
        " | roofline | search / roofline | kernel / roofline | `points` | 2 threads |"
    )
    print("|" + "---|" * 15)
    rows = []
    for number, (scan, prior) in enumerate(epochs):
        rows.append(measure(point_map, scan, prior))
        print(f"| {number} | {len(scan):,} |" + row(rows[-1]), flush=True)
    print("| median | |" + row(np.median(rows, axis=0)))


def row(numbers):
    (n_matches, search, preparation, turning, kernel, rest, roofline, ratio, kernel_ratio, *others) = numbers
    return (
        f" {n_matches / 1e6:.1f} M | {search:.1f} | {1e6 * search / n_matches:.2f}"
        f" | {n_matches / search / 1e6:.2f} | {preparation:.1f} | {turning:.1f} | {kernel:.1f} | {rest:.1f}"
        f" | {roofline:.1f} | {ratio:.2f} | {kernel_ratio:.2f} | {others[0]:.1f} | {others[1]:.1f} |"
    )


def measure(point_map, scan, prior):
    """Matches, and medians in ms and of ratios."""
    assert scan.normals is not None
    search = (scan, point_map, prior, SPACE)
    n_matches = int(exhaustive(*search).moments[..., 0].sum())
    calls = []
    accumulate = window_kernels.accumulate_tile
    with mock.patch.object(window_kernels, "accumulate_tile", lambda *call: calls.append(call) or accumulate(*call)):
        exhaustive(*search)
    sums = calls[0][-1].reshape(-1)
    addresses = addresses_of_matches(calls, n_matches)
    contenders = {
        "search": lambda: exhaustive(*search),
        "roofline": lambda: add_all(addresses, sums),
        "points": lambda: exhaustive(*search, multiplicity="points"),
        "threads": lambda: exhaustive(*search, n_threads=2),
    }
    taken, parts = defaultdict(list), defaultdict(list)
    for turn in range(N_CALLS + 1):
        for name, call in contenders.items():
            with timed_parts() as seconds:
                start = time.perf_counter()
                call()
                passed = time.perf_counter() - start
            if turn == 0:  # to warm up
                continue
            taken[name].append(1e3 * passed)
            if name == "search":
                for part, names in PARTS.items():
                    parts[part].append(1e3 * sum(seconds[each] for each in names))
    times = {name: np.array(values) for name, values in (taken | parts).items()}
    rest = times["search"] - sum(times[part] for part in PARTS)
    columns = [times["search"], *(times[part] for part in PARTS), rest, times["roofline"]]
    columns += [times["search"] / times["roofline"], times["kernel"] / times["roofline"]]
    return [n_matches, *(np.median(column) for column in (*columns, times["points"], times["threads"]))]


@contextmanager
def timed_parts():
    """Seconds spent in each function of PARTS."""
    seconds = defaultdict(float)

    def timed(name, function):
        def call(*arguments):
            start = time.perf_counter()
            result = function(*arguments)
            seconds[name] += time.perf_counter() - start
            return result

        return call

    with (
        mock.patch.object(PreparedScan, "prepare", timed("PreparedScan.prepare", PreparedScan.prepare)),
        timed_functions(group_kernels, PARTS["turning"][:2], timed),
        timed_functions(visit_kernels, PARTS["turning"][2:], timed),
        timed_functions(window_kernels, PARTS["kernel"], timed),
    ):
        yield seconds


def timed_functions(module, names, timed):
    """Some functions of a module, each as `timed` makes it."""
    return mock.patch.multiple(module, **{name: timed(name, getattr(module, name)) for name in names})


if __name__ == "__main__":
    main()
