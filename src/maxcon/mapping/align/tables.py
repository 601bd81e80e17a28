# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What an alignment leaves beside the clouds: tables of rounds, pairs, ties and corrections, and a summary."""

import csv
import json
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from maxcon._system.regular_file import read_regular
from maxcon._system.version import __version__
from maxcon.mapping.align.alignment import Alignment
from maxcon.mapping.align.options import AlignmentOptions
from maxcon.mapping.align.residuals import is_contradicted

__all__ = ["TABLES", "files_there", "write_tables"]

SUMMARY, ROUNDS, PAIRS, TIES, CORRECTIONS = (
    "alignment.json", "rounds.csv", "residuals.csv", "ties.csv", "corrections.csv",
)  # fmt: skip
TABLES = (SUMMARY, ROUNDS, PAIRS, TIES, CORRECTIONS)
AXES = ("x", "y", "z")
LARGEST_SUMMARY = 2**24
"""Bytes."""


def write_tables(folder: Path, alignment: Alignment, options: AlignmentOptions, files: Sequence[str]) -> None:
    """Write all tables of an alignment; lengths in m, angles in degrees.

    Parameters
    ----------
    folder : Path
        Of the alignment.
    alignment : Alignment
        What was found.
    options : AlignmentOptions
        How.
    files : sequence of str
        Names of the corrected clouds and trajectories in the folder: an alignment that replaces it replaces them.
    """
    _write(folder / ROUNDS, *_rounds(alignment))
    _write(folder / PAIRS, *_pairs(alignment))
    _write(folder / TIES, *_ties(alignment))
    _write(folder / CORRECTIONS, *_corrections(alignment))
    text = json.dumps(_summary(alignment, options) | {"files": list(files)}, indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8", newline="\n")


def files_there(folder: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the names of all files of the alignment in a folder, as it says itself; of its tables, if it says none."""
    try:
        named = json.loads(read_regular(Path(folder) / SUMMARY, LARGEST_SUMMARY))["files"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        named = []
    names = named if isinstance(named, list) else []
    return (*TABLES, *(name for name in names if isinstance(name, str)))


Row = Sequence[object]


def _write(path: Path, head: Sequence[str], rows: Iterable[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([["" if _is_nan(value) else value for value in row] for row in rows])


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _rounds(alignment: Alignment) -> tuple[list[str], list[Row]]:
    head = ["round", "name", "n_points", "start_s", "end_s", "n_ties", "group"]
    head += [f"{what}_{axis}" for what in ("shift", "turn_deg", "sigma") for axis in AXES] + ["words"]
    rows: list[Row] = []
    for number, (each, tied) in enumerate(zip(alignment.rounds.rounds, alignment.tied, strict=True)):
        values = np.concatenate([tied.shift, np.degrees(tied.turn), tied.sigma])
        rows.append(
            [number + 1, each.name, each.n_points, each.start, each.end, tied.n_ties, tied.group + 1]
            + [round(value, 6) for value in values.tolist()]
            + [tied.words]
        )
    return head, rows


def _pairs(alignment: Alignment) -> tuple[list[str], list[Row]]:
    head = ["round_a", "round_b", "n_ties", "n_contradicted"]
    head += [
        f"{what}_{when}_{size}"
        for what in ("horizontal", "height")
        for when in ("before", "after")
        for size in ("median", "95")
    ]
    rows: list[Row] = []
    for pair in alignment.pairs:
        values = pair.horizontal_before + pair.horizontal_after + pair.height_before + pair.height_after
        first, second = pair.rounds
        rows.append([first + 1, second + 1, pair.n_ties, pair.n_contradicted, *(round(value, 5) for value in values)])
    return head, rows


def _ties(alignment: Alignment) -> tuple[list[str], list[Row]]:
    head = ["x", "y", "round_a", "round_b", "time_a", "time_b", "share", "weight", "is_contradicted"]
    head += [f"{what}_{axis}" for what in ("before", "after", "sigma") for axis in AXES]
    rows: list[Row] = []
    adjusted = alignment.adjusted
    for tie, residual, weight in zip(alignment.ties, adjusted.residuals, adjusted.weights.tolist(), strict=True):
        sigmas = np.sqrt(np.diag(tie.covariance)[:3])
        values = np.concatenate([tie.pose.position, residual[:3], sigmas])
        rows.append(
            [
                *(round(value, 3) for value in tie.place[:2].tolist()),
                tie.rounds[0] + 1, tie.rounds[1] + 1, round(tie.times[0], 3), round(tie.times[1], 3),
                round(tie.share, 3), round(weight, 4), int(is_contradicted(weight)),
                *(round(value, 5) for value in values.tolist()),
            ]
        )  # fmt: skip
    return head, rows


def _corrections(alignment: Alignment) -> tuple[list[str], list[Row]]:
    """A row for each knot: how what was measured then, about there, is moved."""
    head = ["round", "time", *AXES, *(f"shift_{axis}" for axis in AXES), *(f"turn_deg_{axis}" for axis in AXES)]
    rows: list[Row] = []
    corrections = alignment.adjusted.corrections
    for number in range(corrections.n_rounds):
        first, end = corrections.firsts[number], corrections.firsts[number + 1]
        for knot in range(first, end):
            time = float(corrections.starts[number] + (knot - first) * corrections.steps[number])
            place = corrections.knot_centres[knot]
            twist = corrections.twist_at(place, time, number)
            twist[3:] = np.degrees(twist[3:])
            rows.append([number + 1, round(time, 3), *np.round(place, 3).tolist(), *np.round(twist, 6).tolist()])
    return head, rows


def _summary(alignment: Alignment, options: AlignmentOptions) -> dict[str, object]:
    return {
        "program": f"maxcon {__version__}",
        "rounds_by": options.rounds_by,
        "georeference_sigma": options.georeference_sigma,
        "georeference_sigma_deg": options.georeference_sigma_deg,
        "drift_sigma": alignment.adjusted.drift_sigma,
        "drift_from": "the ties" if options.drift_sigma is None else "given",
        "n_rounds": len(alignment.rounds),
        "n_ties": len(alignment.ties),
        "n_contradicted": sum(map(is_contradicted, alignment.adjusted.weights.tolist())),
        "n_refused": dict(sorted(alignment.refused.items())),
        "inflation": round(alignment.adjusted.inflation, 3),
        "sigma": {
            "of_round_before": round(alignment.sigma_before, 5),
            "of_round": round(alignment.sigma_of_round, 5),
            "of_map": round(alignment.sigma_of_map, 5),
            "of_datum": round(alignment.sigma_of_datum, 5),
        },
        "words": [each.words for each in alignment.tied if each.words],
    }
