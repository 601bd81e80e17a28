# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon simulate`."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maxcon.cli.options import Quiet
from maxcon.cli.terminal import step_bars
from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset

if TYPE_CHECKING:
    from maxcon.io.recordings.writing import RecordingKind

__all__ = ["Scene", "simulate"]


class Scene(StrEnum):
    """Where the drive goes."""

    CITY = "city"
    SUBURB = "suburb"


def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the dataset to write.")],
    campaign: Annotated[
        bool, typer.Option("--campaign", help="A circuit mapped in five rounds, and a round of up to 3001 scans.")
    ] = False,
    hard: Annotated[
        bool, typer.Option("--hard", help="With --campaign: periodic facades, things gone, 30 % unmapped returns.")
    ] = False,
    scene: Annotated[
        Scene, typer.Option("--scene", help="A city, or a suburb: hedges, gardens, slopes, a moving scanner.")
    ] = Scene.CITY,
    scanner: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The car's scanner: vlp-16 (the default), vlp-32c, hdl-64e or os1-64.",
            show_default=False,
        ),
    ] = None,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="How many scans; 40, 3001 with --campaign, 200 in a suburb.", show_default=False),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="With --campaign: seconds between two scans, from the beginning of the round on. Else they are"
            " spread evenly over it.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same dataset.")] = 0,
    recording: Annotated[
        str | None,
        typer.Option(
            metavar="bag|mcap",
            help="Also write the scans, with positions in latitude and longitude, as a recording: a ROS 1 bag or MCAP"
            " (extra recordings).",
            show_default=False,
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the folder if there is one.")] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a city or a suburb: map clouds (LAZ), scans, reference and priors (TUM). Needs the extra demo."""
    from maxcon.lab import simulation

    if hard and not campaign:
        raise OptionError("Expected --hard together with --campaign, got it alone. Add --campaign, or leave it out.")
    if every is not None and not campaign:
        raise OptionError("Expected --every together with --campaign, got it alone. Add --campaign, or leave it out.")
    if campaign and scene is not Scene.CITY:
        raise OptionError(f"Expected --campaign in the city, got it with --scene {scene.value}. Leave one of them out.")
    kind = None if recording is None else _recording_kind(recording)
    options: dict[str, Any] = {"seed": seed, "overwrite": overwrite}
    if scanner is not None:
        options["scanner"] = simulation.ScannerLayout.parse(scanner).scanner()
    with step_bars("", quiet) as report:

        def progress(done: int, total: int) -> None:
            report("simulating", done, total)

        options["progress"] = progress
        if campaign:
            dataset = simulation.simulate_campaign(out, n_epochs=epochs or 3001, every=every, is_hard=hard, **options)
        elif scene is Scene.SUBURB:
            dataset = simulation.simulate_suburb(out, n_epochs=epochs or 200, **options)
        else:
            dataset = simulation.simulate(out, n_epochs=epochs or 40, **options)
    _say_what_was_written(dataset)
    if kind is not None:
        from maxcon.lab.simulation.recordings import record_dataset

        typer.echo(f"{'recording':<12} {record_dataset(dataset, kind)}")


def _recording_kind(name: str) -> "RecordingKind":
    """The kind of recording of a name; what writes it is there, or it is said before the work is done."""
    from maxcon.io.recordings.writing import RecordingKind, check_writers

    kinds = [kind.value for kind in RecordingKind]
    if name not in kinds:
        raise OptionError(f"Expected --recording to be one of {', '.join(kinds)}, got {name!r}. Choose one of these.")
    check_writers()
    return RecordingKind(name)


def _say_what_was_written(dataset: Dataset) -> None:
    """Name the parts of `dataset`, one per line; a prior has its name where there are several."""
    typer.echo(f"{dataset.folder}")
    clouds = f"{dataset.map_clouds[0].parent}/*.laz ({len(dataset.map_clouds)} files, vehicles are class 64)"
    parts: list[tuple[str, object]] = [
        ("map clouds", clouds),
        ("mapping", dataset.map_trajectory),
        ("scans", dataset.scans),
        ("reference", dataset.reference),
    ]
    if dataset.map_sigma is not None:
        parts.insert(2, ("map sigma", f"{dataset.map_sigma:g} m (map build --sigma {dataset.map_sigma:g})"))
    is_only = len(dataset.priors) == 1
    parts += [("prior" if is_only else f"prior {name}", path) for name, path in dataset.priors.items()]
    if dataset.odometry is not None:
        parts.append(("odometry", dataset.odometry))
    width = max(12, *(len(name) for name, _ in parts))
    for name, path in parts:
        typer.echo(f"{name:<{width}} {path}")
