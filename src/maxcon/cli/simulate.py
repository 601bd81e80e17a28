# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.progress import step_bars
from maxcon.dataset import Dataset
from maxcon.errors import OptionError

__all__ = ["simulate"]


def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the dataset to write.")],
    campaign: Annotated[
        bool,
        typer.Option("--campaign", help="A circuit mapped in five rounds, and a round of up to 3001 scans."),
    ] = False,
    hard: Annotated[
        bool,
        typer.Option("--hard", help="With --campaign: periodic facades, things gone, 30 % unmapped returns."),
    ] = False,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="How many scans; 40, or 3001 with --campaign.", show_default=False),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same dataset.")] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the folder if there is one.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Simulate a small city: map clouds (LAZ), scans, reference and priors (TUM). Needs the extra demo."""
    from maxcon import simulation

    if hard and not campaign:
        raise OptionError(
            "Expected --hard together with --campaign, got it alone. Add --campaign, or leave it out."
        )
    with step_bars("", quiet) as report:

        def progress(done: int, total: int) -> None:
            report("simulating", done, total)

        if campaign:
            dataset = simulation.simulate_campaign(
                out, n_epochs=epochs or 3001, seed=seed, is_hard=hard, overwrite=overwrite, progress=progress
            )
        else:
            dataset = simulation.simulate(
                out, n_epochs=epochs or 40, seed=seed, overwrite=overwrite, progress=progress
            )
    _say_what_was_written(dataset)


def _say_what_was_written(dataset: Dataset) -> None:
    """Name the parts of `dataset`, one per line; a prior has its name where there are several."""
    typer.echo(f"{dataset.folder}")
    clouds = f"{dataset.map_clouds[0].parent}/*.laz ({len(dataset.map_clouds)} files, vehicles are class 64)"
    parts = [
        ("map clouds", clouds),
        ("mapping", dataset.map_trajectory),
        ("scans", dataset.scans),
        ("reference", dataset.reference),
    ]
    is_only = len(dataset.priors) == 1
    parts += [("prior" if is_only else f"prior {name}", path) for name, path in dataset.priors.items()]
    width = max(12, *(len(name) for name, _ in parts))
    for name, path in parts:
        typer.echo(f"{name:<{width}} {path}")
