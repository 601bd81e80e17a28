# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Refined poses beside the best cells they start from, and GICP from the same cells: errors, coverage, time.

python benchmarks/refinement.py MAP DATASET [--prior NAME] [--epochs N]

The DATASET is a dataset.toml, or a folder with one. Rows of Markdown come out: errors in x and y, and in height, as
median / 95 % / worst, in heading 95 %; how many errors lie within 1, 2 and 3 predicted standard deviations along,
across, in height and in heading; and milliseconds of one thread, of refinement and GICP those beside the search.
"""

import argparse
import math
import os
import time
from dataclasses import replace

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from header import header

from maxcon import MaximumConsensus, PointMap, Scan
from maxcon.integrity import along_and_across
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import Gicp
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import pose_error
from maxcon.refine import validate
from maxcon.refine.ground import fit_ground


def quantiles(values: list[float], digits: int = 0) -> str:
    return " / ".join(f"{value:.{digits}f}" for value in np.quantile(values, [0.5, 0.95, 1.0]))


def timed(act, *arguments, **options):
    """What a call gives, and the processor time it takes, ms."""
    start = time.process_time()
    return act(*arguments, **options), 1e3 * (time.process_time() - start)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("dataset")
    parser.add_argument("--prior", metavar="NAME")
    parser.add_argument("--epochs", type=int, metavar="N", help="evenly over the drive; all if not given")
    options = parser.parse_args()
    dataset = Dataset.open(options.dataset)
    point_map, scans = PointMap.open(options.map), dataset.open_scans()
    reference = read_trajectory(dataset.reference)
    prior = read_trajectory(dataset.priors[options.prior] if options.prior else dataset.prior)
    cells, gicp = MaximumConsensus(refinement=False), Gicp(gate=1.0)
    poses = {"best cell": [], "refined": [], "GICP from the cell, gate 1 m": []}
    took = {name: [] for name in poses}
    predicted, n_left_out = [], 0
    n_epochs = len(scans) if options.epochs is None else min(options.epochs, len(scans))
    for epoch in np.linspace(0, len(scans) - 1, n_epochs).astype(int):
        raw = scans.read(int(epoch), 1.0, 120.0)
        scan = Scan(raw.points, time=raw.time)
        truth, start = (point_map.frame.pose_to_local(each.at(raw.time)) for each in (reference, prior))
        cell, search_ms = timed(cells.localize, scan, point_map, start)
        if not pose_error(cell.pose, truth).is_success:
            n_left_out += 1
            continue
        ground = fit_ground(scan, point_map, cell.pose)
        believed = replace(cells.trust, least_confirmed_share=0.0, fewest_planes=0, farthest_move=1e9)
        cell = replace(cell, status=type(cell.status).LOCALIZED)
        refined, refined_ms = timed(validate, cell, ground, scan, point_map, believed, 0.01, is_confirmed=True)
        if not refined.is_localized:  # nor has it a covariance
            n_left_out += 1
            continue
        gicp.prepare(scan, point_map, cell.pose)
        by_gicp, gicp_ms = timed(gicp.localize, scan, point_map, cell.pose)
        for name, estimate, ms in zip(poses, (cell, refined, by_gicp), (search_ms, refined_ms, gicp_ms), strict=True):
            error = pose_error(estimate.pose, truth)
            poses[name].append((error.distance, abs(error.heading), abs(estimate.pose.z - truth.z)))
            took[name].append(ms)
        predicted.append(normalized(refined, truth))
    header(
        f"Refinement, {len(predicted)} of {n_epochs} epochs, {n_left_out} left out (wrong, refused), map known to"
        f" {point_map.sigma:.4f} m"
    )
    print("| pose | x y, mm | heading 95 %, degrees | height, cm | ms |\n|---|---|---|---|---|")
    for name, errors in poses.items():
        xy, heading, height = np.array(errors).T
        heading_95 = math.degrees(np.quantile(heading, 0.95))
        ms = f"{np.median(took[name]):.1f}" + (" (search and all before it)" if name == "best cell" else "")
        print(f"| {name} | {quantiles(1e3 * xy)} | {heading_95:.3f} | {quantiles(1e2 * height, 1)} | {ms} |")
    ratios = np.array(predicted)
    print("\n| | within 1 sigma | 2 | 3 | rms of error over sigma |\n|---|---|---|---|---|")
    for k, name in enumerate(("along", "across", "height", "heading")):
        within = " | ".join(f"{100 * np.mean(np.abs(ratios[:, k]) < s):.1f} %" for s in (1, 2, 3))
        print(f"| {name} | {within} | {np.sqrt(np.mean(ratios[:, k] ** 2)):.2f} |")
    print(f"\nNEES / 2 of x and y: {np.mean(ratios[:, 4]) / 2:.2f}")


def normalized(estimate, truth) -> tuple[float, ...]:
    """Errors along, across, in height and heading over their predicted standard deviations; and the NEES of x and y."""
    error, covariance = pose_error(estimate.pose, truth), estimate.covariance
    planar, offset = along_and_across(covariance, truth.heading), np.array([error.along, error.across])
    sigmas = np.sqrt([planar[0, 0], planar[1, 1], covariance[2, 2], covariance[5, 5]])
    errors = np.array([error.along, error.across, estimate.pose.z - truth.z, error.heading])
    return *(errors / sigmas).tolist(), float(offset @ np.linalg.solve(planar, offset))


if __name__ == "__main__":
    main()
