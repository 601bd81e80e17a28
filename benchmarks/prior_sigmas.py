# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Windows of a prior's standard deviations that are honest, too small, and far too small: how should they grow?

python benchmarks/prior_sigmas.py MAP SCANS --reference REFERENCE [--every N]

Priors say 0.3 m and 0.3 degrees, and are searched within three of these and 1 m and 1 degree at least.
"""

import argparse
import math
import time

import numpy as np
from drives import add_known_drive, known_drive
from header import header

import maxcon
from maxcon.lab.evaluation import pose_error

SIGMA = 0.3
COVARIANCE = np.diag([SIGMA**2, SIGMA**2, math.radians(SIGMA) ** 2])
SPACE = maxcon.SearchSpace.from_covariance(COVARIANCE, smallest_half_width=1.0, smallest_heading_half_width_deg=1.0)
METHODS = {
    "no sigmas: 12 m": maxcon.MaximumConsensus(),
    "3 sigma, then 12 m": maxcon.MaximumConsensus(SPACE),
    "3 sigma, then 12, 24 m": maxcon.MaximumConsensus(SPACE, widest=24.0),
    "3 sigma, then 2, 4, 8, 16, 24 m": maxcon.MaximumConsensus(SPACE, wider=2.0, widest=24.0),
}
# How far priors are off: x and y in m, heading in degrees.
ERRORS = {
    "as it says": lambda rng: SIGMA * rng.normal(size=3),
    "up to 8 m and 6 degrees": lambda rng: rng.uniform(-1.0, 1.0, 3) * [8.0, 8.0, 6.0],
    "up to 18 m and 15 degrees": lambda rng: rng.uniform(-1.0, 1.0, 3) * [18.0, 18.0, 15.0],
}


def main() -> None:
    parser = argparse.ArgumentParser()
    add_known_drive(parser, every=10)
    point_map, drive = known_drive(parser.parse_args())
    rng = np.random.default_rng(0)
    header(f"Priors that say {SIGMA} m and {SIGMA} degrees, {len(drive)} epochs")
    print("| priors off | method | right | wrong | not localized | searched wider | ms, median | mean |")
    print("|---|---|---|---|---|---|---|---|")
    for name, error in ERRORS.items():
        counts = {method: np.zeros(4, int) for method in METHODS}
        taken = {method: [] for method in METHODS}
        for scan, truth in drive:
            x, y, turn_deg = error(rng)
            heading = truth.heading + math.radians(turn_deg)
            prior = maxcon.Pose(truth.x + x, truth.y + y, truth.z, truth.roll, truth.pitch, heading)
            METHODS["no sigmas: 12 m"].localize(scan, point_map, prior)  # tiles are read, normals estimated
            for method, searching in METHODS.items():
                start = time.perf_counter()
                estimate = searching.localize(scan, point_map, prior)
                taken[method].append(1e3 * (time.perf_counter() - start))
                is_right, is_trusted = pose_error(estimate.pose, truth).is_success, estimate.is_localized
                counts[method] += [
                    is_right and is_trusted, not is_right and is_trusted, not is_trusted, estimate.was_widened,
                ]  # fmt: skip
        for method, numbers in counts.items():
            milliseconds = f"{np.median(taken[method]):.0f} | {np.mean(taken[method]):.0f}"
            print(f"| {name} | {method} | {' | '.join(map(str, numbers))} | {milliseconds} |", flush=True)


if __name__ == "__main__":
    main()
