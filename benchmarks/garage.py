# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Is the storey of a garage told, or called ambiguous, where priors are storeys too high or too low?

python benchmarks/garage.py [--scans N] [--walls N]

Five storeys, 2.8 m from floor to floor, are alike but for some partition walls each and for parked cars, others on the
day of the map. The map has its floors as ground. Right is an answer within 0.3 m and 1 degree, and 0.1 m in height.
"""

import argparse
import math
from dataclasses import replace

import numpy as np
from faults import Answer, figures
from header import header

from maxcon import MaximumConsensus, PointMap, Pose, Scan
from maxcon.lab.baselines import Gicp, MapTargets
from maxcon.lab.simulation.furniture import LasClass, boxes, join, quads
from maxcon.lab.simulation.scanners import RayCaster, ScannerLayout

N_STOREYS, STOREY, SLAB = 5, 2.8, 0.25
LENGTH, WIDTH = 56.0, 34.0
RAMP = (18.0, 38.0, 28.5, 33.5)
"""From x to x, from y to y, m: a slope from each floor to the next one, with an opening above."""
LANES = (9.0, 24.0)
"""Cars drive along these y, m."""
SENSOR = 1.8
OFFSET, HEADING_DEG = 2.0, 5.0
"""Priors are off by up to this in x, in y, m, and in heading."""
SUCCESS_HEIGHT = 0.1
HEIGHTS = {"right height": (0.0, 0.0), "0.5 m too high or low": (0.5, 0.5), "2 to 3 m too high or low": (2.0, 3.0)}


def floors():
    """Slabs of all storeys and the roof, with the opening of the ramp in those above the lowest, and the ramps."""
    x0, x1, y0, y1 = RAMP
    parts = [boxes([0.0, 0.0, -SLAB], [LENGTH, WIDTH, 0.0], LasClass.GROUND)]
    parts.append(boxes([0.0, 0.0, N_STOREYS * STOREY - SLAB], [LENGTH, WIDTH, N_STOREYS * STOREY], LasClass.GROUND))
    for z in STOREY * np.arange(1, N_STOREYS):
        lows = [[0.0, 0.0, z - SLAB], [0.0, y1, z - SLAB], [0.0, y0, z - SLAB], [x1, y0, z - SLAB]]
        highs = [[LENGTH, y0, z], [LENGTH, WIDTH, z], [x0, y1, z], [LENGTH, y1, z]]
        parts.append(boxes(lows, highs, LasClass.GROUND))
        slope = [[x0, y0, z - STOREY], [x1, y0, z], [x1, y1, z], [x0, y1, z - STOREY]]
        parts.append(quads([slope], LasClass.GROUND))
    return parts


def walls(n_own, rng):
    """What stands on each floor: outer walls, two of them parapets, pillars, a staircase, and walls of its own."""
    parts = []
    pillars = [(x, y) for x in np.arange(8.0, LENGTH, 8.0) for y in (4.5, 13.5, 19.5, 28.0)]
    for z in STOREY * np.arange(N_STOREYS):
        top = z + STOREY - SLAB
        lows = [[0.0, 0.0, z], [0.0, WIDTH - 0.2, z], [0.0, 0.0, z], [LENGTH - 0.2, 0.0, z], [25.0, 15.0, z]]
        highs = [[0.2, WIDTH, top], [LENGTH, WIDTH, top], [LENGTH, 0.2, z + 1.1], [LENGTH, WIDTH, z + 1.1],
                 [31.0, 18.0, top]]  # fmt: skip
        for x, y in pillars:
            lows.append([x - 0.25, y - 0.25, z])
            highs.append([x + 0.25, y + 0.25, top])
        for _ in range(n_own):
            x, y = rng.uniform(4.0, LENGTH - 8.0), rng.choice([0.0, 14.0, 19.0])
            is_along = rng.random() < 0.5
            lows.append([x, y + 0.5, z])
            highs.append([x + (4.0 if is_along else 0.15), y + (0.65 if is_along else 4.0), top])
        parts.append(boxes(lows, highs, LasClass.BUILDING))
    return parts


def cars(rng):
    """Parked cars of one day, in half of the places along both sides of the lanes."""
    lows, highs = [], []
    for z in STOREY * np.arange(N_STOREYS):
        for y in (0.7, 14.0, 18.7):
            for x in np.arange(2.0, LENGTH - 3.0, 2.7):
                if rng.random() < 0.5:
                    x_car, y_car = x + rng.uniform(-0.2, 0.2), y + rng.uniform(-0.2, 0.2)
                    lows += [[x_car, y_car, z + 0.2], [x_car + 0.1, y_car + 1.0, z + 0.8]]
                    highs += [
                        [x_car + 1.8, y_car + 4.4, z + 0.8],
                        [x_car + 1.7, y_car + 3.2, z + rng.uniform(1.3, 1.7)],
                    ]
    return [boxes(lows, highs, LasClass.VEHICLE)]


def measured(caster, layout, pose, rng):
    """Points, their normals on the side of the sensor, and their classes, of one scan from a pose."""
    returns = layout.scanner().scan(caster, pose, 0.0, rng)
    normals = caster.normals[returns.triangles].astype(np.float64)
    sides = np.sign(np.einsum("ij,ij->i", normals, returns.origins - returns.points))
    normals *= np.where(sides == 0.0, 1.0, sides)[:, None]
    return returns.points, normals / np.linalg.norm(normals, axis=1, keepdims=True), returns.classes


def places(storey, n, rng):
    """Poses on the lanes of a storey."""
    for k in range(n):
        x = 3.0 + (LENGTH - 6.0) * (k + rng.uniform(0.2, 0.8)) / n
        heading = rng.choice([0.0, math.pi]) + math.radians(rng.uniform(-3.0, 3.0))
        yield Pose(x, LANES[k % 2] + rng.uniform(-0.5, 0.5), STOREY * storey + SENSOR, 0.0, 0.0, heading)


def built(n_walls, rng):
    """The map, from a scan each 4 m on every lane, with the cars of that day; and what is there on another day."""
    building = [*floors(), *walls(n_walls, rng)]
    caster = RayCaster(join([*building, *cars(rng)]))
    clouds = [
        measured(caster, ScannerLayout.OS1_64, Pose(x, y, STOREY * storey + SENSOR, 0.0, 0.0, 0.0), rng)
        for storey in range(N_STOREYS)
        for y in LANES
        for x in np.arange(2.0, LENGTH, 4.0)
    ]
    points, normals, classes = map(np.concatenate, zip(*clouds, strict=True))
    is_floor = (classes == LasClass.GROUND) & (normals[:, 2] > 0.9)
    point_map = PointMap.from_points(points, normals, ground=points[is_floor])
    return point_map, RayCaster(join([*building, *cars(rng)]))


def prior_of(truth, heights, rng):
    """A prior off in x, y and heading, and by a height within limits, m, to either side."""
    x, y = rng.uniform(-OFFSET, OFFSET, 2)
    turn = math.radians(rng.uniform(-HEADING_DEG, HEADING_DEG))
    height = rng.uniform(*heights) * rng.choice([-1.0, 1.0])
    return replace(truth, heading=truth.heading + turn).translated([x, y, height])


def answer_of(method, scan, point_map, prior, truth):
    """An answer, judged with its height."""
    estimate = method.localize(scan, point_map, prior)
    answer, off = Answer.of(estimate, truth), abs(estimate.pose.z - truth.z)
    return replace(
        answer, is_right=answer.is_right and off <= SUCCESS_HEIGHT, distance=math.hypot(answer.distance, off)
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scans", type=int, default=10, metavar="N", help="on each of the storeys")
    parser.add_argument("--walls", type=int, default=3, metavar="N", help="of its own, that each storey has")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    point_map, caster = built(options.walls, rng)
    scans = []
    for storey in range(N_STOREYS):
        for truth in places(storey, options.scans, rng):
            points, _, _ = measured(caster, ScannerLayout.VLP_16, truth, rng)
            scans.append((Scan((points - truth.position) @ truth.rotation), truth))
    header(f"A garage, {len(scans)} scans")
    print("| prior | right, localized | right, refused | wrong, localized | wrong, refused | worst localized, m |")
    print("|---|---|---|---|---|---|")
    targets = MapTargets()
    methods = {
        "": MaximumConsensus(),
        "GICP, 1 m: ": Gicp(1.0, targets=targets),
        "GICP, 3 m: ": Gicp(3.0, targets=targets),
    }
    for prefix, method in methods.items():
        for name, heights in HEIGHTS.items():
            draws = np.random.default_rng(options.seed + 1)
            answers = [
                answer_of(method, scan, point_map, prior_of(truth, heights, draws), truth) for scan, truth in scans
            ]
            print(f"| {prefix}{name} | {' | '.join(figures(answers, has_covariance=False)[:5])} |", flush=True)


if __name__ == "__main__":
    main()
