# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Every kind of scanner in one table: simulated ones on a car and in a hand, and real drives, beside two baselines.

python benchmarks/scanners.py [FOLDER ...] -o MAPS [--epochs 25] [--seed 0] [--only NAME ...]

The simulated city is mapped once; each scanner of `maxcon simulate` is then driven through it, and some are walked. A
FOLDER is a real drive as in real_drives.py. Priors are off by up to 12 m and 10 degrees, drawn once for each scan, and
know roll and pitch; *level*: they do not. All defaults otherwise.
"""

import argparse
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from header import header
from real_drives import GATE, KEEPS_GROUND, LONGEST_GAP, built_map

from maxcon import PointMap, Scan
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.evaluation import pose_error
from maxcon.lab.simulation import Carrier, ScannerLayout, simulate
from maxcon.lab.simulation.datasets import CITY_ORIGIN
from maxcon.lab.simulation.worlds import SimulatedWorld
from maxcon.lab.study.prior_trials import COUNT_THEN_GICP, MAXCON, methods_at, prior_at, prior_level

LEVEL = prior_level(12.0, 10.0)
NEAREST, FARTHEST = 1.0, 120.0  # as `maxcon localize` reads scans, m
IN_HAND = (ScannerLayout.VLP_16, ScannerLayout.OS1_128, ScannerLayout.MID_360, ScannerLayout.AVIA)
COLUMNS = ("right, localized", "right, refused", "wrong, localized", "wrong, refused")


def simulated(world, layout, n_epochs, frame):
    """Scans of a drive or a walk with a scanner, each with its true pose in a map's frame."""
    for epoch in world.epochs(n_epochs):
        returns = world.scan(epoch, layout.scanner())
        points = (returns.points - epoch.reference.position) @ epoch.reference.rotation
        ranges = np.linalg.norm(points, axis=1)
        kept = points[(ranges >= NEAREST) & (ranges <= FARTHEST)].astype(np.float32)
        yield kept, frame.pose_to_local(epoch.reference.translated(CITY_ORIGIN))


def recorded(folder, frame):
    """Scans of a real drive, each with its reference pose in a map's frame."""
    scans, reference = open_scans(folder / "scans"), read_trajectory(folder / "reference.txt")
    for i in range(len(scans)):
        raw = scans.read(i, NEAREST, FARTHEST)
        yield raw.points, frame.pose_to_local(reference.at(raw.time, LONGEST_GAP))


def counts(method, point_map, epochs, seed, is_level):
    """How many answers of a method are right or wrong, and called localized or not."""
    found = Counter()
    for number, (points, truth) in enumerate(epochs):
        prior = prior_at(truth, LEVEL, seed, number)
        if is_level:
            prior = replace(prior, roll=0.0, pitch=0.0)
        answer = method.localize(Scan(points), point_map, prior)
        is_right = pose_error(answer.pose, truth).is_success
        found[f"{'right' if is_right else 'wrong'}, {'localized' if answer.is_localized else 'refused'}"] += 1
    return found


def print_row(name, methods, maps, epochs, seed, is_level=False):
    """Answer a drive by every method, and print the row of the table."""
    of_methods = [
        counts(each.method, maps["ground" if each.map_name == "ground" else "default"], epochs, seed, is_level)
        for each in methods
    ]
    cells = [str(of_methods[0][column]) for column in COLUMNS]
    cells += [f"{found[COLUMNS[0]]}, {found[COLUMNS[2]]}" for found in of_methods[1:]]
    n_points = np.median([len(points) for points, _ in epochs])
    print(f"| {name}{', level' * is_level} | {len(epochs)} | {n_points:.0f} |", " | ".join(cells), "|", flush=True)


def opened(folder, out):
    """Both maps of a drive: by default, and with its ground for the baselines."""
    arguments = {"default": [], "ground": KEEPS_GROUND}
    return {name: PointMap.open(built_map(folder, out, name, more)) for name, more in arguments.items()}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="MAPS")
    parser.add_argument("--epochs", type=int, default=25, metavar="N")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", metavar="NAME", help="scanners; default: all")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    wanted = {each.name: each for each in methods_at(LEVEL, gates=(GATE,))}
    methods = [wanted[name] for name in (MAXCON, COUNT_THEN_GICP, f"GICP, gate {GATE:g} m")]
    layouts = [ScannerLayout.parse(name) for name in options.only] if options.only is not None else list(ScannerLayout)
    header(f"Scanners, city of seed {options.seed}, priors off by up to 12 m and 10 degrees")
    columns = [f"{each.name}: right, wrong" for each in methods[1:]]
    print("| scanner | scans | points |", " | ".join([*COLUMNS, *columns]), "|")
    print("|---|---|---|" + "---|" * (len(COLUMNS) + len(columns)))
    city = options.out / f"city-{options.seed}"
    if not city.exists():
        simulate(city, n_epochs=1, seed=options.seed)
    maps = opened(city, options.out)
    for carrier, chosen in ((Carrier.CAR, layouts), (Carrier.HAND, [each for each in layouts if each in IN_HAND])):
        world = SimulatedWorld.build(options.seed, carrier=carrier)
        for layout in chosen:
            epochs = list(simulated(world, layout, options.epochs, maps["default"].frame))
            for is_level in (False, True) if carrier is Carrier.HAND else (False,):
                print_row(f"{layout.value}, {carrier.value}", methods, maps, epochs, options.seed, is_level)
    for folder in options.folders:
        maps = opened(folder, options.out)
        epochs = list(recorded(folder, maps["default"].frame))
        for is_level in (False, True):
            print_row(folder.name, methods, maps, epochs, options.seed, is_level)


if __name__ == "__main__":
    main()
