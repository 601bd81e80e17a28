# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How wrong may the prior be? Maximum consensus beside registration from one start, from many, and after a count.

python benchmarks/prior_error.py DATASET [DATASET ...] -o FOLDER [--epochs 16] [--levels 1:1 3:2 6:5 12:10 ...]

A DATASET is a dataset.toml, or a folder with one, and may be given a name: "city=city/dataset.toml". Maps are built
once, in FOLDER, with and without the ground; so are the answers, a Parquet table per drive, a row per level, epoch and
method. A run that was stopped goes on where it was. The tables are printed, the figure is put into docs/images.
"""

import argparse
import json
import os
import platform
from pathlib import Path

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from drives import DOCS, NamedDataset
from header import header
from levels import LEVELS, parse_level

import maxcon
from maxcon._system.atomic import atomic_file, make_folder
from maxcon._system.resumable import describe
from maxcon.errors import MaxconError, OptionError
from maxcon.lab.baselines import check_small_gicp
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.study import rows_by_method
from maxcon.lab.study.prior_trials import level_name, methods_at, statistics_by_level, with_levels
from maxcon.lab.study.run import spread_epochs
from maxcon.lab.study.table import keys_of, table_of


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
                " Name another folder, or remove what is in it."
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


def answers_of_drive(named, folder, levels, n_epochs, seed):
    """The answers to a drive; those in the folder are not made again, and each epoch is written when it is done."""
    kept = table_of(folder / named.name)
    methods = {level_name(level): methods_at(level) for level in levels}
    map_names = {method.map_name for found in methods.values() for method in found}
    bench = named.bench(folder, map_names)
    epochs, done = spread_epochs(len(bench.scans), n_epochs), set(keys_of(kept.read()))
    bench = with_levels(bench, levels, epochs, seed)
    is_compiled = False
    for number, epoch in enumerate(epochs, 1):
        for level, known in methods.items():
            missing = [method for method in known if (level, method.name, epoch) not in done]
            if missing and not is_compiled:
                bench.evaluate(level, epoch, missing)
                is_compiled = True
            if missing:
                kept.add(bench.evaluate(level, epoch, missing))
        print(f"{named.name}: epoch {number} of {len(epochs)}", flush=True)
    found = kept.merge()
    return found.filter(np.isin(found.column("epoch").to_numpy(), epochs))


def table(answers, levels):
    """Lines of Markdown: a row per level and method."""
    lines = [
        "| prior wrong by up to | method | right | called good | wrong but called good | ms, median | ms, 95 % |"
        " median error of the right, cm |",
        "|---" * 8 + "|",
    ]
    rows = {(each.prior, each.method): each for each in rows_by_method(answers)}
    for level, found in statistics_by_level(answers, levels).items():
        for number, one in enumerate(found):
            of_method = rows[level, one.method]
            distances = of_method.numbers("distance")[of_method.numbers("is_success") == 1.0]
            right = f"{one.n_success} of {one.n_epochs}"
            error = f"{100.0 * np.median(distances):.1f}" if len(distances) else "–"
            lines.append(
                f"| {'' if number else level} | {one.method} |"
                f" {f'**{right}**' if one.n_success == one.n_epochs else right} | {one.n_localized} |"
                f" {one.n_false} | {one.ms.median:.0f} | {one.ms.p95:.0f} | {error} |"
            )
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
        answers = answers_of_drive(named, arguments.out, arguments.levels, arguments.epochs, arguments.seed)
        summaries[f"{named.name}, {arguments.epochs} epochs"] = statistics_by_level(answers, arguments.levels)
        lines += [f"### {named.name}", "", *table(answers, arguments.levels), ""]
    print("\n".join(lines))
    plot_prior_error(arguments.figure, summaries)


if __name__ == "__main__":
    try:
        main()
    except MaxconError as error:
        raise SystemExit(f"prior_error: {error}") from error
