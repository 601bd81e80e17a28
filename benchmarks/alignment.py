# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Do rounds that were displaced come together, and what does a map of them gain?

python benchmarks/displaced_rounds.py CAMPAIGN DISPLACED --drift 0.02
maxcon map align DISPLACED/map/*.laz --trajectory DISPLACED/map/trajectory.txt --vehicle-class 64 -o ALIGNED
python benchmarks/alignment.py judge CAMPAIGN DISPLACED/map ALIGNED
maxcon map build FOLDER/*.laz --trajectory FOLDER/trajectory.txt --vehicle-class 64 -o FOLDER.map    (of both)
python benchmarks/alignment.py localize CAMPAIGN BEFORE.map AFTER.map --epochs 60
python benchmarks/alignment.py picture BEFORE AFTER wall.png --at X,Y --towards DEGREES --heights LOW,HIGH
"""

import argparse
from pathlib import Path

import numpy as np
from displaced_rounds import truth_of
from header import header

from maxcon.io.trajectories import read_trajectory

PAUSE = 20.0
"""Between two rounds of the trajectory, s."""
STEP = 5.0
"""Between two places at which rounds are compared, m."""
MOST_DRAWN = 4000
"""Points of a round in the picture."""
NEAR = 4.0
"""A round was at a place if it came so near, m."""


def options_of_truth():
    """Of the campaign of seed 0; what its rounds are displaced by is not asked for."""
    return argparse.Namespace(campaign_seed=0, seed=0, sigma=0.0, sigma_deg=0.0, drift=0.0)


def errors_at_places(true, times, positions):
    """Errors of each round at places along the first, (n_places, n_passes, 3), m; NaN where one was not there.

    true, positions : (n, 3), where the vehicle was, and is said to have been, at times, (n,), s.
    """
    rounds = np.concatenate([[0], np.cumsum(np.diff(times) > PAUSE)])
    first = true[rounds == 0]
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(first, axis=0), axis=1))])
    places = first[np.unique(np.searchsorted(walked, np.arange(0.0, walked[-1], STEP)).clip(0, len(first) - 1))]
    errors = np.full((len(places), rounds.max() + 1, 3), np.nan)
    for number in range(rounds.max() + 1):
        rows = np.flatnonzero(rounds == number)
        for k, place in enumerate(places):
            distances = np.hypot(*(true[rows, :2] - place[:2]).T)
            nearest = int(np.argmin(distances))
            if distances[nearest] < NEAR:
                errors[k, number] = (positions - true)[rows[nearest]]
    return places, errors


def without_common_motion(places, errors):
    """Mean errors of all rounds at places, less the shift and turn that fit them best, (n_places, 3), m; and these."""
    mean = np.nanmean(errors, axis=1)
    arms = places - places.mean(axis=0)
    design = np.zeros((len(places), 3, 6))
    design[:, range(3), range(3)] = 1.0
    design[:, 0, 4], design[:, 0, 5] = arms[:, 2], -arms[:, 1]
    design[:, 1, 3], design[:, 1, 5] = -arms[:, 2], arms[:, 0]
    design[:, 2, 3], design[:, 2, 4] = arms[:, 1], -arms[:, 0]
    fitted = np.linalg.lstsq(design.reshape(-1, 6), mean.ravel(), rcond=None)[0]
    return mean - design @ fitted, fitted


def judge(options):
    """Print how far rounds lie apart at one place, and where all of them are, before and after."""
    believed, _ = truth_of(options_of_truth())
    read = read_trajectory(options.campaign / "map/trajectory.txt")
    true = read.positions - believed.at(read.times)
    header("Alignment")
    print("| | apart at a place, median m | 95 % | worst | mean of the rounds from where it was, m | bent, median m |")
    print("|---|---|---|---|---|---|")
    for name, folder in (("before", options.before), ("after", options.after)):
        positions = read_trajectory(folder / "trajectory.txt").positions
        places, errors = errors_at_places(true, read.times, positions)
        apart = np.linalg.norm(errors - np.nanmean(errors, axis=1, keepdims=True), axis=2)
        apart = apart[np.isfinite(apart)]
        bent, common = without_common_motion(places, errors)
        turn, bent = np.degrees(np.linalg.norm(common[3:])), np.median(np.linalg.norm(bent, axis=1))
        print(
            f"| {name} | {np.median(apart):.4f} | {np.percentile(apart, 95):.4f} | {apart.max():.4f}"
            f" | {np.linalg.norm(common[:3]):.3f} and {turn:.3f} degrees | {bent:.4f} |"
        )


def localize(options):
    """Print errors of localized epochs in both maps, as they are and beside their common shift and turn."""
    from maxcon import MaximumConsensus, PointMap
    from maxcon.lab.baselines import Gicp
    from maxcon.lab.dataset import Dataset

    dataset = Dataset.open(options.campaign)
    maps = {"before": PointMap.open(options.before), "after": PointMap.open(options.after)}
    epochs = covered_epochs(dataset, maps["before"], options.epochs)
    header("Localization before and after alignment")
    print("| map | its sigma, m | method | epochs | localized | median / 95 % m | beside the common motion, m |")
    print("|---|---|---|---|---|---|---|")
    for name, point_map in maps.items():
        found = {"maxcon": [], "GICP, gate 1 m, from maxcon's pose": []}
        for scan, prior, truth in epochs:
            truth, prior = (point_map.frame.pose_to_local(pose) for pose in (truth, prior))
            estimate = MaximumConsensus().localize(scan, point_map, prior)
            by_gicp = Gicp(gate=1.0).localize(scan, point_map, estimate.pose)
            for rows, each in zip(found.values(), (estimate, by_gicp), strict=True):
                error = each.pose.position - truth.position
                rows.append((*truth.position[:2], *error[:2], each.status.value == "localized"))
        for method, rows in found.items():
            rows = np.array(rows)
            raw, left = rows[:, 2:4], without_common_turn(rows[:, :2], rows[:, 2:4])
            sizes = [" / ".join(f"{np.percentile(np.hypot(*e.T), q):.4f}" for q in (50, 95)) for e in (raw, left)]
            n_localized = int(rows[:, 4].sum())
            print(f"| {name} | {point_map.sigma} | {method} | {len(rows)} | {n_localized} | {sizes[0]} | {sizes[1]} |")


def covered_epochs(dataset, point_map, n_epochs):
    """Scans, priors and reference poses, global, evenly over the epochs whose surroundings are in a map."""
    from maxcon import Scan

    scans, reference = dataset.open_scans(), read_trajectory(dataset.reference)
    prior = read_trajectory(dataset.priors["gnss"])
    local = reference.positions - point_map.frame.origin
    covered = [
        k
        for k, (x, y, _) in enumerate(local)
        if all(point_map.covers(x + dx, y + dy) for dx in (-40.0, 0.0, 40.0) for dy in (-40.0, 0.0, 40.0))
    ]
    chosen = []
    for k in np.array(covered)[np.linspace(0, len(covered) - 1, n_epochs).astype(int)].tolist():
        raw = scans.read(k, 1.0, 120.0)
        chosen.append((Scan(raw.points, time=raw.time), prior.at(raw.time), reference.at(raw.time)))
    return chosen


def without_common_turn(places, errors):
    """Horizontal errors, (n, 2), less the shift and turn that fit most of them, by medians of absolute values."""
    from scipy.optimize import least_squares

    arms = places - places.mean(axis=0)

    def left(unknowns):
        turned = np.column_stack([-arms[:, 1], arms[:, 0]]) * unknowns[2]
        return errors - unknowns[:2] - turned

    found = least_squares(
        lambda unknowns: left(unknowns).ravel(), np.zeros(3), loss="soft_l1", f_scale=0.02, x_scale=[1, 1, 0.01]
    )
    return left(found.x)


def picture(options):
    """Draw a cross section of a wall, before and after, coloured by pass, and say how thick it is."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from maxcon.plotting.figure import SERIES

    figure, axes = plt.subplots(1, 2, figsize=(11.0, 4.6), sharex=True, sharey=True)
    for axis, folder, name in zip(axes, (options.before, options.after), ("before", "after"), strict=True):
        across, height, rounds = section(folder, options)
        middle = np.median(across)
        for number, color, mark in zip(np.unique(rounds), SERIES, "osD^v", strict=False):
            rows = np.flatnonzero(rounds == number)
            rows = rows[:: max(1, len(rows) // MOST_DRAWN)]
            axis.plot(
                100.0 * (across[rows] - middle), height[rows], mark, c=color, ms=2, mew=0, label=f"pass {number + 1}"
            )
        low, high = (float(value) for value in options.heights.split(","))
        is_wall = (height >= low) & (height <= high)
        medians = [np.median(across[is_wall & (rounds == number)]) for number in np.unique(rounds[is_wall])]
        words = f"medians of the passes differ by {1000 * np.std(medians):.1f} mm (standard deviation)"
        print(f"{name}: {words}, {len(across):,} points")
        axis.set_title(f"{name}: {words}", fontsize=9)
        axis.set_xlabel("across the wall, cm")
    axes[0].set_ylabel("height, m")
    axes[0].legend(markerscale=4, fontsize=8)
    figure.tight_layout()
    figure.savefig(options.out, dpi=110)


def section(folder, options):
    """Points of a wall near a place: how far across, height, and pass."""
    import laspy

    at = np.array([float(value) for value in options.at.split(",")])
    angle = np.radians(options.towards)
    normal, along = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    parts = []
    for path in sorted(folder.glob("*.laz")):
        with laspy.open(path) as reader:
            low, high = reader.header.mins[:2], reader.header.maxs[:2]
            if ((at < low - 1.0) | (at > high + 1.0)).any():
                continue
            las = reader.read()
        points = np.column_stack([las.x, las.y]) - at
        rows = (np.abs(points @ along) < 1.0) & (np.abs(points @ normal) < options.within)
        rows &= np.asarray(las.classification) == 6
        parts.append(np.column_stack([points[rows] @ normal, np.asarray(las.z)[rows], las.gps_time[rows]]))
    across, height, times = np.concatenate(parts).T
    starts = np.sort(times)
    starts = starts[np.flatnonzero(np.diff(starts, prepend=-np.inf) > PAUSE)]
    return across, height, np.searchsorted(starts, times, side="right") - 1


def main():
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(required=True)
    for run, names in ((judge, ("campaign", "before", "after")), (localize, ("campaign", "before", "after")),
                       (picture, ("before", "after", "out"))):  # fmt: skip
        command = commands.add_parser(run.__name__)
        for name in names:
            command.add_argument(name, type=Path)
        command.set_defaults(run=run)
        if run is localize:
            command.add_argument("--epochs", type=int, default=60)
        if run is picture:
            command.add_argument("--at", required=True, help="x,y of the wall, m")
            command.add_argument("--towards", type=float, required=True, help="direction of its normal, degrees")
            command.add_argument("--heights", required=True, help="between which there is nothing but the wall, m")
            command.add_argument("--within", type=float, default=0.5, help="of the place, across, m")
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
