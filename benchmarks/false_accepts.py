# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""When the true pose lies outside the search space, how often is a wrong answer called localized?

python benchmarks/false_accepts.py MAP SCANS --reference REFERENCE [--every N] [--random N]

Priors are off by more than the 3 m that are searched. Beside that: without the wider search; the best cell alone, as
it was judged before refinement; and the default, which searches 12 m.
"""

import argparse
import math
from dataclasses import replace

import numpy as np
from drives import add_known_drive, known_drive
from header import header

import maxcon
from maxcon.lab.evaluation import pose_error

# How far the prior is from the reference: x and y in m, heading in degrees.
MOVES = ((10, 11, 0), (5, 0, 0), (-5, 0, 0), (0, 5, 0), (0, -5, 0), (-8, 6, 0), (0, 0, 180), (0, 0, 4), (0.7, 0.7, 3))
NARROW, PAPER = maxcon.SearchSpace(3.0, heading_half_width_deg=2.0), maxcon.SearchSpace.paper()
METHODS = {
    "3 m": maxcon.MaximumConsensus(NARROW),
    "3 m, no wider search": maxcon.MaximumConsensus(NARROW, wider=0.0),
    "3 m, best cell": maxcon.MaximumConsensus(PAPER, refinement=False),
    "default, 12 m": maxcon.MaximumConsensus(),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    add_known_drive(parser, every=3)
    parser.add_argument("--random", type=int, default=0, metavar="N", help="N priors each, 4 to 12 m off, instead")
    options = parser.parse_args()
    point_map, drive = known_drive(options)
    rng = np.random.default_rng(0)
    header(f"Priors off by more than the search space, {len(drive)} epochs each")
    print(
        "| x m | y m | heading deg | method | right | of these localized | wrong | of these localized |"
        " searched wider |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    rounds = [("4 to 12 m", "any", "to 2")] * options.random or MOVES
    total = {name: np.zeros(5, int) for name in METHODS}
    for move in rounds:
        counts = {name: np.zeros(5, int) for name in METHODS}
        for scan, truth in drive:
            prior = moved(truth, drawn(rng) if options.random else move)
            for name, method in METHODS.items():
                estimate = method.localize(scan, point_map, prior)
                is_right, is_trusted = pose_error(estimate.pose, truth).is_success, estimate.is_localized
                counts[name] += [
                    is_right, is_right and is_trusted, not is_right, not is_right and is_trusted, estimate.was_widened,
                ]  # fmt: skip
        for name, numbers in counts.items():
            total[name] += numbers
            print(f"| {move[0]} | {move[1]} | {move[2]} | {name} | {' | '.join(map(str, numbers))} |", flush=True)
    for name, numbers in total.items():
        print(f"| all | | | {name} | {' | '.join(map(str, numbers))} |")


def drawn(rng: np.random.Generator) -> tuple[float, float, float]:
    """4 to 12 m in any direction, and up to 1.8 degrees, within the headings that are searched."""
    azimuth, distance = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(4.0, 12.0)
    return distance * math.cos(azimuth), distance * math.sin(azimuth), rng.uniform(-1.8, 1.8)


def moved(truth: maxcon.Pose, move: tuple[float, float, float]) -> maxcon.Pose:
    x, y, heading_deg = move
    return replace(truth, heading=truth.heading + math.radians(heading_deg)).translated([x, y, 0.0])


if __name__ == "__main__":
    main()
