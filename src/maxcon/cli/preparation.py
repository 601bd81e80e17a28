# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Before the first drive: `maxcon warmup` compiles, `maxcon scans info` says how a recording is understood."""

import time
from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.options import Topic


def warmup(quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the last line.")] = False) -> None:
    """Compile what `map build` and `localize` need, once after installation: the first real call does not pause then.

    A call when all is compiled already says so, and where the code is kept.
    """
    from tempfile import TemporaryDirectory

    from maxcon._system.kernel_cache import checked_code_folder, on_compilation
    from maxcon.errors import FileError
    from maxcon.warmup import parts_to_compile

    compiled: list[str] = []
    kept_in, began = checked_code_folder(), time.perf_counter()
    try:
        with TemporaryDirectory(prefix="maxcon-warmup-") as folder:
            for part, run in parts_to_compile(Path(folder)).items():
                if not quiet:
                    typer.echo(f"{part:<26}", nl=False)
                start = time.perf_counter()
                with on_compilation(lambda part=part: compiled.append(part)):  # type: ignore[misc]
                    run()
                took = f"compiled in {time.perf_counter() - start:.1f} s" if part in compiled else "compiled already"
                if not quiet:
                    typer.echo(took)
    except OSError as error:
        raise FileError(
            f"Expected to be able to write {error.filename or 'compiled code'}, got: {error.strerror or error}."
            " Check the folder, its permissions and the free disk space."
        ) from error
    begin = f"compiled in {time.perf_counter() - began:.0f} s" if compiled else "everything was compiled already"
    typer.echo(f"{begin}; the code is kept in {kept_in}")


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

    from maxcon.io.scans import describe
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
