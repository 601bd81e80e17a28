# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well does each objective localize a drive with a reference, with either multiplicity?

python benchmarks/accuracy.py MAP SCANS --prior PRIOR --reference REFERENCE
"""

import argparse
import math
import time

import numpy as np
from scene import header

import maxcon
from maxcon.evaluation import pose_error, summarize
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory

OBJECTIVES = (maxcon.Count(), maxcon.Helmert(), maxcon.MaxEigenvalue())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("scans")
    parser.add_argument("--prior", required=True)
    parser.add_argument("--reference", required=True)
    options = parser.parse_args()
    point_map, scans = maxcon.PointMap.open(options.map), open_scans(options.scans)
    prior, reference = read_trajectory(options.prior), read_trajectory(options.reference)
    methods = {
        (type(objective).__name__, multiplicity): maxcon.MaximumConsensus(
            objective=objective, multiplicity=multiplicity
        )
        for multiplicity in ("points", "occupied")
        for objective in OBJECTIVES
    }
    errors = {name: [] for name in methods}
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
                estimate = methods[name].conclude(accumulator)
                errors[name].append(pose_error(estimate.pose, truth) if estimate.is_localized else None)
    header(f"Accuracy over {len(scans)} epochs")
    print("| objective | multiplicity | localized | within 0.3 m, 1 deg | median m | worst m | worst deg |")
    print("|---|---|---|---|---|---|---|")
    for (objective, multiplicity), found in errors.items():
        accuracy = summarize(found)
        n_localized = sum(error is not None for error in found)
        print(
            f"| {objective} | {multiplicity} | {n_localized} | {accuracy.n_success} | {accuracy.median_distance:.3f}"
            f" | {accuracy.worst_distance:.3f} | {math.degrees(accuracy.worst_heading):.2f} |"
        )
    for multiplicity, values in taken.items():
        print(f"\nsearch, {multiplicity}: median {np.median(values):.0f} ms per epoch, normals not included")


if __name__ == "__main__":
    main()
