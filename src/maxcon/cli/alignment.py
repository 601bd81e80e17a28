# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map align`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.compiling import compiling_told
from maxcon.cli.progress import step_bars

if TYPE_CHECKING:
    from maxcon.mapping.align import Alignment

__all__ = ["align"]

MOST_PAIRS = 15
"""In the printed table; residuals.csv has all."""


def align(
    clouds: Annotated[
        list[Path], typer.Argument(metavar="CLOUD...", help="LAS or LAZ files of all rounds, in tiles or whole.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write.")],
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="TUM|CSV",
            help="Where the mapping sensor was, in the times of the points: corrected as they are; repeatable.",
        ),
    ] = None,
    rounds: Annotated[
        str,
        typer.Option(
            metavar="time|source|file", help="What tells rounds apart: pauses in gps_time, point source ids, or files."
        ),
    ] = "time",
    pause: Annotated[
        float, typer.Option(metavar="S", help="Seconds without a point between two rounds, by time.")
    ] = 20.0,
    georeference_sigma: Annotated[
        float,
        typer.Option(
            metavar="M", help="How well each round is georeferenced: standard deviation along any axis, in m."
        ),
    ] = 0.1,
    georeference_sigma_deg: Annotated[
        float, typer.Option(metavar="DEG", help="The same of its roll, pitch and heading, in degrees.")
    ] = 0.05,
    drift_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Standard deviation of how a round's errors change within it, in m; 0: rounds are rigid. Default: what"
            " the matches ask for.",
            show_default=False,
        ),
    ] = None,
    knots: Annotated[
        float, typer.Option(metavar="S", help="Corrections that drift are free every so many seconds.")
    ] = 10.0,
    drop: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CLASS",
            help="Class that is not matched, by name or number; repeatable. Default: vegetation, noise,"
            " temporal-exclusion.",
        ),
    ] = None,
    vehicle_class: Annotated[
        list[int] | None,
        typer.Option(metavar="NUMBER", help="Class number that means vehicles: not matched; repeatable."),
    ] = None,
    crs: Annotated[
        str | None, typer.Option(metavar="EPSG:N|WKT", help="CRS of clouds that name none themselves.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the alignment if there is one.")] = False,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Places matched at once, 0.4 GiB each. Default: processors, at most 4.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Bring rounds of a mapping campaign together: match them, adjust them, write corrected clouds."""
    from maxcon.mapping.align import AlignmentOptions, align_files

    options = AlignmentOptions(
        rounds_by=rounds,
        pause=pause,
        georeference_sigma=georeference_sigma,
        georeference_sigma_deg=georeference_sigma_deg,
        drift_sigma=drift_sigma,
        knot_spacing=knots,
        drop=drop or None,
        vehicle_classes=tuple(vehicle_class or ()),
        crs=crs,
    )
    with step_bars("", quiet) as report, compiling_told(quiet):
        found = align_files(
            clouds, out, options, trajectories=trajectory or (), overwrite=overwrite, n_threads=threads, progress=report
        )
    typer.echo(f"{out}")
    _describe(found)


def _describe(found: "Alignment") -> None:
    """Print how far rounds lay apart and lie apart, and what that says of a map."""
    drift = found.adjusted.drift_sigma
    rows = [
        ("rounds", f"{len(found.rounds)}, told apart by {found.rounds.by}"),
        ("ties", _ties(found)),
        ("corrections", f"a motion of each round{f', and drift of {drift:g} m' if drift else ', rigid'}"),
    ]
    for name, text in rows:
        typer.echo(f"{name:<12} {text}")
    _table(found)
    typer.echo(
        f"{'sigma':<12} one round beside the others {found.sigma_before:.4f} m before, {found.sigma_of_round:.4f} m"
        f" after; a map of all of them {found.sigma_of_map:.4f} m: `map build` finds it in alignment.json"
    )
    in_crs = math.hypot(found.sigma_of_map, found.sigma_of_datum)
    typer.echo(
        f"{'datum':<12} the mean of the rounds' georeference, known to {found.sigma_of_datum:.3f} m: where answers have"
        f" to hold in the CRS, --sigma {in_crs:.3f}"
    )
    for each in found.tied:
        if each.words:
            typer.echo(f"{'note':<12} {each.words}")


def _ties(found: "Alignment") -> str:
    from maxcon.mapping.align.residuals import is_contradicted

    n_contradicted = sum(map(is_contradicted, found.adjusted.weights.tolist()))
    text = f"{len(found.ties):,} matched pairs of visits, {n_contradicted:,} of them contradict the others"
    for words, number in sorted(found.refused.items()):
        text += f"; of {number:,} more {words}"
    return text


def _table(found: "Alignment") -> None:
    """Distances between rounds, pair by pair."""
    typer.echo(f"{'rounds':<12} {'ties':>5}  {'horizontal, median / 95 % m':>35}  {'height, median m':>18}")
    pairs = found.pairs
    for pair in pairs[:MOST_PAIRS]:
        first, second = (number + 1 for number in pair.rounds)
        (before, before_95), (after, after_95) = pair.horizontal_before, pair.horizontal_after
        horizontal = f"{before:>7.3f} / {before_95:.3f} -> {after:>7.4f} / {after_95:.4f}"
        height = f"{pair.height_before[0]:>7.3f} -> {pair.height_after[0]:>7.4f}"
        typer.echo(f"{f'{first} - {second}':<12} {pair.n_ties:>5}  {horizontal}  {height}")
    if len(pairs) > MOST_PAIRS:
        typer.echo(f"{'':<12} {len(pairs) - MOST_PAIRS} more pairs in residuals.csv")
