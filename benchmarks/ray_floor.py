# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How high the scores along the significant ray are beside the peak, and what makes Helmert's so high there.

python benchmarks/ray_floor.py STUDY [--every N]

The search space lies around the reference. Floor: the median score along the ray over the peak. Where from: 1.2 m
from the peak along the ray, which part of N in that direction comes from surfaces turned 30 degrees or more to it,
and which from normals within 10 degrees of a right angle to it (noise of facades).
"""

import argparse

import numpy as np
from drives import bench_of_study

import maxcon
from maxcon.geometry import voxel_indices
from maxcon.lab.distinctness import significant_ray
from maxcon.search.accumulator import turn, upright

SPACE = maxcon.SearchSpace.paper()
STEPS = 20


def numbers(indices):
    """One number per voxel."""
    shifted = indices.astype(np.int64) + 2**20
    return (shifted[:, 0] << 42) | (shifted[:, 1] << 21) | shifted[:, 2]


def contributions(scan, point_map, reference, cell, direction):
    """Of each match at a cell: the part of its map normal along a direction, and what it adds to N there."""
    scan_upright, heading = upright(scan, reference), reference.heading + SPACE.headings[cell[0]]
    points = turn(scan_upright.points, heading) + [reference.x, reference.y, 0.0]
    offset = [cell[2] - SPACE.shape[2] // 2, cell[1] - SPACE.shape[1] // 2, 0]
    wanted = numbers(voxel_indices(points, point_map.cell) + offset)
    tiles = point_map.tiles_within(reference.x, reference.y, 60.0)
    known = numbers(np.concatenate([tile.voxels for tile in tiles]))
    order = np.argsort(known)
    rows = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    is_match = known[rows] == wanted
    normals = np.concatenate([tile.normals for tile in tiles])[rows[is_match]].astype(float)
    weights = np.maximum(0.0, (turn(scan_upright.normals, heading)[is_match] * normals).sum(axis=1))
    along = np.abs(normals[:, :2] @ direction)
    return along, weights * along**2


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study")
    parser.add_argument("--every", type=int, default=150)
    arguments = parser.parse_args()
    _, bench = bench_of_study(arguments.study)
    point_map = bench.maps["standard"]
    floors, shares = {"Helmert": [], "Count": []}, []
    for epoch in range(arguments.every // 3, len(bench.scans), arguments.every):
        raw = bench.scans.read(epoch)
        scan = maxcon.Scan(raw.points)
        reference = point_map.frame.pose_to_local(bench.reference.at(raw.time))
        accumulator = maxcon.MaximumConsensus(SPACE).accumulate(scan, point_map, reference)
        for objective in (maxcon.Helmert(), maxcon.Count()):
            scores = accumulator.score(objective)
            _, ray = significant_ray(accumulator, scores, accumulator.best_cell(objective))
            floors[type(objective).__name__].append(np.median(ray) / ray.max())
        heading, y, x = accumulator.best_cell(maxcon.Helmert())
        direction = np.linalg.eigh(accumulator.normal_matrix((heading, y, x)))[1][:, 0]
        beside = (heading, int(y + round(STEPS * direction[1])), int(x + round(STEPS * direction[0])))
        along, added = contributions(scan, point_map, reference, beside, direction)
        faces, noise = along >= np.sin(np.radians(30.0)), along < np.sin(np.radians(10.0))
        shares.append([added[faces].sum() / added.sum(), added[noise].sum() / added.sum()])
    for name, values in floors.items():
        low, middle, high = np.percentile(values, [25, 50, 75])
        print(f"{name}: floor {middle:.3f} of the peak (quartiles {low:.3f} to {high:.3f}), {len(values)} epochs")
    print(
        "of N along the ray: {:.2f} from surfaces that face along it, {:.2f} noise".format(*np.median(shares, axis=0))
    )


if __name__ == "__main__":
    main()
