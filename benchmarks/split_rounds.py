# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Two rounds of real surfaces: every other scan of one pass is displaced by what is known, and brought back.

    python benchmarks/split_rounds.py split CLOUDS OUT
    maxcon map align OUT/*.laz --passes source -o ALIGNED
    python benchmarks/split_rounds.py judge OUT ALIGNED

CLOUDS is a folder of LAZ files of one pass whose scans are 0.1 s apart.
"""

import argparse
import math
from pathlib import Path

import laspy
import numpy as np
from scipy.spatial import cKDTree

from maxcon.geometry import rotation_matrices

SCAN_TIME = 0.1
EVERY, NEAR = 500, 3.0
"""Of so many points one is judged, beside one of the other round so near, m."""


def coordinates(las):
    return np.column_stack([las.x, las.y, las.z])


def split(options):
    """Write two files of each cloud, of even scans and of odd ones, the second displaced."""
    options.after.mkdir(parents=True)
    rng = np.random.default_rng(options.seed)
    shift, turn = rng.normal(0.0, 0.1, 3), rng.normal(0.0, math.radians(0.05), 3)
    clouds = {path.stem: laspy.read(path) for path in sorted(options.before.glob("*.laz"))}
    about = np.mean([coordinates(las).mean(axis=0) for las in clouds.values()], axis=0)
    np.savez(options.after / "truth.npz", shift=shift, turn=turn, about=about)
    for stem, las in clouds.items():
        is_odd = np.round(np.asarray(las.gps_time) / SCAN_TIME).astype(np.int64) % 2 == 1
        for number, rows in enumerate((~is_odd, is_odd)):
            part = laspy.LasData(las.header, points=las.points[rows])
            if number == 1:
                turned = (coordinates(part) - about) @ rotation_matrices(*turn).T
                part.x, part.y, part.z = (turned + about + shift).T
            part.point_source_id[:] = number + 1
            part.write(options.after / f"{stem}_{number}.laz")


def judge(options):
    """Print how far points of the second round lie from where they truly are, beside those of the first."""
    truth = np.load(options.before / "truth.npz")
    true, before, after = ([[], []] for _ in range(3))
    for number in range(2):
        for path in sorted(options.before.glob(f"*_{number}.laz")):
            given, got = (coordinates(laspy.read(file))[::EVERY] for file in (path, options.after / path.name))
            was = given
            if number == 1:
                was = (given - truth["about"] - truth["shift"]) @ rotation_matrices(*truth["turn"])
                was = was + truth["about"]
            true[number].append(was)
            before[number].append(given - was)
            after[number].append(got - was)
    true, before, after = ([np.concatenate(part) for part in parts] for parts in (true, before, after))
    distances, nearest = cKDTree(true[0]).query(true[1])
    rows = distances < NEAR
    for name, errors in (("before", before), ("after", after)):
        apart = np.linalg.norm((errors[1] - errors[0][nearest])[rows], axis=1)
        print(f"{name}: apart {np.median(apart):.4f} m in the median, 95 % {np.percentile(apart, 95):.4f} m")


def main():
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(required=True)
    for run in (split, judge):
        command = commands.add_parser(run.__name__)
        command.add_argument("before", type=Path)
        command.add_argument("after", type=Path)
        command.add_argument("--seed", type=int, default=3)
        command.set_defaults(run=run)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
