# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map from above: where scans were found, and what is left of all places for one of them.

python benchmarks/relocalization_plot.py DATASET ROWS.csv EPOCH -o PICTURE.png

ROWS.csv is of relocalization.py with the same DATASET. Left: the places of its scans, by the word of the answer; a line
leads from each true place to the one that was found. Right: of the scan of EPOCH, the highest count of any heading in
every large cell in which a scanner may stand, where it reaches the share that is looked at closer.
"""

import argparse
import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from maxcon import PointMap, Scan
from maxcon.lab.dataset import Dataset
from maxcon.refine import fit_ground_plane
from maxcon.relocalization import Relocalizer
from maxcon.relocalization.coarse_filter import CoarseScan, filter_cells
from maxcon.relocalization.kernels import REGION
from maxcon.relocalization.relocalizer import COARSE_RATIO, THINNING

COLOURS = {"localized": "#0072b2", "ambiguous": "#d98a00"}
WALL, GROUND, FOUND = "#4a4a4a", "#e3e9ef", "#c2185b"


def backdrop(axes, relocalizer):
    """Walls, and the cells in which a scanner may stand."""
    regions, edge = relocalizer.coarse, relocalizer.coarse.map.cell
    for key, is_allowed in regions.allowed.items():
        left, low = (first * REGION * edge for first in key)
        extent = (left, left + REGION * edge, low, low + REGION * edge)
        allowed = np.where(is_allowed, 1.0, np.nan)
        axes.imshow(
            allowed, origin="lower", extent=extent, cmap=plt.matplotlib.colors.ListedColormap([GROUND]), zorder=0
        )
        inside = slice(regions.map.margin, regions.map.margin + REGION)
        y, x = np.nonzero(regions.map.region(key).bins[1:, inside, inside].any(axis=0))
        axes.plot(left + (x + 0.5) * edge, low + (y + 0.5) * edge, ",", color=WALL, alpha=0.5, zorder=1)


def draw_answers(axes, rows):
    """True places and found ones."""
    for row in rows:
        x, y, found_x, found_y = (float(row[name]) for name in ("true_x", "true_y", "x", "y"))
        if row["is_right"] != "True":
            axes.plot([x, found_x], [y, found_y], "-", color=FOUND, lw=0.9, zorder=3)
    for status in dict.fromkeys(row["status"] for row in rows):
        mine = [row for row in rows if row["status"] == status]
        n_right = sum(row["is_right"] == "True" for row in mine)
        axes.plot(
            [float(row["true_x"]) for row in mine], [float(row["true_y"]) for row in mine], "o", ms=4.5,
            color=COLOURS.get(status, FOUND), zorder=4, label=f"{status}: {len(mine)}, {n_right} at the right place",
        )  # fmt: skip
    axes.set_title("Where the scans were taken, and what the answer said", fontsize=10)


def draw_candidates(axes, relocalizer, scan, row):
    """Large cells that one scan leaves open."""
    coarse = CoarseScan.of(scan.thinned(THINNING), fit_ground_plane(scan))
    found = filter_cells(coarse, relocalizer.coarse, COARSE_RATIO)
    places = (found.cells[::-1, [2, 1]] + 0.5) * relocalizer.coarse.map.cell
    drawn = axes.scatter(
        *places.T, c=found.counts[::-1] / found.counts[0], s=9, cmap="viridis_r", vmin=COARSE_RATIO, vmax=1.0, zorder=3
    )
    axes.figure.colorbar(drawn, ax=axes, fraction=0.04, pad=0.02, label="matches, over those of the best cell")
    for pose in relocalizer.search(scan).places[1:]:
        axes.plot(pose.x, pose.y, "s", ms=9, mfc="none", mec="#d98a00", mew=1.3, zorder=4)
    axes.plot(
        float(row["true_x"]), float(row["true_y"]), "+", ms=16, mew=2.0, color=FOUND, zorder=5, label="true place"
    )
    n_places = len(np.unique(found.cells[:, 1:], axis=0))
    share = 100.0 * len(found) / relocalizer.n_cells
    axes.set_title(
        f"Epoch {row['epoch']}: {len(found):,} of {relocalizer.n_cells:,} cells ({share:.3f} %, at {n_places} places)\n"
        f"reach {COARSE_RATIO:g} of the best; all others are excluded", fontsize=10,
    )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset")
    parser.add_argument("rows")
    parser.add_argument("epoch", type=int)
    parser.add_argument("-o", "--out", required=True)
    options = parser.parse_args()
    dataset = Dataset.open(options.dataset)
    with Path(options.rows).open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == "maxcon"]
    relocalizer = Relocalizer(PointMap.open(dataset.map_path))
    scan = Scan(dataset.open_scans().read(options.epoch, 1.0, 120.0).points)
    figure, (left, right) = plt.subplots(1, 2, figsize=(13.0, 6.6), sharex=True, sharey=True, layout="constrained")
    for axes in (left, right):
        backdrop(axes, relocalizer)
        axes.set(aspect="equal", xlabel="x, local frame (m)")
        axes.spines[["top", "right"]].set_visible(False)
    left.set_ylabel("y (m)")
    draw_answers(left, rows)
    draw_candidates(right, relocalizer, scan, next(row for row in rows if int(row["epoch"]) == options.epoch))
    left.legend(loc="lower right", fontsize=8, frameon=True)
    right.legend(loc="lower right", fontsize=8, frameon=True)
    (x_low, y_low), (x_high, y_high) = relocalizer.map.bounds
    left.set(xlim=(x_low, x_high), ylim=(y_low, y_high))
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main()
