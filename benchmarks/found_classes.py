# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How right are the classes that a map build finds? Precision and recall of points, beside the classes of the clouds.

python benchmarks/found_classes.py CLOUD... [--temporary 64] [--unsure 1] [--area X_MIN,Y_MIN,X_MAX,Y_MAX]
                                   [--cell 0.06]

The classes of the clouds are held for true: ground 2, 11 and 20; vegetation 3 to 5; temporary those of --temporary.
Points of the classes of --unsure count for nothing in a precision: a survey leaves most hedges unclassified.
Heights are of cells of the ground grid that both the found and the true ground have.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from header import header

from maxcon.io.clouds import open_cloud
from maxcon.map import TILE_VOXELS
from maxcon.map.ground import ground_of_points, ground_voxels
from maxcon.mapping.build import Area
from maxcon.mapping.build.found_classes import OBSERVATION, describe_found, observation_records
from maxcon.mapping.build.ground import GROUND_POINT, ground_records
from maxcon.mapping.build.tile_points import POINT, TileBuckets, VoxelMoments, point_records
from maxcon.mapping.build.tiles import TileJob, TileMaker

TRUTH = ("ground", "vegetation", "temporary", "unsure", "other")


def truth_of(classes, arguments):
    """Number in TRUTH of each point."""
    truth = np.full(len(classes), TRUTH.index("other"))
    for name, numbers in (
        ("ground", (2, 11, 20)),
        ("vegetation", (3, 4, 5)),
        ("temporary", arguments.temporary),
        ("unsure", arguments.unsure),
    ):
        truth[np.isin(classes, list(numbers))] = TRUTH.index(name)
    return truth


def sorted_points(arguments, folder):
    """Sort all points into tiles twice, true classes beside them, with times of observation and the true ground."""
    buckets = [TileBuckets(folder / name, POINT, "points") for name in ("a", "b")]
    seen, ground = (TileBuckets(folder / "a", *kind) for kind in ((OBSERVATION, "seen"), (GROUND_POINT, "ground")))
    area, origin = (Area.parse(arguments.area) if arguments.area else None), None
    for cloud in arguments.clouds:
        with open_cloud(cloud) as reader:
            for chunk in reader.chunks():
                inside = np.ones(len(chunk.points), bool) if area is None else area.contains(chunk.points)
                if not inside.any():
                    continue
                points, truth = chunk.points[inside], truth_of(chunk.classes[inside], arguments)
                if origin is None:
                    edge = TILE_VOXELS * arguments.cell
                    origin = np.floor(points[0] / edge) * edge
                flags = (truth[:, None] == np.arange(len(TRUTH))).astype(np.float32)
                buckets[0].add(*point_records(points - origin, flags[:, :3], arguments.cell))
                others = np.column_stack([flags[:, 3:], np.zeros(len(points))])
                buckets[1].add(*point_records(points - origin, others, arguments.cell))
                if chunk.times is not None:
                    seen.add(*observation_records(points - origin, chunk.times[inside], arguments.cell))
                ground.add(*ground_records((points - origin)[truth == 0], arguments.cell))
    for each in (*buckets, seen, ground):
        each.complete()
    return buckets, seen, ground


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clouds", nargs="+")
    parser.add_argument("--temporary", type=int, nargs="*", default=[])
    parser.add_argument("--unsure", type=int, nargs="*", default=[])
    parser.add_argument("--area")
    parser.add_argument("--cell", type=float, default=0.06)
    arguments = parser.parse_args()
    header("Found classes")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "a").mkdir()
        (folder / "b").mkdir()
        (one, other), seen, true_ground = sorted_points(arguments, folder)
        start = time.process_time()
        job = TileJob(folder / "a", arguments.cell, has_normals=False, is_signed=False, drop=frozenset())
        maker = TileMaker(job, one, seen)
        for key in one.keys:
            maker.gather(key)
        found = [maker.find_classes(key) for key in one.keys]
        said = describe_found(found, frozenset(), has_times=bool(seen.keys))
        table = np.zeros((256, len(TRUTH)))
        for key in one.keys:
            first = maker.moments(key).sides
            second = VoxelMoments.from_records(other.records(key)).sides[:, :2]
            np.add.at(table, maker.classes(key), np.column_stack([first, second]))
        report(table, said, time.process_time() - start)
        heights(found, true_ground, arguments.cell)


def report(table, said, seconds):
    """Print what became of the points of each true class, and precision and recall."""
    rows = {"ground": [2], "vegetation": [3, 4, 5], "temporary": [22], "none": [1]}
    counts = {name: table[numbers].sum(axis=0) for name, numbers in rows.items()}
    print(f"{table.sum():,.0f} points, {seconds:.0f} s of processor time; {said}")
    print("| found | " + " | ".join(TRUTH) + " |\n|---" + "|---" * len(TRUTH) + "|")
    for name, row in counts.items():
        print(f"| {name} | " + " | ".join(f"{number:,.0f}" for number in row) + " |")
    for place, name in enumerate(TRUTH[:3]):
        right, true = counts[name][place], table[:, place].sum()
        said = counts[name].sum() - counts[name][TRUTH.index("unsure")]
        print(f"{name}: precision {100 * right / max(said, 1):.2f} %, recall {100 * right / max(true, 1):.2f} %")


def heights(found, true_ground, cell):
    """Print how far the found ground lies from the true one."""
    n, differences, n_true = TILE_VOXELS // ground_voxels(cell), [np.empty(0)], 0
    tiles = {each.ground.key: each.ground for each in found if each.ground.n_heights}
    for key in true_ground.keys:
        records = true_ground.load(key)
        true = ground_of_points(records["column"], records["height"], n)[0]
        n_true += np.isfinite(true).sum()
        if key in tiles:
            both = tiles[key].heights[0] - true
            differences.append(both[np.isfinite(both)])
    d = np.abs(np.concatenate(differences))
    if len(d):
        print(
            f"heights: {len(d):,} of {n_true:,} cells ({100 * len(d) / n_true:.1f} %); median {100 * np.median(d):.1f},"
            f" p95 {100 * np.quantile(d, 0.95):.1f} cm; {100 * np.mean(d < 0.1):.2f} % below 10 cm"
        )


if __name__ == "__main__":
    main()
