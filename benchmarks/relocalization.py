# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""No prior but the map: how often is a scan found, is a wrong place ever called localized, and how long does it take?

python benchmarks/relocalization.py DATASET [--map MAP] [--epochs 100] [--radius M] [--coarse] [--exhaustive 0] [-o CSV]

The DATASET is a dataset.toml whose map is built, or a folder with one; `--map` searches another map, in which none of
the scans was taken. `--radius` searches circles of this radius whose middle lies up to 0.7 of it from the true place,
anywhere. `--coarse` counts matches in the same large cells without regard to which way surfaces face, as 3D-BBS does,
by branch and bound with the same bounds, for the best cell alone; `--exhaustive` counts every large cell of so many of
the epochs. Times are of the processor, in one thread; maps have been read before. Rows of Markdown come out.
"""

import argparse
import csv
import math
import os
import time
from collections import Counter
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from header import header

from maxcon import PointMap, Pose, Scan
from maxcon._system.atomic import atomic_file
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import pose_error
from maxcon.refine import fit_ground_plane
from maxcon.relocalization import Relocalizer, kernels
from maxcon.relocalization.coarse_filter import HEADINGS, PARTS, STEP_DEG, CoarseScan, filter_cells
from maxcon.relocalization.kernels import REGION
from maxcon.relocalization.relocalizer import THINNING

WITHIN, WITHIN_DEG = 0.3, 1.0
# A large cell, or one beside it, is as good as large cells are.
NEAR, NEAR_DEG = 1.5, 3.0
FARTHEST_SHARE = 0.7
COLUMNS = (
    "epoch", "method", "status", "is_right", "error_m", "error_deg", "share", "runner_up", "n_coarse", "n_half",
    "n_others", "cpu_ms", "true_x", "true_y", "x", "y",
)  # fmt: skip


def timed(call):
    """What a call returns, and milliseconds of the processor."""
    began = time.process_time()
    result = call()
    return result, 1e3 * (time.process_time() - began)


def row(epoch, method, status, pose, truth, milliseconds, **others):
    """One row of the table; no error where the scan was not taken in the map."""
    error = None if truth is None else pose_error(pose, truth)
    within = (WITHIN, WITHIN_DEG) if method == "maxcon" else (NEAR, NEAR_DEG)
    is_right = error is not None and error.distance <= within[0] and abs(math.degrees(error.heading)) <= within[1]
    return {
        "epoch": epoch, "method": method, "status": status, "is_right": is_right, "x": pose.x, "y": pose.y,
        "error_m": "" if error is None else error.distance,
        "error_deg": "" if error is None else math.degrees(error.heading),
        "true_x": "" if truth is None else truth.x, "true_y": "" if truth is None else truth.y,
        "cpu_ms": milliseconds, **others,
    }  # fmt: skip


def relocalized(epoch, relocalizer, points, truth):
    """The answer of the method."""
    found, milliseconds = timed(lambda: relocalizer.search(Scan(points)))
    estimate = found.estimate
    return row(
        epoch, "maxcon", estimate.status.value, estimate.pose, truth, milliseconds, share=estimate.share,
        runner_up=estimate.runner_up, n_coarse=found.n_coarse, n_half=found.n_half, n_others=found.n_others,
    )  # fmt: skip


def without_bins(points):
    """What is counted without regard to which way surfaces face."""
    scan = Scan(points)
    coarse = CoarseScan.of(scan.thinned(THINNING), fit_ground_plane(scan))
    return CoarseScan(coarse.points, np.zeros_like(coarse.normals))


def pose_of(cell, edge):
    """The pose of a large cell; height and tilt do not matter here."""
    heading, y, x = cell
    return Pose((x + 0.5) * edge, (y + 0.5) * edge, 0.0, 0.0, 0.0, float(HEADINGS[heading]))


def coarse(epoch, regions, points, truth):
    """The best large cell by count alone, by branch and bound."""
    found, milliseconds = timed(lambda: filter_cells(without_bins(points), regions, 1.0))
    return row(epoch, "count, bounds", "", pose_of(found.cells[0], regions.map.cell), truth, milliseconds)


def best_of_all(scan, regions):
    """The best large cell by count alone, by counting all."""
    turned, best, cell = scan.turned(HEADINGS, regions.map.cell), -1, None
    for key, is_standable in regions.allowed.items():
        bins = regions.map.region(key).bins
        squares = 2 * np.argwhere(is_standable.reshape(REGION // 2, 2, REGION // 2, 2).any(axis=(1, 3)))
        for heading in range(len(HEADINGS)):
            nodes = np.column_stack([np.full(len(squares), heading), squares])
            cells, counts = nodes[:, None] + PARTS, np.empty((len(nodes), 4), np.uint16)
            kernels.count_children(bins, *turned, nodes, 1, regions.map.margin, counts)
            is_allowed = is_standable[cells[..., 1], cells[..., 2]]
            cells, counts = cells[is_allowed], counts[is_allowed]
            if counts.max() > best:
                best = counts.max()
                cell = cells[counts.argmax()] + [0, key[1] * REGION, key[0] * REGION]
    return cell


def exhaustive(epoch, regions, points, truth):
    """The same cell by counting all."""
    cell, milliseconds = timed(lambda: best_of_all(without_bins(points), regions))
    return row(epoch, "count, exhaustive", "", pose_of(cell, regions.map.cell), truth, milliseconds)


def print_rows(rows, title):
    """A table of the methods."""
    print("\n| | epochs | right | localized | localized, wrong | other words | median CPU ms | 95 % |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for method in dict.fromkeys(each["method"] for each in rows):
        mine = [each for each in rows if each["method"] == method]
        localized = [each for each in mine if each["status"] == "localized"]
        others = Counter(each["status"] for each in mine if each["status"] not in ("", "localized"))
        taken = [each["cpu_ms"] for each in mine]
        print(
            f"| {title}: {method} | {len(mine)} | {sum(each['is_right'] for each in mine)} | {len(localized)}"
            f" | {sum(not each['is_right'] for each in localized)}"
            f" | {', '.join(f'{number} {status}' for status, number in others.items()) or '-'}"
            f" | {np.median(taken):.0f} | {np.quantile(taken, 0.95):.0f} |",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset")
    parser.add_argument("--map")
    parser.add_argument("--epochs", type=int, default=100)
    parser.add_argument("--radius", type=float)
    parser.add_argument("--coarse", action="store_true")
    parser.add_argument("--exhaustive", type=int, default=0)
    parser.add_argument("-o", "--out")
    options = parser.parse_args()
    dataset = Dataset.open(options.dataset)
    point_map = PointMap.open(options.map or dataset.map_path)
    scans, reference = dataset.open_scans(), read_trajectory(dataset.reference)
    title = f"{dataset.path.stem} in {Path(options.map or dataset.map_path).stem}"
    header(f"No prior but the map: {title}")
    rng, whole, rows = np.random.default_rng(29), Relocalizer(point_map), []
    regions = whole.coarse
    n_places = whole.n_cells // round(360 / STEP_DEG)
    print(f"{whole.n_cells:,} large cells, {n_places:,} places in {len(regions.allowed)} regions")
    epochs = np.unique(np.linspace(0, len(scans) - 1, options.epochs).round().astype(int)).tolist()
    relocalized(-1, whole, scans.read(epochs[0], 1.0, 120.0).points, None)  # compiles, reads the map
    for number, epoch in enumerate(epochs):
        raw = scans.read(epoch, 1.0, 120.0)
        truth = None if options.map else point_map.frame.pose_to_local(reference.at(raw.time, 0.5))
        relocalizer = whole
        if options.radius:
            turn, away = (rng.uniform(0.0, 2.0 * math.pi), FARTHEST_SHARE * options.radius * math.sqrt(rng.uniform()))
            around = truth.x + away * math.cos(turn), truth.y + away * math.sin(turn)
            relocalizer = whole.within(around, options.radius)
        rows.append(relocalized(epoch, relocalizer, raw.points, truth))
        if options.coarse:
            rows.append(coarse(epoch, regions, raw.points, truth))
        if number * options.exhaustive // len(epochs) != (number + 1) * options.exhaustive // len(epochs):
            rows.append(exhaustive(epoch, regions, raw.points, truth))
    print_rows(rows, title)
    if options.out:
        with atomic_file(options.out) as partial, partial.open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, restval="")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
