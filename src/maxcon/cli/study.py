# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon study` and `maxcon report`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.flags import flags
from maxcon.cli.options import Quiet, RangeOptions, WorkerOptions
from maxcon.cli.terminal import step_bars, warn

if TYPE_CHECKING:
    from maxcon.lab.study import MethodStatistics, Study

__all__ = ["report", "study"]


@flags
def study(
    *,
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder with a dataset.toml, or such a file.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="STUDY", help="Folder to write; a study there goes on.", rich_help_panel="Output"
        ),
    ],
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Names of methods and sets (consensus, baselines, ground, weights, cells, density). Default:"
            " consensus,baselines; without those whose packages are not installed.",
            rich_help_panel="Method",
        ),
    ] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Prior of the dataset, or reference; repeatable. Default: all of the dataset.",
            rich_help_panel="Inputs",
        ),
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="So many scans, evenly spread. Default: all.", rich_help_panel="Inputs"),
    ] = None,
    half_width: Annotated[
        float,
        typer.Option(metavar="M", help="Largest offset from the prior in x and y, m.", rich_help_panel="Search space"),
    ] = 3.0,
    heading_half_width_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="Largest turn from the prior's heading, degrees.", rich_help_panel="Search space"
        ),
    ] = 2.0,
    heading_step_deg: Annotated[
        float, typer.Option(metavar="DEG", help="Step between headings, degrees.", rich_help_panel="Search space")
    ] = 0.5,
    ranges: RangeOptions,
    max_gap: Annotated[
        float,
        typer.Option(
            metavar="S", help="Largest gap in prior and reference to interpolate across.", rich_help_panel="Inputs"
        ),
    ] = 0.5,
    worker: WorkerOptions,
    quiet: Quiet = False,
) -> None:
    """Compare methods over the epochs of a dataset: one table, a row per epoch and method.

    Stopped or killed, the same command goes on; with other methods, priors or epochs it adds to the table.
    """
    from maxcon.drive.localize import DriveOptions
    from maxcon.lab.dataset import Dataset
    from maxcon.lab.study import DEFAULT_SETS, choose_methods, installed_methods, run_study
    from maxcon.search.space import SearchSpace

    opened = Dataset.open(dataset)
    space = SearchSpace(half_width, _cell_of(opened.map_path), heading_half_width_deg, heading_step_deg)
    names = DEFAULT_SETS if methods is None else [name.strip() for name in methods.split(",") if name.strip()]
    chosen = choose_methods(names, space)
    if methods is None:
        chosen, missing = installed_methods(chosen)
        if missing:
            typer.echo(f"without {', '.join(missing)}: pip install 'maxcon[baselines]'")
    with step_bars("", quiet) as report:
        done = run_study(
            opened,
            out,
            chosen,
            priors=prior,
            n_epochs=epochs,
            n_workers=worker.workers,
            options=DriveOptions(ranges.min_range, ranges.max_range, max_gap),
            progress=report,
            scheduler=worker.scheduler,
            warn=warn,
        )
    _print_summary(done)


def _cell_of(map_path: Path | None) -> float:
    """Voxel edge of a built map; that of the standard map where it is still to be built."""
    from maxcon.lab.study.methods import MAP_VARIANTS, STANDARD
    from maxcon.map.manifest import read_manifest

    return MAP_VARIANTS[STANDARD].cell if map_path is None else read_manifest(map_path).cell


def _print_summary(done: "Study") -> None:
    from maxcon.lab.study import rows_by_method, statistics

    found = [statistics(rows) for rows in rows_by_method(done.table, tuple(done.configuration.methods))]
    width = max(len(method.method) for method in found)
    for number, method in enumerate(found):
        if number == 0 or method.prior != found[number - 1].prior:
            typer.echo(f"prior {method.prior}")
            typer.echo(f"  {'method':<{width}}   success    trusted  wrong  median m  worst m      ms")
        typer.echo(f"  {method.method:<{width}} {_numbers(method)}")
        others = {status: n for status, n in method.statuses.items() if status in _NO_ANSWER}
        if others:
            typer.echo(f"  {'':<{width}}   " + ", ".join(f"{n} {status}" for status, n in others.items()))
    typer.echo(f"{len(done.table):,} rows in {done.folder / 'table.parquet'}")
    typer.echo(f"page         maxcon report {done.folder} -o report.html")


_NO_ANSWER = ("unreadable scan", "failed", "no prior", "no points", "no match", "outside the map")


def _numbers(method: "MethodStatistics") -> str:
    def shown(value: float, digits: int) -> str:
        return "-" if math.isnan(value) else f"{value:.{digits}f}"

    return (
        f"{f'{method.n_success}/{method.n_epochs}':>10} {method.n_localized:>9} {method.n_false:>6}"
        f" {shown(method.distance.median, 3):>9} {shown(method.distance.worst, 2):>8} {shown(method.ms, 0):>7}"
    )


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="Folder made by `maxcon study`.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="REPORT.html", help="Page to write.")],
    figures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the figures (SVG). Default: REPORT-figures beside the page."),
    ] = None,
    dataset: Annotated[
        Path | None, typer.Option(metavar="DATASET", help="Where the dataset is now, if it was moved.")
    ] = None,
    prior: Annotated[
        str | None, typer.Option(metavar="NAME", help="Prior that figures and claims are about. Default: the first.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write the page of a study: claims, tables and figures in one file. Needs the extra demo."""
    from maxcon.lab.report.study_report import report_study

    with step_bars("", quiet) as tell:
        folder = report_study(study, out, figures=figures, dataset=dataset, prior=prior, progress=tell)
    typer.echo(f"{out}")
    typer.echo(f"figures      {folder}")
