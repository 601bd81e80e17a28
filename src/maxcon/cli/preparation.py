# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Before the first drive: `maxcon warmup` compiles, `maxcon scans info` says how a recording is understood."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.options import Topic

if TYPE_CHECKING:
    from maxcon.warmup import Compiled


def warmup(quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the last line.")] = False) -> None:
    """Compile what `map build` and `localize` need, once after installation: the first real call does not pause then.

    A call when all is compiled already says so, and where the code is kept.
    """
    from maxcon._system.kernel_cache import checked_code_folder
    from maxcon.errors import FileError
    from maxcon.warmup import warm_up

    done: list[Compiled] = []

    def report(part: str, compiled: "Compiled | None") -> None:
        if compiled is not None:
            done.append(compiled)
        if quiet:
            return
        if compiled is None:
            typer.echo(f"{part:<26}", nl=False)
        elif compiled.n_functions:
            typer.echo(f"compiled in {compiled.seconds:.1f} s")
        else:
            typer.echo("compiled already")

    folder = checked_code_folder()
    try:
        warm_up(report)
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {error.filename or 'compiled code'}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space."
        ) from error
    seconds = sum(compiled.seconds for compiled in done)
    is_new = any(compiled.n_functions for compiled in done)
    begin = f"compiled in {seconds:.0f} s" if is_new else "everything was compiled already"
    typer.echo(f"{begin}; the code is kept in {folder}")


scans = typer.Typer(help="Say what is in scans or a recording.", no_args_is_help=True, rich_markup_mode=None)


@scans.callback()
def _group() -> None:
    """Say what is in scans or a recording."""


@scans.command()
def info(
    path: Annotated[
        Path,
        typer.Argument(metavar="SCANS", help="Folder of scans, a scan, or a recording, as `maxcon localize` takes it."),
    ],
    topic: Topic = None,
) -> None:
    """Print topics, fields, how times of points are understood and why, rate, extent, and shares of points."""
    from rich.console import Console
    from rich.table import Table

    from maxcon.io.scans.description import describe
    from maxcon.io.text import printable

    found = describe(path, topic)
    console = Console(highlight=False, markup=False)  # names in files are no markup
    if found.topics:
        topics = Table(box=None, pad_edge=False)
        topics.add_column("topic", overflow="fold")
        topics.add_column("type", overflow="fold")
        topics.add_column("messages", justify="right")
        for one in found.topics:
            topics.add_row(printable(one.name), printable(one.type), f"{one.n_messages:,}")
        console.print(topics)
    for note in found.notes:
        console.print(note)
    if not found.scanners:
        console.print("no point cloud that can be read")
    for scanner in found.scanners:
        table = Table("", "", show_header=False, box=None, pad_edge=False)
        for row in scanner.items():
            table.add_row(*row)
        console.print()
        console.print(table)
