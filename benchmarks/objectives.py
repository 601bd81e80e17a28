# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Is there a score that loses less, or is more distinct, than Helmert's?

python benchmarks/objectives.py NAME=STUDY [NAME=STUDY ...] [--epochs 50]

All objectives look at the same moments, those of the defaults (a voxel once, 1/2 without a normal, a point per 0.25 m),
at epochs spread over the drive of each study, with each of its priors. The runner-up is the highest cell farther than
0.5 m from the best one, over its score: distinct answers have low ones. Each objective is judged by its own.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scene import header

import maxcon
from maxcon.drive.localize import DriveOptions, pose_or_none
from maxcon.integrity import highest_beyond
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study import Study
from maxcon.lab.study.run import spread_epochs

GUARD_RADIUS = maxcon.Trust().guard_radius


@dataclass(frozen=True)
class RootOfDeterminant:
    """sqrt(det N), the D-optimal design: the area of the error ellipse instead of its axes."""

    def score(self, moments):
        """Scores of moments."""
        nxx, nxy, nyy = moments[..., 1], moments[..., 2], moments[..., 3]
        return np.sqrt(np.maximum(nxx * nyy - nxy * nxy, 0.0))


@dataclass(frozen=True)
class HelmertTimesShare:
    """Helmert's score times the number of matches: places that much of the scan fits to."""

    def score(self, moments):
        """Scores of moments."""
        return maxcon.Helmert().score(moments) * moments[..., 0]


OBJECTIVES = {
    "Helmert": maxcon.Helmert(),
    "smallest eigenvalue": maxcon.MaxEigenvalue(),
    "sqrt(det N)": RootOfDeterminant(),
    "Helmert times count": HelmertTimesShare(),
    "count": maxcon.Count(),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="+", metavar="NAME=STUDY")
    parser.add_argument("--epochs", type=int, default=50)
    options = parser.parse_args()
    header("Objectives on the same moments")
    print("| drive | prior | objective | right | runner-up below 0.8 | median runner-up | 95 % | median m | worst m |")
    print("|---|---|---|---|---|---|---|---|---|")
    method, limits = maxcon.MaximumConsensus(), DriveOptions()
    for name, folder in (text.split("=", 1) for text in options.studies):
        study = Study.open(folder)
        dataset = Dataset.open(study.configuration.dataset)
        point_map = maxcon.PointMap.open(dataset.map_path or Path(folder) / "maps" / "standard.map")
        scans, reference = dataset.open_scans(), read_trajectory(dataset.reference)
        for prior_name in dict.fromkeys(study.table["prior"].to_pylist()):
            prior = read_trajectory(dataset.priors[prior_name])
            found = {objective: [] for objective in OBJECTIVES}
            for epoch in spread_epochs(len(scans), min(options.epochs, len(scans))):
                at = float(scans.times[epoch])
                poses = [pose_or_none(trajectory, at, limits.max_gap) for trajectory in (prior, reference)]
                if None in poses:
                    continue
                start, truth = (point_map.frame.pose_to_local(pose) for pose in poses)
                scan = maxcon.Scan(scans.read(epoch, limits.min_range, limits.max_range).points)
                accumulator = method.accumulate(scan, point_map, start)
                for objective, rule in OBJECTIVES.items():
                    scores = accumulator.score(rule)
                    cell = accumulator.best_cell(rule)
                    error = pose_error(accumulator.space.pose(cell, start), truth)
                    rest = highest_beyond(scores, cell, accumulator.space, GUARD_RADIUS)
                    found[objective].append((error.is_success, error.distance, rest / scores[cell]))
            for objective, rows in found.items():
                right, distances, ratios = (np.array(column) for column in zip(*rows, strict=True))
                print(
                    f"| {name} | {prior_name} | {objective} | {right.sum()} of {len(right)} | {(ratios < 0.8).sum()} |"
                    f" {np.median(ratios):.3f} | {np.quantile(ratios, 0.95):.3f} | {np.median(distances):.3f} |"
                    f" {distances.max():.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
