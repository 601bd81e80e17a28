# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Is a real drive localized as well when its scans or its priors are made worse?

python benchmarks/variants.py MAP SCANS --reference REFERENCE --prior PRIOR [--prior PRIOR ...]

Points in another order; every second ring of the scanner left out; a tenth of the points replaced by clutter; priors
0.2 m too low or too high. The same epochs and priors for maximum consensus and for registrations from the prior.
"""

import argparse
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from header import header

import maxcon
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import Gicp, Icp, MapTargets
from maxcon.lab.evaluation import pose_error


def rings_of(points):
    """Ring of each point, counted from 0, of a scan that was written ring by ring, each in order of azimuth."""
    azimuths = np.mod(np.arctan2(points[:, 1], points[:, 0]), 2.0 * np.pi)
    return np.cumsum(np.abs(np.diff(azimuths, prepend=azimuths[0])) > np.pi)


def as_recorded(points, rng):
    return points


def shuffled(points, rng):
    return points[rng.permutation(len(points))]


def every_second_ring(points, rng):
    return points[rings_of(points) % 2 == 0]


def with_clutter(points, rng):
    """A tenth of the points lie anywhere between the sensor and what it measured."""
    is_clutter = rng.random(len(points)) < 0.1
    shares = np.where(is_clutter, rng.uniform(0.05, 0.95, len(points)), 1.0)
    return points * shares[:, None]


VARIANTS = {
    "as recorded": (as_recorded, 0.0),
    "shuffled": (shuffled, 0.0),
    "every second ring": (every_second_ring, 0.0),
    "a tenth is clutter": (with_clutter, 0.0),
    "0.2 m too low": (as_recorded, -0.2),
    "0.2 m too high": (as_recorded, 0.2),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("scans")
    parser.add_argument("--times")
    parser.add_argument("--reference", required=True)
    parser.add_argument("--prior", action="append", required=True)
    options = parser.parse_args()
    point_map, scans = maxcon.PointMap.open(options.map), open_scans(options.scans, options.times)
    reference, targets = read_trajectory(options.reference), MapTargets()
    methods = {"**maximum consensus**": maxcon.MaximumConsensus()}
    for gate in (1.0, 3.0):
        methods[f"ICP, point-to-plane, {gate:g} m"] = Icp("plane", gate, targets=targets)
        methods[f"GICP, {gate:g} m"] = Gicp(gate, targets=targets)
    header(f"Variants of {len(scans)} epochs")
    print("| prior | variant | method | right | called localized | of these wrong | median m | worst m |")
    print("|---|---|---|---|---|---|---|---|")
    for path in map(Path, options.prior):
        prior = read_trajectory(path)
        for variant, (change, raised) in VARIANTS.items():
            errors, trusted = {name: [] for name in methods}, {name: [] for name in methods}
            for number, raw in enumerate(scans.scans()):
                rng = np.random.default_rng([number, zlib.crc32(variant.encode())])
                points = change(raw.points, rng)
                start, truth = (point_map.frame.pose_to_local(poses.at(raw.time)) for poses in (prior, reference))
                start = replace(start, z=truth.z + raised if raised else start.z)
                for name, method in methods.items():
                    estimate = method.localize(maxcon.Scan(points, time=raw.time), point_map, start)
                    errors[name].append(pose_error(estimate.pose, truth))
                    trusted[name].append(estimate.is_localized)
            for name in methods:
                is_right = np.array([error.is_success for error in errors[name]])
                distances = np.array([error.distance for error in errors[name]])
                is_trusted = np.array(trusted[name])
                print(
                    f"| {path.stem} | {variant} | {name} | {is_right.sum()} of {len(is_right)} | {is_trusted.sum()} |"
                    f" {(is_trusted & ~is_right).sum()} | {np.median(distances):.3f} | {distances.max():.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
