# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where count and Helmert's score, every map point counted, are wrong: is the map denser there?

python benchmarks/failures.py STUDY [--prior NAME]

For each lost epoch: map points per matched voxel, and matched voxels, at the wrong answer over those of the best
cell within 12 cm and one heading of the reference; and the same of the score where a voxel counts once.
"""

import argparse

import numpy as np
from drives import bench_of_study

import maxcon
from maxcon.lab.study import rows_by_method
from maxcon.lab.study.methods import AS_PUBLISHED

OBJECTIVES = {"count-points": maxcon.Count(), "helmert-points": maxcon.Helmert()}
SPACE = maxcon.SearchSpace.paper()


def near(scores, cell):
    """The best cell next to another."""
    h, y, x = (slice(max(0, index - reach), index + reach + 1) for index, reach in zip(cell, (1, 2, 2), strict=True))
    best = np.unravel_index(np.argmax(scores[h, y, x]), scores[h, y, x].shape)
    return best[0] + h.start, best[1] + y.start, best[2] + x.start


def ratios(bench, point_map, prior_name, epoch, objective):
    raw = bench.scans.read(epoch)
    scan = maxcon.Scan(raw.points)
    poses = (bench.priors[prior_name].at(raw.time), bench.reference.at(raw.time))
    prior, reference = (point_map.frame.pose_to_local(pose) for pose in poses)
    points, once = (
        maxcon.MaximumConsensus(SPACE, objective, multiplicity, **AS_PUBLISHED).accumulate(scan, point_map, prior)
        for multiplicity in ("points", "occupied")
    )
    wrong = points.best_cell(objective)
    right = near(points.score(objective), SPACE.nearest_cell(reference, prior))
    density = [points.moments[cell][0] / once.moments[cell][0] for cell in (wrong, right)]
    score = once.score(objective)
    return (density[0] / density[1], once.moments[wrong][0] / once.moments[right][0], score[wrong] / score[right])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study")
    parser.add_argument("--prior", default="gnss")
    arguments = parser.parse_args()
    study, bench = bench_of_study(arguments.study)
    print("| method | lost epochs | points per voxel, wrong over right | matched voxels | score, a voxel once |")
    print("|---|---|---|---|---|")
    for rows in rows_by_method(study.table):
        if rows.prior == arguments.prior and rows.method in OBJECTIVES:
            lost = rows.numbers("epoch")[(rows.numbers("is_success") == 0.0) & rows.is_tried].astype(int)
            found = [
                ratios(bench, bench.maps["standard"], rows.prior, int(epoch), OBJECTIVES[rows.method]) for epoch in lost
            ]
            words = [
                f"{np.median(column):.2f} ({min(column):.2f} to {max(column):.2f})"
                for column in zip(*found, strict=True)
            ]
            print(f"| {rows.method} | {len(lost)} | {' | '.join(words)} |")


if __name__ == "__main__":
    main()
