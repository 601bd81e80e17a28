# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How long does one epoch take in one thread, from points in memory to a refined pose with its covariance?

python benchmarks/latency.py DATASET [DATASET ...] -o FOLDER [--epochs 40] [--windows 3:2 12:10 25:15] [--rounds 3]

In windows of so many metres and degrees around priors that are wrong by up to as much: maximum consensus, and by its
stages; GICP from the prior; a count followed by GICP. In the window of the paper its cells too, by bounds and
exhaustively. Each epoch is localized once by each method to compile and to have its part of the map in memory, once
more for the memory that it takes, then round after round, the methods taking turns. FOLDER/latency.csv gets a row for
each of these runs, in processor time; latency_table.py makes tables of it. Of a DATASET with clouds, maps are built in
FOLDER as in prior_error.py, and registrations get one with ground.
"""

import argparse
import csv
import ctypes
import os
import time
from collections import defaultdict
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest import mock

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from drives import NamedDataset, points_of, prior_and_reference
from header import header
from levels import parse_level

from maxcon import MaximumConsensus, Scan, SearchSpace, cell_search, localizer
from maxcon._system.atomic import atomic_file, make_folder
from maxcon.errors import MaxconError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study.methods import STANDARD, StudyMethod
from maxcon.lab.study.prior_trials import COUNT_THEN_GICP, MAXCON, methods_at, space_of
from maxcon.lab.study.run import spread_epochs
from maxcon.refine import candidates
from maxcon.scan import scan as scan_module

TABLE = "latency.csv"
GATE = 3.0
GICP = f"GICP, gate {GATE:g} m"
STAGES = ("normals", "thinning", "ground", "search of cells", "adjusting places", "judging", "refining")


def methods_of(level, peers_map):
    """What is timed at a level."""
    known = {method.name: method for method in methods_at(level, gates=(GATE,))}
    methods = [known[MAXCON]]
    paper = SearchSpace.paper()
    if space_of(level).at(paper.cell, paper.heading_step_deg) == paper:
        methods += [
            StudyMethod(f"maxcon, paper's cells, {words}", MaximumConsensus(paper, search=search))
            for words, search in (("by bounds", "branch-and-bound"), ("exhaustively", "exhaustive"))
        ]
    return methods + [replace(known[name], map_name=peers_map) for name in (COUNT_THEN_GICP, GICP)]


class StageTimes:
    """Milliseconds on the processor that one call spends in each stage: without the stages that it calls itself."""

    def __init__(self):
        self.ms = defaultdict(float)
        self._inner = [0.0]

    def of(self, stage, function):
        """A function, timed."""

        def timed(*arguments, **keywords):
            start = time.process_time()
            self._inner.append(0.0)
            try:
                return function(*arguments, **keywords)
            finally:
                taken = 1e3 * (time.process_time() - start)
                self.ms[stage] += taken - self._inner.pop()
                self._inner[-1] += taken

        return timed

    @contextmanager
    def watching(self):
        """Note the stages of all calls inside."""
        functions = [
            (scan_module, "estimate_scan_normals", "normals"),
            (scan_module, "one_per_cube", "thinning"),
            (localizer, "fit_ground", "ground"),
            (candidates, "fit_ground_plane", "ground"),
            (candidates, "one_per_cube", "thinning"),
            (candidates.coarse, "coarse_search", "search of cells"),
            (cell_search, "branch_and_bound", "search of cells"),
            (candidates, "adjusted_candidate", "adjusting places"),
            (cell_search.CellSearch, "estimate", "judging"),
            (localizer, "validate", "refining"),
        ]
        with ExitStack() as stack:
            for module, name, stage in functions:
                stack.enter_context(mock.patch.object(module, name, self.of(stage, getattr(module, name))))
            yield


def timed(method, points, point_map, prior):
    """Let a method localize, from points to pose; the estimate, and what of a row is measured in it."""
    stages = StageTimes()
    with stages.watching():
        start = time.process_time()
        estimate = method.localize(Scan(points), point_map, prior)
        ms = 1e3 * (time.process_time() - start)
    is_ours = isinstance(method, MaximumConsensus)
    return estimate, {"ms": ms} | {stage: stages.ms[stage] if is_ours else float("nan") for stage in STAGES}


def memory_taken(method, points, point_map, prior):
    """How much a process grows while a method localizes, at most, MiB; NaN where the system is not Linux."""
    try:
        ctypes.CDLL(None).malloc_trim(0)  # what was freed goes back: it is not there to be taken again
        Path("/proc/self/clear_refs").write_text("5")  # from now on the peak is the present size
    except (AttributeError, OSError):
        return float("nan")
    before = _peak_mb()
    method.localize(Scan(points), point_map, prior)
    return _peak_mb() - before


def _peak_mb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024.0


def rows_of_epoch(bench, epoch, methods, seed, n_rounds):
    """A row for each round, level and method."""
    points, cases = points_of(bench, epoch), []
    for level, of_level in methods.items():
        for each in of_level:
            point_map = bench.maps[each.map_name]
            prior, reference = prior_and_reference(bench, each.map_name, epoch, level, seed)
            each.method.localize(Scan(points), point_map, prior)  # compiles, reads tiles, makes what it makes of them
            grown = memory_taken(each.method, points, point_map, prior)
            cases.append((level, each, point_map, prior, reference, grown))
    for turn in range(n_rounds):
        for level, each, point_map, prior, reference, grown in cases:
            estimate, taken = timed(each.method, points, point_map, prior)
            yield {
                "offset": level.offset,
                "heading_deg": level.heading_deg,
                "method": each.name,
                "map": each.map_name,
                "epoch": epoch,
                "round": turn,
                "n_points": len(points),
                "status": estimate.status.value,
                "was_widened": estimate.was_widened,
                "is_good": estimate.is_localized,
                "is_right": pose_error(estimate.pose, reference).is_success,
                "grown_mb": grown,
            } | taken


def rows_of_drive(named, folder, levels, n_epochs, seed, n_rounds):
    """All rows of a drive."""
    bench = named.bench_in_memory(folder, {STANDARD, named.peers_map})
    methods = {level: methods_of(level, named.peers_map) for level in levels}
    rows, epochs = [], spread_epochs(len(bench.scans), min(n_epochs, len(bench.scans)))
    for number, epoch in enumerate(epochs, 1):
        found = rows_of_epoch(bench, epoch, methods, seed, n_rounds)
        rows += [{"drive": named.name} | row for row in found]
        print(f"{named.name}: epoch {number} of {len(epochs)}", flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="+", metavar="DATASET")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--epochs", type=int, default=40)
    windows = [parse_level(word) for word in ("3:2", "12:10", "25:15")]
    parser.add_argument("--windows", nargs="+", type=parse_level, default=windows)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    header("One epoch, from points to pose, in one thread")
    check_small_gicp()
    make_folder(arguments.out)
    rows = []
    for named in [NamedDataset.of_word(word) for word in arguments.datasets]:
        options = arguments.windows, arguments.epochs, arguments.seed, arguments.rounds
        rows += rows_of_drive(named, arguments.out, *options)
        with atomic_file(arguments.out / TABLE) as partial, partial.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    try:
        main()
    except MaxconError as error:
        raise SystemExit(f"latency: {error}") from error
