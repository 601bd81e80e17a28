# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon map align`."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.flags import OptionGroup, flag, flags
from maxcon.cli.options import Quiet
from maxcon.cli.terminal import compiling_told, step_bars

if TYPE_CHECKING:
    from maxcon.mapping.align import Alignment

__all__ = ["align"]

MOST_PAIRS = 15
"""In the printed table; residuals.csv has all."""


@dataclass(frozen=True, slots=True)
class CloudOptions(OptionGroup):
    """What is known of the clouds."""

    title = "Inputs"
    trajectory: list[Path] | None = flag(
        None,
        "Where the mapping sensor was, in the times of the points: corrected as they are; repeatable.",
        metavar="TUM|CSV",
        rich_help_panel="Inputs",
    )
    crs: str | None = flag(None, "CRS of clouds that name none themselves.", metavar="EPSG:N|WKT")


@dataclass(frozen=True, slots=True)
class PassOptions(OptionGroup):
    """How passes are told apart, and how well each is known."""

    title = "Rounds"
    rounds: str = flag(
        "time",
        "What tells rounds apart: pauses in gps_time, point source ids, or files.",
        metavar="time|source|file",
        rich_help_panel="Rounds",
    )
    pause: float = flag(20.0, "Seconds without a point between two rounds, by time.", metavar="S")
    georeference_sigma: float = flag(
        0.1,
        "How well each round is georeferenced: standard deviation along any axis, in m.",
        metavar="M",
        rich_help_panel="Rounds",
    )
    georeference_sigma_deg: float = flag(0.05, "The same of its roll, pitch and heading, in degrees.", metavar="DEG")
    drift_sigma: float | None = flag(
        None,
        "Standard deviation of how a round's errors change within it, in m; 0: rounds are rigid. Default: what the"
        " matches ask for.",
        metavar="M",
        show_default=False,
        rich_help_panel="Rounds",
    )
    knots: float = flag(10.0, "Corrections that drift are free every so many seconds.", metavar="S")


@dataclass(frozen=True, slots=True)
class ClassOptions(OptionGroup):
    """Which classes are not matched."""

    title = "Classes"
    drop: list[str] | None = flag(
        None,
        "Class that is not matched, by name or number; repeatable. Default: vegetation, noise, temporal-exclusion.",
        metavar="CLASS",
        rich_help_panel="Classes",
    )
    vehicle_class: list[int] | None = flag(
        None, "Class number that means vehicles: not matched; repeatable.", metavar="NUMBER", rich_help_panel="Classes"
    )


@dataclass(frozen=True, slots=True)
class OutputFolder(OptionGroup):
    """The alignment to write."""

    title = "Output"
    out: Path = flag(..., "Folder to write.", "--out", "-o", metavar="FOLDER")
    overwrite: bool = flag(False, "Replace the alignment if there is one.", "--overwrite")


@flags
def align(
    clouds: Annotated[
        list[Path], typer.Argument(metavar="CLOUD...", help="LAS or LAZ files of all rounds, in tiles or whole.")
    ],
    cloud: CloudOptions,
    passes: PassOptions,
    classes: ClassOptions,
    output: OutputFolder,
    threads: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Places matched at once, 0.4 GiB each. Default: processors, at most 4.",
            rich_help_panel="How it is done",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Bring rounds of a mapping campaign together: match them, adjust them, write corrected clouds."""
    from maxcon.mapping.align import AlignmentOptions, align_files

    options = AlignmentOptions(
        passes_by=passes.rounds,
        pause=passes.pause,
        georeference_sigma=passes.georeference_sigma,
        georeference_sigma_deg=passes.georeference_sigma_deg,
        drift_sigma=passes.drift_sigma,
        knot_spacing=passes.knots,
        drop=classes.drop or None,
        vehicle_classes=tuple(classes.vehicle_class or ()),
        crs=cloud.crs,
    )
    with step_bars("", quiet) as report, compiling_told(quiet):
        found = align_files(
            clouds, output.out, options, trajectories=cloud.trajectory or (), overwrite=output.overwrite,
            n_threads=threads, progress=report,
        )  # fmt: skip
    typer.echo(f"{output.out}")
    _describe(found)


def _describe(found: "Alignment") -> None:
    """Print how far passes lay apart and lie apart, and what that says of a map."""
    drift = found.adjusted.drift_sigma
    rows = [
        ("passes", f"{len(found.passes)}, told apart by {found.passes.by}"),
        ("matches", _matches(found)),
        ("corrections", f"a motion of each pass{f', and drift of {drift:g} m' if drift else ', rigid'}"),
    ]
    for name, text in rows:
        typer.echo(f"{name:<12} {text}")
    _table(found)
    typer.echo(
        f"{'sigma':<12} one pass beside the others {found.sigma_before:.4f} m before, {found.sigma_of_pass:.4f} m"
        f" after; a map of all of them {found.sigma_of_map:.4f} m: `map build` finds it in alignment.json"
    )
    in_crs = math.hypot(found.sigma_of_map, found.sigma_of_datum)
    typer.echo(
        f"{'datum':<12} the mean of the passes' georeference, known to {found.sigma_of_datum:.3f} m: where answers have"
        f" to hold in the CRS, --sigma {in_crs:.3f}"
    )
    for each in found.connectivity:
        if each.words:
            typer.echo(f"{'note':<12} {each.words}")


def _matches(found: "Alignment") -> str:
    text = f"{len(found.constraints):,} matched pairs of visits, {found.n_contradicted:,} of them contradict the others"
    for words, number in sorted(found.refused.items()):
        text += f"; of {number:,} more {words}"
    return text


def _table(found: "Alignment") -> None:
    """Distances between passes, pair by pair."""
    typer.echo(f"{'passes':<12} {'pairs':>5}  {'horizontal, median / 95 % m':>35}  {'height, median m':>18}")
    pairs = found.pairs
    for pair in pairs[:MOST_PAIRS]:
        first, second = (number + 1 for number in pair.passes)
        (before, before_95), (after, after_95) = pair.horizontal_before, pair.horizontal_after
        horizontal = f"{before:>7.3f} / {before_95:.3f} -> {after:>7.4f} / {after_95:.4f}"
        height = f"{pair.height_before[0]:>7.3f} -> {pair.height_after[0]:>7.4f}"
        typer.echo(f"{f'{first} - {second}':<12} {pair.n_constraints:>5}  {horizontal}  {height}")
    if len(pairs) > MOST_PAIRS:
        typer.echo(f"{'':<12} {len(pairs) - MOST_PAIRS} more pairs in residuals.csv")
