# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How wrong may the prior be? Maximum consensus beside registration from one start, from many, and after a count.

python benchmarks/prior_error.py DATASET [DATASET ...] -o FOLDER [--epochs 16] [--levels 1:1 3:2 6:5 12:10 ...]

A DATASET is a dataset.toml, or a folder with one, and may be given a name: "city=city/dataset.toml". Maps are built
once, in FOLDER, with and without the ground; so are the trials, a CSV per drive, a row per level, epoch and method. A
run that was stopped goes on where it was. The tables are printed, the figure is put into docs/images.
"""

import argparse
import json
import os
import platform
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from drives import DOCS, NamedDataset
from levels import LEVELS, parse_level
from scene import header

import maxcon
from maxcon._system.atomic import atomic_file, make_folder
from maxcon._system.resumable import describe
from maxcon.errors import MaxconError, OptionError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.study.prior_trials import methods_at, read_trials, summarize_trials, try_epoch, write_trials
from maxcon.lab.study.run import spread_epochs


def check_same(folder, settings):
    """Refuse a folder whose trials were made otherwise; write down how these are made."""
    file = folder / "settings.json"
    text = json.dumps(settings, indent=1, sort_keys=True)
    if file.exists():
        known = json.loads(file.read_text())
        shared = {key: value for key, value in settings.items() if key in known}
        if any(known[key] != value for key, value in shared.items()):
            raise OptionError(
                f"Expected {folder} to hold trials made with the same methods and seed, but it holds others."
                " Name another folder, or remove its *.csv and settings.json."
            )
        text = json.dumps(known | settings, indent=1, sort_keys=True)
    with atomic_file(file) as partial:
        partial.write_text(text)


def settings_of(levels, seed):
    """What trials depend on."""
    found = {"seed": seed, "maxcon": maxcon.__version__}
    for level in levels:
        methods = {method.name: [describe(method.method), method.map_name] for method in methods_at(level)}
        found[f"{level.offset:g}:{level.heading_deg:g}"] = methods
    return json.loads(json.dumps(found))


def trials_of_drive(named, folder, levels, n_epochs, seed):
    """All trials of a drive; those in the folder are not made again, and each epoch is written when it is done."""
    file = folder / f"{named.name}.csv"
    methods = {level: methods_at(level) for level in levels}
    map_names = {method.map_name for found in methods.values() for method in found}
    bench = named.bench(folder, map_names)
    trials = {trial.key: trial for trial in read_trials(file)}
    epochs, wanted = spread_epochs(len(bench.scans), n_epochs), []
    is_compiled = False
    for number, epoch in enumerate(epochs, 1):
        for level in levels:
            keys = {m.name: (level.offset, level.heading_deg, epoch, m.name) for m in methods[level]}
            missing = [method for method in methods[level] if keys[method.name] not in trials]
            if missing and not is_compiled:
                try_epoch(bench, epoch, level, missing, seed)
                is_compiled = True
            trials |= {trial.key: trial for trial in try_epoch(bench, epoch, level, missing, seed)}
            wanted += [trials[key] for key in keys.values()]
        write_trials(file, trials.values())
        print(f"{named.name}: epoch {number} of {len(epochs)}", flush=True)
    return wanted


def table(summaries):
    """Lines of Markdown: a row per level and method."""
    lines = [
        "| prior wrong by up to | method | right | called good | wrong but called good | ms, median | ms, 95 % |"
        " median error of the right, cm |",
        "|---" * 8 + "|",
    ]
    last = None
    for one in summaries:
        level = f"{one.offset:g} m, {one.heading_deg:g}°"
        right = f"{one.n_right} of {one.n_epochs}"
        error = f"{100.0 * one.median_error:.1f}" if one.n_right else "–"
        lines.append(
            f"| {'' if level == last else level} | {one.method} |"
            f" {f'**{right}**' if one.n_right == one.n_epochs else right} | {one.n_good} |"
            f" {one.n_wrong_but_good} | {one.median_ms:.0f} | {one.p95_ms:.0f} | {error} |"
        )
        last = level
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="+", metavar="DATASET")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--epochs", type=int, default=16)
    parser.add_argument("--levels", nargs="+", type=parse_level, default=list(LEVELS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--figure", type=Path, default=DOCS / "images" / "prior_error.svg")
    arguments = parser.parse_args()
    header("Success against the error of the prior")
    check_small_gicp()
    make_folder(arguments.out)
    check_same(arguments.out, settings_of(arguments.levels, arguments.seed))
    summaries, lines = {}, [f"Python {platform.python_version()}, seed {arguments.seed}.", ""]
    for named in [NamedDataset.of_word(word) for word in arguments.datasets]:
        trials = trials_of_drive(named, arguments.out, arguments.levels, arguments.epochs, arguments.seed)
        summaries[named.name] = summarize_trials(trials)
        lines += [f"### {named.name}", "", *table(summaries[named.name]), ""]
    print("\n".join(lines))
    plot_prior_error(arguments.figure, summaries)


if __name__ == "__main__":
    try:
        main()
    except MaxconError as error:
        raise SystemExit(f"prior_error: {error}") from error
