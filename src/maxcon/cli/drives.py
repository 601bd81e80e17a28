# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize` by several workers: one drive, or a table of drives."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.progress import step_bars
from maxcon.errors import MaxconError, OptionError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine
    from maxcon.cli.drive_opener import DriveOpener, OpenedDrive
    from maxcon.drive.localize import EpochEstimate
    from maxcon.drive.many import ManyDrivesJob
    from maxcon.drive.many.job import DriveTask

__all__ = ["check_one_or_many", "localize_many", "several_workers"]


def check_one_or_many(
    drives: Path | None, map_folder: Path | None, scans: Path | None, out: Path, alone: dict[str, object]
) -> None:
    """Refuse arguments of one drive beside a table of drives, and one drive without its arguments.

    Parameters
    ----------
    drives, map_folder, scans : Path, optional
        As they are given.
    out : Path
        What is written.
    alone : dict of str to object
        Options that are of one drive, by name; those not given are None or False.

    Raises
    ------
    OptionError
        If it is so.
    """
    if drives is None:
        missing = "MAP" if map_folder is None else "SCANS"
        if map_folder is None or scans is None:
            raise OptionError(f"Expected MAP and SCANS, or --drives with a table of drives, got no {missing}. Name it.")
        return
    given = [name for name, value in {"SCANS": scans, **alone}.items() if value]
    if given:
        raise OptionError(_of_one_drive(given[0], out))


def _of_one_drive(name: str, out: Path) -> str:
    """Say why an option is not for many drives, and what to do instead."""
    if name == "--resume":
        return (
            "Expected --drives without --resume, got both: the same command goes on by itself where it was stopped."
            " Leave --resume out."
        )
    if name == "--overwrite":
        return (
            "Expected --drives without --overwrite, got both: what is there of drives is never replaced. To localize"
            f" all anew remove {out} yourself, to do so with one its drive=NAME there; and leave --overwrite out."
        )
    if name in ("--tum", "--plot", "--plot-epochs"):
        instead = f"; when all is done: maxcon export {out} --drive NAME -o FILE.tum" if name == "--tum" else ""
        return f"Expected {name} with one drive only, got it beside --drives. Leave it out{instead}."
    return (
        f"Expected each drive's files in the table of --drives and no {name} beside it, got both. Name the file in the"
        " table, or leave --drives out."
    )


def localize_many(
    drives: Path, map_folder: Path | None, out: Path, opener: "DriveOpener", engine: "Engine", quiet: bool
) -> None:
    """Localize a table of drives into a dataset, and say what became of them.

    Raises
    ------
    MaxconError
        If a drive cannot be localized, when the others are.
    """
    from maxcon.drive.many import ManyDrivesJob, localize_drives, read_drives

    entries = read_drives(drives, map_folder)
    with step_bars("epochs", quiet) as report:
        done = localize_drives(entries, ManyDrivesJob(opener), out, engine, report)
    before = f", {done.n_epochs - done.n_new} of them were there" if done.n_epochs > done.n_new else ""
    typer.echo(
        f"{done.n_localized:,} of {done.n_epochs:,} epochs of {done.n_drives:,} drives localized{before}; in {out}"
    )
    if done.refused:
        name, reason = next(iter(done.refused.items()))
        raise MaxconError(
            f"Expected drives that can be localized, but {len(done.refused)} of {len(entries)} cannot; the first,"
            f" {name}: {reason}"
        )
    if done.n_localized < done.n_epochs:
        raise typer.Exit(1)


def several_workers(
    opened: "OpenedDrive", engine: "Engine", first: int, with_points: frozenset[int]
) -> "Iterator[EpochEstimate]":
    """Yield the epochs of a drive from one on, in order, localized by the workers of an engine.

    Points stay with the workers; those of the epochs `with_points` are read once more.
    """
    from maxcon.drive.many import ManyDrivesJob
    from maxcon.drive.many.run import tasks_of

    opened.checked()  # what cannot work is said before anything is started
    tasks = list(tasks_of(opened.entry, range(first, opened.n_epochs)))
    found = _in_order(engine, ManyDrivesJob(opened.opener), tasks, first)
    return (opened.with_points(epoch) if epoch.epoch in with_points else epoch for epoch in found)


def _in_order(
    engine: "Engine", job: "ManyDrivesJob", tasks: "list[DriveTask]", first: int
) -> "Iterator[EpochEstimate]":
    waiting: dict[int, EpochEstimate] = {}
    for _, found in engine.run(job, tasks, len(tasks)):
        if isinstance(found, str):
            raise MaxconError(found)
        waiting.update((epoch.epoch, epoch) for epoch in found)
        while first in waiting:
            yield waiting.pop(first)
            first += 1
