# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""All real drives in one table: right answers, wrong ones reported as good, errors and time, beside the best baselines.

python benchmarks/real_drives.py FOLDER [FOLDER ...] -o MAPS [--level 12:10]

A FOLDER has map/*.laz, map/trajectory.txt, scans/ and reference.txt. Maps are built once, in MAPS, with all defaults of
`maxcon map build`; the baselines get one that keeps the ground, which holds height and tilt. Priors are off by up to
the level in x, y and heading, drawn once for each scan; maxcon has all defaults but the search space of the level.
Times are medians of the processor time of one thread; the first scans of a place pay for reading its map.
"""

import argparse
import os
import time
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from header import header
from levels import parse_level
from typer.testing import CliRunner

from maxcon import PointMap, Scan
from maxcon.cli import app
from maxcon.errors import MaxconError
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.evaluation import pose_error
from maxcon.lab.study.prior_trials import COUNT_THEN_GICP, MAXCON, methods_at, prior_at
from maxcon.map.manifest import read_manifest

SEED, GATE, LONGEST_GAP = 0, 3.0, 0.05
KEEPS_GROUND = [word for name in ("vegetation", "noise", "temporal-exclusion") for word in ("--drop", name)]


def built_map(folder, out, name, arguments):
    """Path of a map of a drive, built if it is not there yet."""
    path = out / f"{folder.name}-{name}.map"
    if not path.exists():
        clouds = [str(cloud) for cloud in sorted((folder / "map").glob("*.la[sz]"))]
        trajectory = str(folder / "map" / "trajectory.txt")
        command = ["map", "build", *clouds, "--trajectory", trajectory, "-o", str(path), "--quiet", *arguments]
        result = CliRunner().invoke(app, command)
        if result.exit_code:
            raise MaxconError(result.output.strip())
    return path


def trials(method, point_map, scans, reference, level):
    """(is right, is called good, distance, seconds) of each scan, by one method."""
    found = []
    for epoch in range(len(scans)):
        raw = scans.read(epoch)
        truth = point_map.frame.pose_to_local(reference.at(raw.time, LONGEST_GAP))
        prior = prior_at(truth, level, SEED, epoch)
        if epoch == 0:
            method.localize(Scan(raw.points), point_map, prior)  # compiles
        begin = time.thread_time()
        answer = method.localize(Scan(raw.points), point_map, prior)
        seconds = time.thread_time() - begin
        error = pose_error(answer.pose, truth)
        found.append((error.is_success, answer.is_localized, error.distance, seconds))
    return found


def cell_of_table(found):
    """Words of a method's trials: right and called good, wrong and called good, median error, median time."""
    is_right, is_good, distances, seconds = (np.array(values) for values in zip(*found, strict=True))
    right, wrong = is_right.astype(bool) & is_good, ~is_right.astype(bool) & is_good
    error = f"{1e3 * np.median(distances[right]):.0f} mm" if right.any() else "-"
    return f"{right.sum()}, {wrong.sum()}; {error}; {1e3 * np.median(seconds):.0f} ms"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="MAPS")
    parser.add_argument("--level", type=parse_level, default="12:10", metavar="METRES:DEGREES")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    methods = {each.name: each for each in methods_at(options.level, gates=(GATE,))}
    chosen = [methods[name] for name in (MAXCON, COUNT_THEN_GICP, f"GICP, gate {GATE:g} m")]
    header(f"Real drives, priors off by up to {options.level.offset:g} m and {options.level.heading_deg:g} degrees")
    print("| drive | spacing (median, 90 %), cell | scans |", " | ".join(each.name for each in chosen), "|")
    print("|---|---|---|" + "---|" * len(chosen))
    for folder in options.folders:
        maps = {
            name: built_map(folder, options.out, name, arguments)
            for name, arguments in (("default", []), ("ground", KEEPS_GROUND))
        }
        scans, reference = open_scans(folder / "scans"), read_trajectory(folder / "reference.txt")
        spacing = read_manifest(maps["default"]).build["spacing"]
        cells = [
            cell_of_table(
                trials(
                    each.method, PointMap.open(maps["ground" if each.map_name == "ground" else "default"]), scans,
                    reference, options.level,
                )
            )
            for each in chosen
        ]  # fmt: skip
        cell = PointMap.open(maps["default"]).cell
        words = f"{100 * spacing['median']:.0f}, {100 * spacing['at_90']:.0f} cm; {100 * cell:.0f} cm"
        print(f"| {folder.name} | {words} | {len(scans)} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
