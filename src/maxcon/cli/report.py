# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon report`."""

from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.progress import step_bars

__all__ = ["report"]


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
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Write the page of a study: claims, tables and figures in one file. Needs the extra demo."""
    from maxcon.lab.report.study.report import report_study

    with step_bars("", quiet) as tell:
        folder = report_study(study, out, figures=figures, dataset=dataset, prior=prior, progress=tell)
    typer.echo(f"{out}")
    typer.echo(f"figures      {folder}")
