# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon demo`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.terminal import compiling_told, step_bars

if TYPE_CHECKING:
    from maxcon.lab.demo import MethodResult, WideResult

__all__ = ["demo"]


def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for everything the demo makes.")] = Path(
        "maxcon-demo"
    ),
    epochs: Annotated[int, typer.Option(min=1, help="How many scans.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same answers.")] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bars.")] = False,
) -> None:
    """Simulate a small city, map it, drive it, localize from near and from wide priors, and report.

    Needs the extra demo. A demo that stands in DIR is replaced; anything else there is an error.
    """
    from maxcon._system.atomic import atomic_folder, check_replaceable
    from maxcon.lab.demo import (
        DEMO_METHODS,
        DEMO_NAMES,
        check_extras,
        localize_demo,
        prepare_demo,
        report_demo,
        try_wide_priors,
    )

    check_extras()
    check_replaceable(out, "a demo", DEMO_NAMES)
    with (
        step_bars("", quiet, has_lines=True) as progress,
        compiling_told(quiet),
        atomic_folder(out, overwrite=True) as folder,
    ):
        drive = prepare_demo(folder, n_epochs=epochs, seed=seed, progress=progress)
        results = localize_demo(drive, folder, DEMO_METHODS, progress=progress)
        wide = try_wide_priors(drive, folder, seed=seed, progress=progress)
        report_demo(folder, drive, results, wide, seed=seed, progress=progress)
    _print_table(results)
    _print_wide(wide)
    typer.echo(f"\nThe report with pictures: {out / 'report.html'}")


def _print_table(results: "Sequence[MethodResult]") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Within 0.3 m and 1 degree of the reference, from priors wrong by up to 2.5 m and 1.8 degrees")
    table.add_column("method")
    for name in ("success", "median m", "worst m", "worst deg", "ms per epoch"):
        table.add_column(name, justify="right")
    for result in results:
        accuracy = result.accuracy
        table.add_row(
            result.method.name,
            f"{accuracy.n_success} of {accuracy.n_epochs}",
            f"{accuracy.distance.median:.3f}",
            f"{accuracy.distance.worst:.3f}",
            f"{math.degrees(accuracy.heading.worst):.2f}",
            f"{result.median_milliseconds:.0f}",
        )
    Console().print(table)


def _print_wide(wide: "WideResult") -> None:
    from rich.console import Console
    from rich.table import Table

    widest = wide.widest
    level = f"{widest[0].offset:g} m and {widest[0].heading_deg:g} degrees"
    table = Table(title=f"The same, from priors wrong by up to {level}, beside registration")
    table.add_column("method")
    for name in ("success", "wrong, but called good", "median ms"):
        table.add_column(name, justify="right")
    for one in widest:
        table.add_row(one.method, f"{one.n_right} of {one.n_epochs}", str(one.n_wrong_but_good), f"{one.median_ms:.0f}")
    Console().print("", table)
    Console(soft_wrap=True).print(wide.words, markup=False, highlight=False)
