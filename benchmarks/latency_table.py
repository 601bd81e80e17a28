# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The tables of what benchmarks/latency.py measured.

python benchmarks/latency_table.py FOLDER

Of the rounds' times each epoch keeps the median; p50, p95
and p99 are taken over the epochs.
"""

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from latency import MAXCON, STAGES, TABLE

PERCENTILES = (50, 95, 99)


@dataclass(frozen=True)
class Series:
    """What was measured of one method in one window of a drive.

    `epochs` are its rows by epoch, each a list of the rounds.
    """

    window: str
    method: str
    epochs: list[list[dict[str, str]]]

    def percentiles(self, column):
        """p50, p95 and p99 over the epochs, ms."""
        return np.percentile([_median(rows, column) for rows in self.epochs], PERCENTILES)

    @property
    def rest(self):
        """p50, p95 and p99 of what is in no stage, ms."""
        rest = [_median(rows, "ms") - sum(_median(rows, stage) for stage in STAGES) for rows in self.epochs]
        return np.percentile(rest, PERCENTILES)

    def count(self, *conditions):
        """Of how many epochs (column, value) all hold."""
        return sum(all(rows[0][column] == str(value) for column, value in conditions) for rows in self.epochs)

    @property
    def grown_mb(self):
        """Most memory that a call took, MiB."""
        return max(float(rows[0]["grown_mb"]) for rows in self.epochs)


def _median(rows, column):
    return float(np.median([float(row[column]) for row in rows]))


def read_series(folder):
    """Series by drive, in the order of the file: windows rising, methods as they were timed."""
    groups = {}
    with (Path(folder) / TABLE).open(newline="") as stream:
        for row in csv.DictReader(stream):
            window = f"{float(row['offset']):g} m, {float(row['heading_deg']):g}°"
            of_drive = groups.setdefault(row["drive"], {})
            of_drive.setdefault((window, row["method"]), {}).setdefault(row["epoch"], []).append(row)
    return {
        drive: [Series(*key, list(epochs.values())) for key, epochs in found.items()] for drive, found in groups.items()
    }


def table(drive, series):
    """Lines of Markdown of one drive."""
    first = series[0].epochs
    points = np.median([float(rows[0]["n_points"]) for rows in first])
    maps = {row["map"] for each in series if each.method != MAXCON for rows in each.epochs for row in rows}
    words = "with ground" if "ground" in maps else "without ground, as maxcon"
    lines = [
        f"### {drive}",
        "",
        f"{len(first)} epochs of {points:,.0f} points in the median, {len(first[0])} rounds; registrations in a map"
        f" {words}.",
        "",
        "| prior wrong by up to | method | p50 ms | p95 ms | p99 ms | right | called good | wrong but called good |"
        " most memory, MiB |",
        "|---" * 9 + "|",
    ]
    last = None
    for each in series:
        n_right, n_epochs = each.count(("is_right", True)), len(each.epochs)
        lines.append(
            f"| {'' if each.window == last else each.window} | {_bold(each.method, each.method == MAXCON)} |"
            f" {' | '.join(f'{number:.1f}' for number in each.percentiles('ms'))} |"
            f" {_bold(f'{n_right} of {n_epochs}', n_right == n_epochs)} | {each.count(('is_good', True))} |"
            f" {each.count(('is_good', True), ('is_right', False))} | {each.grown_mb:.0f} |"
        )
        last = each.window
    return [*lines, "", *stage_table([each for each in series if each.method == MAXCON]), ""]


def stage_table(ours):
    """Lines of Markdown: stages of maximum consensus, a column for each window."""
    lines = [
        f"| maxcon, ms: p50 / p95 / p99 | {' | '.join(each.window for each in ours)} |",
        "|---" * (len(ours) + 1) + "|",
    ]
    for stage in STAGES:
        lines.append(f"| {stage} | {' | '.join(_joined(each.percentiles(stage)) for each in ours)} |")
    lines.append(f"| all else | {' | '.join(_joined(each.rest) for each in ours)} |")
    lines.append(f"| **all** | {' | '.join(_joined(each.percentiles('ms')) for each in ours)} |")
    n_widened = [f"{each.count(('was_widened', True))} of {len(each.epochs)}" for each in ours]
    return [*lines, f"| in doubt, searched for once more | {' | '.join(n_widened)} |"]


def _joined(numbers):
    return " / ".join(f"{number:.1f}" for number in numbers)


def _bold(words, is_bold):
    return f"**{words}**" if is_bold else words


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    lines = [line for drive, series in read_series(arguments.folder).items() for line in table(drive, series)]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
