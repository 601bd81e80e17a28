# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Passes months apart: how often is the answer right, refused or wrong as more of the world has changed since the map?

python benchmarks/months_apart.py CAMPAIGN -o FOLDER [--shares 0 0.1 0.2 0.4 0.6 0.8] [--update 0.8] [--epochs 60]

CAMPAIGN is what `maxcon simulate CAMPAIGN --campaign` writes. Its map is built once, in FOLDER,
with and without the ground; of each share only scans are simulated, as by `maxcon simulate --campaign --changed SHARE`.
Priors are the same for all methods, anywhere within 12 m and 10 degrees; GICP has others within 3 m and 2 degrees, too.
Then the map is updated (`maxcon map update`) by a drive through the world of `--update`, as far as it is localized, and
another drive is localized in the map before and after. Answers go to FOLDER/months.csv; shares that stand there are not
made again. The figure is put into docs/images.

Right: within 0.3 m and 1 degree, and called good. Refused: not called good. Wrong: called good, and not right.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

import numpy as np
from drives import CACHE_BYTES, DOCS, NamedDataset
from header import header
from typer.testing import CliRunner

from maxcon import MaximumConsensus, PointMap, Scan
from maxcon.cli import app
from maxcon.errors import MaxconError
from maxcon.lab.evaluation import pose_error
from maxcon.lab.report.charts import METHOD_STYLES, draw_grid, draw_legend
from maxcon.lab.simulation.datasets import CITY_ORIGIN, write_epochs
from maxcon.lab.simulation.scanners import RotatingScanner
from maxcon.lab.simulation.worlds import CampaignWorld
from maxcon.lab.study.methods import STANDARD, StudyMethod
from maxcon.lab.study.prior_trials import COUNT_THEN_GICP, MAXCON, methods_at, prior_at, prior_level
from maxcon.plotting.figure import saved_figure

FAR, NEAR, SCANNER, SEED = prior_level(12.0, 10.0), prior_level(3.0, 2.0), RotatingScanner(), 0
GICP = "GICP, gate 3 m"
NEAR_GICP, UPDATED = f"{GICP}, priors within 3 m and 2°", "maxcon, map updated"
STYLES = [METHOD_STYLES[number] for number in (0, 1, 3)] + [METHOD_STYLES[7]._replace(color="#b0b5c0", line=(0, None))]
OUTCOMES = ("right", "refused", "wrong")
COLUMNS = {
    "share": float, "measured": float, "drive": int, "method": str, "epoch": int, "outcome": str, "is_right": int,
    "distance": float, "heading_deg": float, "status": str,
}  # fmt: skip


def compared():
    """The methods by name, each with the level of its priors."""
    far, near = ({each.name: each for each in methods_at(level, gates=(3.0,))} for level in (FAR, NEAR))
    return {name: (far[name], FAR) for name in (MAXCON, COUNT_THEN_GICP, GICP)} | {NEAR_GICP: (near[GICP], NEAR)}


def answers(world, share, n_epochs, methods, maps):
    """Rows of the answers of methods to a drive through a changed world."""
    epochs, rows = world.epochs(n_epochs), []
    measured = round(world.changed_ratio(epochs, SCANNER), 4)
    for epoch in epochs:
        returns = world.scan(epoch, SCANNER)
        points = (returns.points - epoch.reference.position) @ epoch.reference.rotation
        scan, reference = Scan(points.astype(np.float32)), epoch.reference.translated(CITY_ORIGIN)
        for name, (method, level) in methods.items():
            point_map = maps[method.map_name]
            truth = point_map.frame.pose_to_local(reference)
            answer = method.method.localize(scan, point_map, prior_at(truth, level, SEED, epoch.tick))
            error = pose_error(answer.pose, truth)
            outcome = "refused" if not answer.is_localized else "right" if error.is_success else "wrong"
            about = (int(error.is_success), round(error.distance, 4), round(np.degrees(error.heading), 3))
            rows.append((share, measured, world.drive_number, name, epoch.tick, outcome, *about, answer.status.value))
    return rows


def updated(world, share, path, folder):
    """Path of the map, updated by the localized epochs of a drive through a changed world, with a user's commands."""
    drive, poses, out = folder / f"drive-{share:g}", folder / f"drive-{share:g}.csv", folder / f"updated-{share:g}.map"
    if not drive.exists():
        drive.mkdir(parents=True)
        epochs = world.epochs(301)  # 5 m apart
        scans = (world.scan(epoch, SCANNER) for epoch in epochs)
        write_epochs(drive, epochs, scans, {"prior_gnss.txt": world.gnss_priors(epochs)})
    if not out.exists():
        typed("localize", path, drive / "scans", "--prior", drive / "prior_gnss.txt", "-o", poses, "--overwrite")
        print(typed("map", "update", path, drive / "scans", poses, "-o", out))
    return out


