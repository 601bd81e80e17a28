# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon scans info`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.options import Topic

if TYPE_CHECKING:
    from maxcon.io.scans.description import ScansDescription

__all__ = ["app"]

app = typer.Typer(help="Say what is in scans or a recording.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def _group() -> None:
    """Say what is in scans or a recording."""


@app.command()
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
        for name, text in _rows(scanner):
            table.add_row(name, text)
        console.print()
        console.print(table)


def _rows(scanner: "ScansDescription") -> list[tuple[str, str]]:
    rate = "" if scanner.rate is None else f", {scanner.rate:.2f} a second"
    rows = [
        ("scans", f"{scanner.source}: {scanner.n_scans:,} scans{rate}; of the first {scanner.n_seen}:"),
        ("fields", scanner.fields),
        ("times", scanner.times),
        ("rings", scanner.rings),
        ("points", _points(scanner)),
    ]
    if scanner.ranges is not None:
        nearest, median, farthest = scanner.ranges
        rows.append(("range", f"{nearest:.2f} to {farthest:.1f} m, median {median:.1f} m"))
    if scanner.low is not None and scanner.high is not None:
        extents = zip("xyz", scanner.low, scanner.high, strict=True)
        rows.append(("extent", ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, low, high in extents) + " m"))
    if scanner.fraction_with_normal is not None:
        rows.append(
            ("normals", f"{100.0 * scanner.fraction_with_normal:.0f} % of the points of the first scan have one")
        )
    if scanner.problem:
        rows.append(("problem", scanner.problem))
    return rows


def _points(scanner: "ScansDescription") -> str:
    n = max(scanner.n_points, 1)
    each = scanner.n_points / max(scanner.n_seen, 1)
    return (
        f"{each:,.0f} a scan; {100.0 * scanner.n_invalid / n:.1f} % no returns,"
        f" {100.0 * scanner.n_duplicates / n:.1f} % come twice"
    )
