# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What becomes of heights and tilts that priors have wrong? With the prior as it is, on the ground, and over heights.

python benchmarks/height_error.py MAP SCANS PRIOR REFERENCE [--every 1] [--seeds 1 2 3] [--height 1.0] [--tilt-deg 1.0]
                                  [--height-half-width 0.0]

To each prior's height, roll and pitch a uniform error is added, seeded; x, y and heading are as the file has them.
Right: within 0.3 m and 1 degree of the reference, horizontally. Times are of the processor, normals and thinning of
the scan before them. A height half width above 0 also searches heights, from the prior as it is.
"""

import argparse
import math
import time
from dataclasses import replace

import numpy as np
from header import header

from maxcon import MaximumConsensus, PointMap, Scan, SearchSpace
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.evaluation import pose_error


def epochs(arguments, frame, seed):
    """Yield scan, prior and reference of each epoch, local frame."""
    scans, rng = open_scans(arguments.scans), np.random.default_rng(seed)
    priors, references = read_trajectory(arguments.prior), read_trajectory(arguments.reference)
    tilt = math.radians(arguments.tilt_deg)
    for number in range(len(scans)):
        height, roll, pitch = rng.uniform(-1.0, 1.0, 3) * [arguments.height, tilt, tilt]
        if number % arguments.every:
            continue
        raw = scans.read(number, 1.0, 120.0)
        prior, reference = (frame.pose_to_local(poses.at(raw.time)) for poses in (priors, references))
        wrong = replace(prior, z=prior.z + height, roll=prior.roll + roll, pitch=prior.pitch + pitch)
        scan = Scan(raw.points, time=raw.time)
        scan.thinned(MaximumConsensus().thinning)
        yield scan, wrong, reference


def tilt_between(one, other):
    """Angle between the verticals of two poses, degrees."""
    cosine = (one.rotation.T @ [0.0, 0.0, 1.0]) @ (other.rotation.T @ [0.0, 0.0, 1.0])
    return math.degrees(math.acos(min(1.0, cosine)))


def row(method, point_map, drive):
    """Right, of these localized, wrong ones localized; errors; times: a row of the table."""
    answers = []
    for scan, prior, reference in drive:
        start = time.process_time()
        estimate = method.localize(scan, point_map, prior)
        taken = 1e3 * (time.process_time() - start)
        error = pose_error(estimate.pose, reference)
        is_right = error.distance <= 0.3 and abs(math.degrees(error.heading)) <= 1.0
        height, tilt = abs(estimate.pose.z - reference.z), tilt_between(estimate.pose, reference)
        answers.append((is_right, estimate.is_localized, error.distance, height, tilt, taken))
    right, localized, distance, height, tilt, taken = np.array(answers, dtype=np.float64).T
    n_right, n_both = int(right.sum()), int((right * localized).sum())
    heights = " / ".join(f"{100.0 * np.quantile(height, q):.1f}" for q in (0.5, 0.95, 1.0))
    return (
        f"{len(right)} | {n_right} | {n_both} | {int(localized.sum()) - n_both} | {100.0 * np.median(distance):.1f} |"
        f" {heights} | {np.median(tilt):.2f} / {tilt.max():.2f} | {np.median(taken):.1f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("map", "scans", "prior", "reference"):
        parser.add_argument(name, metavar=name.upper())
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--height", type=float, default=1.0)
    parser.add_argument("--tilt-deg", type=float, default=1.0)
    parser.add_argument("--height-half-width", type=float, default=0.0)
    arguments = parser.parse_args()
    point_map = PointMap.open(arguments.map)
    space = SearchSpace()
    methods = {"prior as it is": MaximumConsensus(space, is_levelled=False), "on the ground": MaximumConsensus(space)}
    if arguments.height_half_width > 0.0:
        searched = replace(space, height_half_width=arguments.height_half_width)
        methods["over heights"] = MaximumConsensus(searched, is_levelled=False)
    header("Priors of wrong height and tilt")
    print("| | epochs | right | localized | wrong, localized | cm | z p50 / p95 / max cm | tilt p50 / max | ms |")
    print("|---" * 9 + "|")
    for name, method in methods.items():
        drive = (epoch for seed in arguments.seeds for epoch in epochs(arguments, point_map.frame, seed))
        print(f"| {name} | {row(method, point_map, drive)}", flush=True)


if __name__ == "__main__":
    main()
