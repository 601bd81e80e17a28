# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well does each objective localize a drive with a reference, with either multiplicity?

python benchmarks/accuracy.py MAP SCANS --prior PRIOR --reference REFERENCE [--times TIMES]
"""

import argparse
import math
import time

import numpy as np
from scene import header

import maxcon
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.evaluation import pose_error, summarize

OBJECTIVES = (maxcon.Count(), maxcon.Helmert(), maxcon.MaxEigenvalue())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("scans")
    parser.add_argument("--times", help="time of each scan, where the folder has none")
    parser.add_argument("--prior", required=True)
    parser.add_argument("--reference", required=True)
    options = parser.parse_args()
    point_map, scans = maxcon.PointMap.open(options.map), open_scans(options.scans, options.times)
    prior, reference = read_trajectory(options.prior), read_trajectory(options.reference)
    methods = {
        (type(objective).__name__, multiplicity): maxcon.MaximumConsensus(
            objective=objective, multiplicity=multiplicity
        )
        for multiplicity in ("points", "occupied")
        for objective in OBJECTIVES
    }
    errors = {name: [] for name in methods}
    trusted = {name: [] for name in methods}
    taken = {"points": [], "occupied": []}
    for raw in scans.scans():
        scan = maxcon.Scan(raw.points, time=raw.time)
        assert scan.normals is not None
        start, truth = (point_map.frame.pose_to_local(poses.at(raw.time)) for poses in (prior, reference))
        for multiplicity in taken:
            begin = time.perf_counter()
            accumulator = methods["Helmert", multiplicity].accumulate(scan, point_map, start)
            taken[multiplicity].append(1e3 * (time.perf_counter() - begin))
            for objective in OBJECTIVES:
                name = (type(objective).__name__, multiplicity)
                estimate = methods[name].conclude(accumulator, scan, point_map)
                errors[name].append(pose_error(estimate.pose, truth))
                trusted[name].append(estimate.is_localized)
    header(f"Accuracy over {len(scans)} epochs")
    print("| objective | multiplicity | success | median m | worst m | worst deg | trusted | of these wrong |")
    print("|---|---|---|---|---|---|---|---|")
    for (objective, multiplicity), found in errors.items():
        accuracy = summarize(found)
        is_trusted = trusted[objective, multiplicity]
        n_wrong = sum(not error.is_success for error, yes in zip(found, is_trusted, strict=True) if yes)
        print(
            f"| {objective} | {multiplicity} | {accuracy.n_success} | {accuracy.distance.median:.3f}"
            f" | {accuracy.distance.worst:.3f} | {math.degrees(accuracy.heading.worst):.2f} | {sum(is_trusted)}"
            f" | {n_wrong} |"
        )
    for multiplicity, values in taken.items():
        print(f"\nsearch, {multiplicity}: median {np.median(values):.0f} ms per epoch, normals not included")


if __name__ == "__main__":
    main()
