# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""When the true pose lies outside the search space, how often is the wrong answer called localized?

python benchmarks/false_accepts.py MAP SCANS --reference REFERENCE
"""

import argparse
import math
from dataclasses import replace

from scene import header

import maxcon
from maxcon.evaluation import pose_error
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory

# How far the prior is from the reference: x and y in m, heading in degrees.
MOVES = (
    (10, 11, 0),
    (5, 0, 0),
    (-5, 0, 0),
    (0, 5, 0),
    (0, -5, 0),
    (-8, 6, 0),
    (0, 0, 180),
    (0, 0, 4),
    (0.7, 0.7, 3),
)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("scans")
    parser.add_argument("--reference", required=True)
    parser.add_argument("--every", type=int, default=3, metavar="N", help="take each N-th scan")
    options = parser.parse_args()
    point_map, scans = maxcon.PointMap.open(options.map), open_scans(options.scans)
    reference = read_trajectory(options.reference)
    method = maxcon.MaximumConsensus()
    drive = []
    for epoch in range(0, len(scans), options.every):
        raw = scans.read(epoch)
        drive.append((maxcon.Scan(raw.points), point_map.frame.pose_to_local(reference.at(raw.time))))
    header(f"Priors off by more than the search space, {len(drive)} epochs each")
    print("| x m | y m | heading deg | wrong answers | of these called localized |")
    print("|---|---|---|---|---|")
    for x, y, heading_deg in MOVES:
        wrong = []
        for scan, truth in drive:
            turned = replace(truth, heading=truth.heading + math.radians(heading_deg))
            estimate = method.localize(scan, point_map, turned.translated([x, y, 0.0]))
            if not pose_error(estimate.pose, truth).is_success:
                wrong.append(estimate.is_localized)
        print(f"| {x} | {y} | {heading_deg} | {len(wrong)} | {sum(wrong)} |", flush=True)


if __name__ == "__main__":
    main()
