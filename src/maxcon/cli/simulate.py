# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.progress import step_bars

__all__ = ["simulate"]


def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the dataset to write.")],
    epochs: Annotated[int, typer.Option(min=1, help="How many scans.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same dataset.")] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the folder if there is one.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Simulate a small city: map clouds (LAZ), scans, reference and priors (TUM). Needs the extra demo."""
    from maxcon.simulation import simulate as simulate_dataset

    with step_bars("", quiet) as report:
        dataset = simulate_dataset(
            out,
            n_epochs=epochs,
            seed=seed,
            overwrite=overwrite,
            progress=lambda done, total: report("simulating", done, total),
        )
    typer.echo(f"{dataset.folder}")
    for name, path in (
        (
            "map clouds",
            f"{dataset.map_clouds[0].parent}/*.laz ({len(dataset.map_clouds)} files, vehicles are class 64)",
        ),
        ("mapping", dataset.map_trajectory),
        ("scans", dataset.scans),
        ("reference", dataset.reference),
        ("prior", dataset.prior),
    ):
        typer.echo(f"{name:<12} {path}")