def typed(*words):
    """What a command printed; it may have left out epochs."""
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--quiet")])
    if result.exit_code > 1:
        raise MaxconError(result.output.strip())
    return result.output.strip()


def read(file):
    """Rows of a table of answers."""
    rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()[1:])) if file.exists() else []
    return [tuple(kind(value) for kind, value in zip(COLUMNS.values(), row, strict=True)) for row in rows]


def write(file, rows):
    """Write a table of answers."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([COLUMNS, *rows])


def summaries(rows):
    """Per cent of returns that changed, of each outcome, and of answers right if refused too, by method and drive."""
    groups = defaultdict(list)
    for row in rows:
        groups[row[3], row[2], row[0]].append(row)
    found = defaultdict(list)
    for (method, drive, _), group in sorted(groups.items()):
        parts = [100.0 * np.mean([row[5] == outcome for row in group]) for outcome in OUTCOMES]
        found[method, drive].append((100.0 * group[0][1], *parts, 100.0 * np.mean([row[6] for row in group])))
    return {key: np.array(values) for key, values in found.items()}


def draw(path, rows):
    """Three panels over the ratio of the returns that changed: right, refused, wrong."""
    found, n_epochs = summaries(rows), len({row[4] for row in rows if row[2] == 0})
    words = (
        f"{n_epochs} scans at each ratio. Right: within 0.3 m and 1°, and called good. Refused: not called good.\n"
        "Wrong: called good, and not right. Priors within 12 m and 10° where nothing else is said."
    )
    blue, looks = STYLES[0].color, {}
    for name, style in zip(compared(), STYLES, strict=True):
        wide = {MAXCON: {"lw": 2.8, "ms": 8.5}, NEAR_GICP: {"lw": 4.0, "ms": 10.0}}.get(name, {"lw": 1.6, "ms": 6.5})
        looks[name, 0] = {"color": style.color, "ls": style.line, "marker": style.marker, "mec": "white", **wide}
    for name, face in ((MAXCON, "white"), (UPDATED, blue)):
        looks[name, 1] = {"mec": blue, "mfc": face, "ms": 12.0, "ls": "", "marker": "*"}
    labels = [*compared(), f"{MAXCON}, another drive", "the same, map updated"]
    with saved_figure(path, 9.6, 5.2, "Months between map and drive", words) as figure:
        for number, (axes, outcome) in enumerate(zip(figure.subplots(1, 3, sharey=True), OUTCOMES, strict=True), 1):
            marks = []
            for order, (key, look) in enumerate(looks.items()):
                above = order if key[1] else 4 - order
                marks += axes.plot(*found[key][:, [0, number]].T, **look, clip_on=False, zorder=3.0 + above)
            axes.set(title=outcome, xlabel="returns that changed [%]", xlim=(0.0, None), ylim=(0.0, 103.0))
            draw_grid(axes)
            axes.spines[["top", "right"]].set_visible(False)
        figure.axes[0].set_ylabel("scans [%]")
        draw_legend(figure, marks, labels)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", metavar="CAMPAIGN")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.1, 0.2, 0.4, 0.6, 0.8])
    parser.add_argument("--update", type=float, default=0.8, metavar="SHARE")
    parser.add_argument("--epochs", type=int, default=60)
    args = parser.parse_args()
    header("Passes months apart")
    methods, file = compared(), args.out / "months.csv"
    paths = NamedDataset.of_word(args.campaign).maps(args.out, {method.map_name for method, _ in methods.values()})
    maps, rows = {name: PointMap.open(path, cache_bytes=CACHE_BYTES) for name, path in paths.items()}, read(file)
    for share in args.shares:
        if not any(row[0] == share and row[2] == 0 for row in rows):
            world = CampaignWorld.build(SEED, changed=share)
            rows += answers(world, share, args.epochs, methods, maps)
            write(file, rows)
    if not any(row[2] == 1 for row in rows):
        world = CampaignWorld.build(SEED, changed=args.update)
        after = updated(world, args.update, paths[STANDARD], args.out)
        methods = {MAXCON: methods[MAXCON], UPDATED: (StudyMethod(UPDATED, MaximumConsensus(), UPDATED), FAR)}
        maps[UPDATED] = PointMap.open(after)
        rows += answers(world.again(1), args.update, args.epochs, methods, maps)
        write(file, rows)
    print("| method | drive | changed, right, refused, wrong, right or refused but right, % |\n|---|---|---|")
    for (name, drive), values in summaries(rows).items():
        print(f"| {name} | {drive} |", "; ".join(" ".join(f"{value:.0f}" for value in row) for row in values), "|")
    draw(DOCS / "images" / "months_apart.svg", rows)


if __name__ == "__main__":
    main()
